"""Exact least absolute deviations: hand cases, planted truth, certificates, HiGHS, symmetries."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st

from swsysid._results import Status
from swsysid._solvers import lad
from swsysid._solvers.conic import linear_program
from swsysid._solvers.lad import least_absolute_deviations
from swsysid._solvers.row_space import RowSpace
from swsysid._solvers.settings import SETTINGS, SolverSettings


def highs(design, target, bound=np.inf, weight=None):
    """Least weighted sum of absolute residuals, by the dual simplex of an independent solver."""
    n_samples, n_features = design.shape
    weight = np.ones(n_samples) if weight is None else weight
    eye = np.eye(n_samples)
    solution = linear_program(
        np.concatenate([np.zeros(n_features), weight, weight]),
        A_eq=np.hstack([design, eye, -eye]),
        b_eq=target,
        bounds=[(-bound, bound)] * n_features + [(0, np.inf)] * (2 * n_samples),
        solver="highs",
    )
    assert solution.status is Status.OPTIMAL
    return solution.objective


def random_problem(seed=0, n_samples=200, n_features=6, noise=0.1):
    rng = np.random.default_rng(seed)
    design = rng.normal(size=(n_samples, n_features))
    truth = rng.normal(size=n_features)
    return design, truth, design @ truth + noise * rng.normal(size=n_samples)


def _noisy():
    design, _, target = random_problem()
    return design, target


def _two_modes():
    design, truth, _ = random_problem()
    target = design @ truth
    target[:80] = design[:80] @ -truth
    return design, target


def _collinear():
    design, target = _noisy()
    return np.column_stack([design, design[:, 0] - 2 * design[:, 3]]), target


def _zero_column():
    design, target = _noisy()
    return np.column_stack([design, np.zeros(len(design))]), target


def _duplicated_rows():
    design, target = _noisy()
    return np.repeat(design[:40], 5, axis=0), np.repeat(target[:40], 5)


def _badly_scaled_columns():
    design, target = _noisy()
    return design * np.logspace(-4, 4, design.shape[1]), target


def _badly_scaled_rows():
    design, target = _noisy()
    scale = np.logspace(-4, 4, len(design))
    return design * scale[:, None], target * scale


def _integers():
    design, target = _noisy()
    return np.round(design), np.round(target)


def _indicators():
    labels = np.random.default_rng(1).integers(5, size=100)
    return np.eye(5)[labels], np.round(3 * np.cos(np.arange(100.0)))


def _monomials():
    times = np.linspace(-2.0, 2.0, 150)
    return np.vander(times, 8), np.sign(times) + 0.1 * np.sin(40 * times)


def _heavy_tails():
    design, target = _noisy()
    return design, target + np.random.default_rng(2).standard_cauchy(len(target)) ** 3


def _one_row_more_than_columns():
    design, target = _noisy()
    return design[:7], target[:7]


PROBLEMS = {
    make.__name__.strip("_"): make
    for make in (
        _noisy,
        _two_modes,
        _collinear,
        _zero_column,
        _duplicated_rows,
        _badly_scaled_columns,
        _badly_scaled_rows,
        _integers,
        _indicators,
        _monomials,
        _heavy_tails,
        _one_row_more_than_columns,
    )
}


# Steps along edges come first for all of these problems, or for none.
ROUTES = {"edges": SETTINGS, "interior point": SolverSettings(short=0)}


@pytest.mark.parametrize("route", ROUTES)
@pytest.mark.parametrize("bound", [None, 0.3])
@pytest.mark.parametrize("name", PROBLEMS)
def test_agrees_with_an_independent_solver_and_proves_itself(name, bound, route):
    design, target = PROBLEMS[name]()
    fit = least_absolute_deviations(
        design, target[:, None], coef_bound=bound, settings=ROUTES[route]
    )
    reference = highs(design, target, np.inf if bound is None else bound)
    assert fit.status is Status.OPTIMAL
    np.testing.assert_allclose(fit.objective[0], reference, rtol=1e-8)
    np.testing.assert_allclose(fit.lower_bound, fit.objective, rtol=1e-9)
    np.testing.assert_allclose(fit.objective[0], np.abs(target - design @ fit.coef[0]).sum())
    assert bound is None or np.abs(fit.coef).max() <= bound


def test_median_of_three_points():
    fit = least_absolute_deviations(np.ones((3, 1)), np.array([[1.0], [2.0], [10.0]]))
    assert fit.coef[0, 0] == pytest.approx(2.0, abs=1e-14)
    assert fit.objective[0] == pytest.approx(9.0, abs=1e-13)
    assert fit.lower_bound[0] == pytest.approx(9.0, abs=1e-13)


def test_weighted_median():
    targets = np.array([[1.0], [2.0], [10.0], [11.0]])
    fit = least_absolute_deviations(
        np.ones((4, 1)), targets, sample_weight=np.array([1.0, 1.0, 3.0, 0.0])
    )
    assert fit.coef[0, 0] == pytest.approx(10.0, abs=1e-13)
    assert fit.objective[0] == pytest.approx(17.0, abs=1e-12)


def test_line_through_two_of_three_points():
    # Slopes through the origin: the residual of the steepest lever counts most.
    design = np.array([[1.0], [2.0], [4.0]])
    fit = least_absolute_deviations(design, np.array([[3.0], [2.0], [4.0]]))
    assert fit.coef[0, 0] == pytest.approx(1.0, abs=1e-14)
    assert fit.objective[0] == pytest.approx(2.0, abs=1e-14)


@pytest.mark.parametrize("n_samples", [60, 2000, 30_000])
def test_recovers_the_truth_under_gross_outliers(n_samples):
    design, truth, target = random_problem(3, n_samples, 5, noise=0.0)
    rng = np.random.default_rng(4)
    target[rng.random(n_samples) < 0.2] += 50.0
    fit = least_absolute_deviations(design, target[:, None])
    np.testing.assert_allclose(fit.coef[0], truth, rtol=0, atol=1e-11)
    np.testing.assert_allclose(fit.lower_bound, fit.objective, rtol=1e-9)


@pytest.mark.parametrize("n_samples", [6, 200, 30_000])
def test_clean_data_are_met_exactly(n_samples):
    design, truth, target = random_problem(5, n_samples, noise=0.0)
    fit = least_absolute_deviations(design, target[:, None])
    np.testing.assert_allclose(fit.coef[0], truth, rtol=0, atol=1e-12)
    assert fit.status is Status.OPTIMAL
    assert fit.objective[0] <= 1e-13 * np.abs(target).sum()


@pytest.mark.parametrize("n_samples", [1, 4])
def test_fewer_rows_than_columns_take_the_solution_of_least_norm(n_samples):
    design, _, target = random_problem(6, n_samples)
    fit = least_absolute_deviations(design * np.logspace(-3, 3, 6), target[:, None])
    least = np.linalg.pinv(design * np.logspace(-3, 3, 6), rcond=1e-12) @ target
    np.testing.assert_allclose(fit.coef[0], least, rtol=1e-9, atol=1e-13)
    assert fit.objective[0] <= 1e-12


def test_collinear_coefficients_lie_in_the_row_space():
    design, target = _collinear()
    coef = least_absolute_deviations(design, target[:, None]).coef[0]
    null = np.array([1.0, 0, 0, -2.0, 0, 0, -1.0])
    assert abs(null @ coef) <= 1e-13
    unique = least_absolute_deviations(design[:, :6], target[:, None]).objective
    np.testing.assert_allclose(np.abs(target - design @ coef).sum(), unique[0], rtol=1e-12)


@pytest.mark.parametrize("rows", [0, 5])
def test_nothing_to_fit_gives_zeros(rows):
    fit = least_absolute_deviations(
        np.zeros((rows, 3)), np.ones((rows, 2)), start=np.ones((2, 3)), coef_bound=1.0
    )
    assert (fit.coef == 0).all()
    assert (fit.objective == rows).all()
    assert (fit.lower_bound == rows).all()
    assert fit.status is Status.OPTIMAL


def test_weights_are_repetitions():
    design, _, target = random_problem(7)
    weight = np.random.default_rng(8).integers(0, 4, len(design)).astype(float)
    weighted = least_absolute_deviations(design, target[:, None], sample_weight=weight)
    repeated = least_absolute_deviations(
        np.repeat(design, weight.astype(int), axis=0),
        np.repeat(target, weight.astype(int))[:, None],
    )
    np.testing.assert_allclose(weighted.objective, repeated.objective, rtol=1e-12)
    np.testing.assert_allclose(weighted.coef, repeated.coef, rtol=0, atol=1e-12)


def test_equivariances():
    design, _, target = random_problem(9)
    rng = np.random.default_rng(10)
    base = least_absolute_deviations(design, target[:, None]).coef[0]

    def coef(design, target):
        return least_absolute_deviations(design, target[:, None]).coef[0]

    np.testing.assert_allclose(coef(design, -1e5 * target), -1e5 * base, rtol=1e-11)
    np.testing.assert_allclose(coef(design, 1e-7 * target), 1e-7 * base, rtol=1e-11)
    shift = rng.normal(size=6)
    np.testing.assert_allclose(coef(design, target + design @ shift), base + shift, atol=1e-12)
    mixing = rng.normal(size=(6, 6))
    np.testing.assert_allclose(mixing @ coef(design @ mixing, target), base, atol=1e-11)
    order = rng.permutation(len(target))
    np.testing.assert_allclose(coef(design[order], target[order]), base, atol=1e-12)


def test_outputs_are_independent():
    design, _, target = random_problem(11)
    targets = np.column_stack([target, -3 * target, np.roll(target, 1)])
    together = least_absolute_deviations(design, targets, coef_bound=1.0)
    for output in range(3):
        alone = least_absolute_deviations(design, targets[:, [output]], coef_bound=1.0)
        np.testing.assert_allclose(together.coef[output], alone.coef[0], atol=1e-12)
        np.testing.assert_allclose(together.lower_bound[output], alone.lower_bound[0], rtol=1e-12)


@pytest.mark.parametrize("n_samples", [300, 20_000])
@pytest.mark.parametrize("shift", [0.0, 1e-3, 10.0])
def test_a_start_does_not_change_the_optimum(n_samples, shift):
    design, _, target = random_problem(12, n_samples)
    cold = least_absolute_deviations(design, target[:, None])
    warm = least_absolute_deviations(design, target[:, None], start=cold.coef + shift)
    np.testing.assert_allclose(warm.objective, cold.objective, rtol=1e-12)
    np.testing.assert_allclose(warm.lower_bound, cold.objective, rtol=1e-9)


def test_a_box_that_is_not_active_changes_nothing():
    design, _, target = random_problem(13)
    free = least_absolute_deviations(design, target[:, None])
    boxed = least_absolute_deviations(design, target[:, None], coef_bound=1e6)
    assert (free.coef == boxed.coef).all()


def _in_time_order(n_samples):
    times = np.linspace(0, 300, n_samples)
    phases = np.arange(6)
    design = np.sin(2 * np.pi * np.outer(times, 1 + phases) / 10 + phases)
    return design, design @ np.arange(6.0) + 0.05 * np.sin(77 * times) + 0.1 * np.sin(3e4 * times)


def _rare_features(n_samples):
    design, _, target = random_problem(14, n_samples, 6)
    design[:, 4] = design[:, 5] = 0.0
    design[17, 4], design[40:45, 5] = 1.0, 2.0
    return design, target


def _quantised(n_samples):
    design, _, target = random_problem(15, n_samples, 6)
    return design, np.round(target)


def _half_from_another_mode(n_samples):
    design, truth, _ = random_problem(16, n_samples, 6)
    return design, np.where(design[:, 0] > 0.1, design @ truth, design @ np.roll(truth, 1))


@pytest.mark.parametrize("short", [0, 5000])
@pytest.mark.parametrize("bound", [None, 0.5])
@pytest.mark.parametrize(
    "make", [_in_time_order, _rare_features, _quantised, _half_from_another_mode]
)
def test_merging_rows_is_exact(make, bound, short):
    design, target = make(12_000)

    def solved(settings):
        return least_absolute_deviations(
            design, target[:, None], coef_bound=bound, settings=settings
        )

    along_edges, merged = solved(SETTINGS), solved(SolverSettings(short=short))
    np.testing.assert_allclose(merged.lower_bound, merged.objective, rtol=1e-9)
    np.testing.assert_allclose(merged.objective, along_edges.objective, rtol=1e-10)
    # every row reaches the interior point
    whole = solved(SolverSettings(short=0, fewest=len(design) + 1))
    np.testing.assert_allclose(merged.objective, whole.objective, rtol=1e-10)


def test_merging_is_used_for_many_rows(monkeypatch):
    design, _, target = random_problem(17, 12_000)
    sizes = []
    direct = lad._direct
    monkeypatch.setattr(
        lad, "_direct", lambda rows, start: sizes.append(len(rows.targets)) or direct(rows, start)
    )
    least_absolute_deviations(design, target[:, None], settings=SolverSettings(short=10_000))
    assert max(sizes) <= 3000


def test_the_bound_is_below_every_other_point():
    design, _, target = random_problem(18)
    fit = least_absolute_deviations(design, target[:, None], coef_bound=0.4)
    others = np.random.default_rng(19).uniform(-0.4, 0.4, size=(2000, 6))
    others = np.vstack([others, fit.coef + 1e-6 * others]).clip(-0.4, 0.4)
    values = np.abs(target - others @ design.T).sum(axis=1)
    assert values.min() >= fit.lower_bound[0] - 1e-10


@examples(max_examples=40, derandomize=True, deadline=None)
@given(
    st.integers(1, 12),
    st.integers(1, 3),
    st.sampled_from([None, 1.0]),
    st.data(),
)
def test_small_integer_problems(n_samples, n_features, bound, data):
    # Small integers give ties, repeated rows and dependent columns of every kind.
    entries = st.integers(-2, 2)
    rows = data.draw(
        st.lists(
            st.lists(entries, min_size=n_features + 1, max_size=n_features + 1),
            min_size=n_samples,
            max_size=n_samples,
        )
    )
    table = np.array(rows, dtype=float)
    design, target = table[:, :-1], table[:, -1]
    reference = highs(design, target, np.inf if bound is None else bound)
    for settings in ROUTES.values():
        fit = least_absolute_deviations(
            design, target[:, None], coef_bound=bound, settings=settings
        )
        assert fit.objective[0] == pytest.approx(reference, abs=1e-9)
        assert fit.lower_bound[0] == pytest.approx(reference, abs=1e-9)


@pytest.mark.parametrize("name", PROBLEMS)
def test_edges_need_no_interior_point(name, monkeypatch):
    monkeypatch.setattr(lad, "interior_point", None)
    design, target = PROBLEMS[name]()
    for scale in (1.0, np.logspace(-5, 5, design.shape[1])):
        fit = least_absolute_deviations(design * scale, target[:, None])
        np.testing.assert_allclose(fit.objective[0], highs(design, target), rtol=1e-8)


@pytest.mark.parametrize("n_features", [1, 2, 4, 8])
@pytest.mark.parametrize("n_modes", [1, 2])
def test_edges_lead_to_the_optimum_from_anywhere(n_modes, n_features, monkeypatch):
    """Also where most residuals vanish at many vertices, as for memberships between modes."""
    monkeypatch.setattr(lad, "interior_point", None)
    for seed in range(5):
        design, truth, target = random_problem(seed, 400, n_features)
        if n_modes == 2:
            target = design @ truth + np.where(np.arange(400) % 3, 0.0, target)
        fit = least_absolute_deviations(design, target[:, None], start=np.ones((1, n_features)))
        np.testing.assert_allclose(fit.objective[0], highs(design, target), rtol=1e-9)
        np.testing.assert_allclose(fit.lower_bound, fit.objective, rtol=1e-11)


def test_row_space_of_a_large_design_with_a_rare_feature():
    # The sample of rows that is looked at first misses the only nonzero entries of a column.
    design = np.random.default_rng(20).normal(size=(50_000, 3))
    design[:, 2] = 0.0
    design[[7, 8, 9], 2] = 1.0
    assert RowSpace(design).rank == 3
    design[:, 2] = design[:, 0]
    assert RowSpace(design).rank == 2


def test_kept_rows_do_not_lead_to_each_other_for_ever(monkeypatch):
    """On these rows two sets of kept rows each called for the other."""
    merge, merged = lad._merge, []

    def counted(*args):
        merged.append(args)
        assert len(merged) < 60
        return merge(*args)

    monkeypatch.setattr(lad, "_merge", counted)
    rng = np.random.default_rng(117)
    design = rng.standard_normal((20_000, 2))
    targets = design @ np.array([[1.0], [-0.5]]) + 0.1 * rng.standard_normal((20_000, 1))
    fit = least_absolute_deviations(design, targets, settings=SolverSettings(short=0))
    assert fit.objective[0] - fit.lower_bound[0] <= 1e-9 * fit.objective[0]
