"""The margin LP on a working set: exact, whatever the data look like."""

from types import SimpleNamespace

import numpy as np
import pytest
from sklearn.preprocessing import PolynomialFeatures

from swsysid._results import SolverError, Status
from swsysid._solvers.conic import linear_program, worst_status
from swsysid._surfaces.hinge import MarginProgram, approach, best_multiple
from swsysid._surfaces.margin_program import fit_programs, fit_surface
from swsysid._surfaces.mode_books import fit_mode_book
from swsysid._surfaces.surface import decisions_of

MARGIN, BETA, BOUND = 1e-2, 1e-5, 10.0


def quartic(X):
    """Energy of the paper's quartic oscillator minus its threshold."""
    x, y = X.T
    return 0.5 * y**2 + 0.5 * x**2 + 0.075 * x**4 - 3.0


def random_signs(rng, X):
    return rng.choice([-1.0, 1.0], size=len(X))


def planted(rng, X, noise=0.0):
    return np.where(quartic(X) > 0, 1.0, -1.0) * np.where(rng.random(len(X)) < noise, -1.0, 1.0)


def problem(kind, n_samples, degree, seed=0):
    """Features, signs and weights of one of the kinds of data below."""
    rng = np.random.default_rng(seed)
    X = rng.uniform(-4.5, 4.5, size=(n_samples, 2))
    weight = np.ones(n_samples)
    if kind == "random":
        signs = random_signs(rng, X)
    elif kind == "separable":
        signs = planted(rng, X)
    elif kind == "noisy":
        signs = planted(rng, X, noise=0.05)
    elif kind == "lattice":  # many rows on equal values: degenerate vertices
        X = np.round(X)
        signs = planted(rng, X, noise=0.02)
    elif kind == "repeated":
        X, signs = np.repeat(X[::4], 4, axis=0), np.repeat(planted(rng, X[::4], noise=0.05), 4)
    elif kind == "weighted":
        signs, weight = planted(rng, X, noise=0.02), rng.uniform(0.01, 20.0, size=n_samples)
    elif kind == "one sided":  # a constant surface is optimal, all rows lie on the margin
        signs = np.ones(n_samples)
    else:  # flat
        X[:, 1] = 2.0
        signs = np.where(X[:, 0] > 1.0, 1.0, -1.0)
    spread = np.where(np.ptp(X, axis=0) > 0, X.std(axis=0), 1.0)
    features = PolynomialFeatures(degree).fit_transform((X - X.mean(axis=0)) / spread)
    return features, signs, weight


KINDS = ["random", "separable", "noisy", "lattice", "repeated", "weighted", "one sided", "flat"]


def one_shot(features, signs, weight, margin, beta, bound, solver="auto"):
    """Value of the margin LP as the paper writes it: coefficients, their sizes, and slacks."""
    n_samples, n_features = features.shape
    signed, eye = signs[:, None] * features, np.eye(n_features)
    none = np.zeros((n_features, n_samples))
    solution = linear_program(
        np.concatenate([np.zeros(n_features), np.full(n_features, beta), weight]),
        A_ub=np.block(
            [
                [-signed, np.zeros_like(signed), -np.eye(n_samples)],
                [eye, -eye, none],
                [-eye, -eye, none],
            ]
        ),
        b_ub=np.concatenate([np.full(n_samples, -margin), np.zeros(2 * n_features)]),
        bounds=[(-bound, bound)] * n_features + [(0, np.inf)] * (n_features + n_samples),
        solver=solver,
    )
    assert solution.status is Status.OPTIMAL
    return solution.objective


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("degree", [1, 2, 4])
@pytest.mark.parametrize("n_samples", [60, 700])
def test_value_equals_that_of_the_whole_program(kind, degree, n_samples):
    data = problem(kind, n_samples, degree)
    fit = fit_surface(*data, MARGIN, BETA, BOUND)
    assert fit.status is Status.OPTIMAL
    assert fit.objective == pytest.approx(one_shot(*data, MARGIN, BETA, BOUND), rel=1e-8)


@pytest.mark.parametrize("kind", KINDS)
def test_value_equals_clarabels(kind):
    # Clarabel stops at about 1e-8 of the coefficients' scale; beta is large enough to be seen.
    data = problem(kind, 300, 2)
    fit = fit_surface(*data, 0.1, 0.05, BOUND)
    assert fit.objective == pytest.approx(one_shot(*data, 0.1, 0.05, BOUND, "clarabel"), rel=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_optimality_by_duality(kind):
    """Feasible multipliers whose dual value meets the objective prove it optimal."""
    features, signs, weight = problem(kind, 3000, 3)
    fit = fit_surface(features, signs, weight, MARGIN, BETA, BOUND)
    margins = signs * (features @ fit.coef)
    slack = np.maximum(0.0, MARGIN - margins)
    assert (np.abs(fit.coef) <= BOUND).all()
    assert (fit.multipliers >= 0).all() and (fit.multipliers <= weight).all()
    pull = np.abs((fit.multipliers * signs) @ features)
    dual = MARGIN * fit.multipliers.sum() - BOUND * np.maximum(0.0, pull - BETA).sum()
    primal = weight @ slack + BETA * np.abs(fit.coef).sum()
    assert fit.objective == pytest.approx(primal, rel=1e-12)
    assert primal - dual <= 1e-8 * primal


def test_three_points_by_hand():
    # f(x) = a x, margin 1, points 1, 1 and -1/2 all positive. F(a) = 2 max(0, 1 - a) +
    # max(0, 1 + a/2) + beta |a| has slopes -3/2 + beta up to a = 1 and 1/2 + beta after it.
    x = np.array([[1.0], [1.0], [-0.5]])
    fit = fit_surface(x, np.ones(3), np.ones(3), margin=1.0, beta=0.25, bound=10.0)
    np.testing.assert_allclose(fit.coef, [1.0], atol=1e-12)
    assert fit.objective == pytest.approx(1.75, abs=1e-12)
    np.testing.assert_allclose(fit.multipliers.sum(), 1.75, atol=1e-9)


def test_the_box_binds():
    fit = fit_surface(np.array([[0.1]]), np.ones(1), np.ones(1), margin=1.0, beta=0.0, bound=2.0)
    np.testing.assert_allclose(fit.coef, [2.0], atol=1e-12)
    assert fit.objective == pytest.approx(0.8, abs=1e-12)


def test_large_beta_gives_the_zero_surface():
    features, signs, weight = problem("noisy", 500, 2)
    fit = fit_surface(features, signs, weight, MARGIN, 1e5, BOUND)
    np.testing.assert_array_equal(fit.coef, 0.0)
    assert fit.objective == pytest.approx(MARGIN * 500, rel=1e-12)


def test_without_sparsity_separable_data_cost_nothing():
    fit = fit_surface(*problem("separable", 1500, 4), MARGIN, 0.0, BOUND)
    assert fit.status is Status.OPTIMAL
    assert fit.objective <= 1e-9


def test_weights_are_repetitions():
    features, signs, _ = problem("noisy", 400, 2)
    counts = np.random.default_rng(1).integers(1, 4, size=400)
    weighted = fit_surface(features, signs, counts.astype(float), MARGIN, BETA, BOUND)
    repeated = fit_surface(
        np.repeat(features, counts, axis=0),
        np.repeat(signs, counts),
        np.ones(counts.sum()),
        MARGIN,
        BETA,
        BOUND,
    )
    assert weighted.objective == pytest.approx(repeated.objective, rel=1e-9)
    np.testing.assert_allclose(weighted.coef, repeated.coef, rtol=1e-6, atol=1e-9)


def test_homogeneity_in_weights_and_margin():
    # w -> c w with beta -> c beta scales the value; eps, eta -> c eps, c eta scales the surface.
    features, signs, weight = problem("noisy", 600, 2)
    fit = fit_surface(features, signs, weight, MARGIN, BETA, BOUND)
    heavier = fit_surface(features, signs, 1e3 * weight, MARGIN, 1e3 * BETA, BOUND)
    wider = fit_surface(features, signs, weight, 1e2 * MARGIN, BETA, 1e2 * BOUND)
    assert heavier.objective == pytest.approx(1e3 * fit.objective, rel=1e-9)
    np.testing.assert_allclose(wider.coef, 1e2 * fit.coef, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("kind", ["separable", "noisy", "lattice"])
def test_a_start_changes_nothing_but_the_time(kind):
    features, signs, weight = problem(kind, 1500, 3)
    cold = fit_surface(features, signs, weight, MARGIN, BETA, BOUND)
    for start in (cold.coef, np.zeros_like(cold.coef), np.full_like(cold.coef, 100.0)):
        warm = fit_surface(features, signs, weight, MARGIN, BETA, BOUND, start=start)
        assert warm.objective == pytest.approx(cold.objective, rel=1e-8)


def test_a_hundred_thousand_rows_need_a_small_program(monkeypatch):
    """The point of the working set: HiGHS sees a few rows for each coefficient."""
    import swsysid._surfaces.margin_program as surfaces

    columns = []

    def spy(cost, **kwargs):
        columns.append(len(cost))
        return linear_program(cost, **kwargs)

    monkeypatch.setattr(surfaces, "linear_program", spy)
    fit = fit_surface(*problem("noisy", 100_000, 2), MARGIN, BETA, BOUND)
    assert fit.status is Status.OPTIMAL
    assert max(columns) < 1000


def test_surfaces_fitted_together_are_those_fitted_alone():
    """Small and large programs, of one and of several rounds, from any starts."""
    kinds = [(kind, n_samples) for kind in KINDS for n_samples in (32, 152, 2500)]
    programs, alone = [], []
    for kind, n_samples in kinds:
        features, signs, weight = problem(kind, n_samples, 3)
        programs.append(MarginProgram(features * signs[:, None], weight, MARGIN, BETA, BOUND))
        alone.append(fit_surface(features, signs, weight, MARGIN, BETA, BOUND))
    for starts in ((), [fit.coef for fit in alone[::7]]):
        for program, fit, other in zip(
            programs, fit_programs(programs, starts=starts), alone, strict=True
        ):
            assert fit.status is Status.OPTIMAL
            assert fit.objective == pytest.approx(other.objective, rel=1e-8, abs=1e-12)
            value = program.objective(fit.coef, program.signed @ fit.coef)
            assert value == pytest.approx(fit.objective, rel=1e-12)
            assert program.dual_value(fit.multipliers) == pytest.approx(fit.lower_bound, rel=1e-12)


@pytest.mark.parametrize("kind", ["separable", "noisy", "weighted"])
def test_a_program_of_the_nearest_rows_is_the_whole_one_around_a_point(kind):
    features, signs, weight = problem(kind, 4000, 2)
    program = MarginProgram(features * signs[:, None], weight, MARGIN, BETA, BOUND)
    coef = approach(program)
    near = program.near(coef, 500)
    assert len(near.weight) <= 502
    rng = np.random.default_rng(0)
    for _ in range(5):
        other = coef * (1 + 1e-3 * rng.standard_normal(len(coef)))
        whole = program.objective(other, program.signed @ other)
        assert near.objective(other, near.signed @ other) == pytest.approx(whole, rel=1e-9)
        far = rng.standard_normal(len(coef))  # anywhere else it is a lower bound
        bound = program.objective(far, program.signed @ far) * (1 + 1e-12)
        assert near.objective(far, near.signed @ far) <= bound


def test_another_solver_gives_the_same_value():
    data = problem("noisy", 250, 2)
    ours, theirs = (fit_surface(*data, 0.1, 0.05, BOUND, solver=s) for s in ("auto", "clarabel"))
    assert theirs.status is Status.OPTIMAL
    assert theirs.objective == pytest.approx(ours.objective, rel=1e-6)


def test_a_missing_solver_gets_a_sentence():
    with pytest.raises(SolverError, match="not installed"):
        fit_surface(*problem("noisy", 50, 1), MARGIN, BETA, BOUND, solver="nonesuch")


def test_best_multiple_is_the_minimum_along_a_ray():
    features, signs, weight = problem("noisy", 300, 2)
    program = MarginProgram(features * signs[:, None], weight, MARGIN, BETA, BOUND)
    direction = np.linalg.lstsq(features, signs, rcond=None)[0]

    def value(coef):
        return program.objective(coef, program.signed @ coef)

    best = value(best_multiple(program, direction))
    factors = np.geomspace(1e-4, 1.0, 2001)
    assert best <= min(value(factor * direction) for factor in factors) + 1e-12


@pytest.mark.parametrize("kind", ["noisy", "weighted", "lattice"])
def test_the_descent_ends_near_the_optimum(kind):
    features, signs, weight = problem(kind, 5000, 2)
    program = MarginProgram(features * signs[:, None], weight, MARGIN, BETA, BOUND)
    near = approach(program)
    optimum = fit_surface(features, signs, weight, MARGIN, BETA, BOUND).objective
    assert optimum <= program.objective(near, program.signed @ near) <= 1.05 * optimum


def test_a_book_is_the_sum_of_its_surfaces_and_the_best_book_wins():
    rng = np.random.default_rng(0)
    X = rng.uniform(-1.0, 1.0, size=(300, 2))
    labels = 2 * (X[:, 0] > 0.1) + (X[:, 1] > -0.2)  # codes of two lines
    features, weight = PolynomialFeatures(1).fit_transform(X), np.ones(300)
    good = np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]])
    bad = good[[0, 1, 3, 2]]  # its second surface would have to be an exclusive or
    book, fits = fit_mode_book(features, labels, weight, [bad, good], MARGIN, BETA, BOUND)
    np.testing.assert_array_equal(book, good)
    for column, fit in zip(good.T, fits, strict=True):
        alone = fit_surface(features, 1.0 * column[labels], weight, MARGIN, BETA, BOUND)
        assert fit.objective == pytest.approx(alone.objective, rel=1e-12)


def test_worst_status():
    assert worst_status([]) is Status.OPTIMAL
    assert worst_status([Status.OPTIMAL, Status.INACCURATE]) is Status.INACCURATE


@pytest.mark.parametrize(("given", "decided"), [
    (np.array([3.0, -1.0]), [[-3.0, 3.0], [1.0, -1.0]]),
    (np.array([[1, 2, 0], [0, 0, 5]]), [[1.0, 2.0, 0.0], [0.0, 0.0, 5.0]]),
], ids=["of two classes in one column", "of three in three"])  # fmt: skip
def test_decisions_of_a_classifier_are_a_column_for_each_class(given, decided):
    surface = SimpleNamespace(decision_function=lambda X: given)
    np.testing.assert_array_equal(decisions_of(surface, None), decided)
    assert decisions_of(SimpleNamespace(), None) is None
