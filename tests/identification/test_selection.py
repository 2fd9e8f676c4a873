"""The number of modes: planted ones are counted, and one law stays one mode."""

from types import SimpleNamespace

import numpy as np
import pytest

from swsysid import SwitchingSystemRegressor
from swsysid._identification.number_of_modes import (
    ModeCandidate,
    _costs,
    _exhausted,
    _Part,
    _split,
    _standard_error,
    compare_mode_counts,
    smallest_sufficient,
)
from swsysid._noise import robust_scale

FIELDS = np.array(
    [[[1, 0.5, -1], [0, 1, 1]], [[-1, -1, 0], [1, 0, -1]], [[0, 1, 1], [-2, 0, 0]]], dtype=float
)
# number of modes, degree of the gate, region of each mode
REGIONS = {
    "one": (1, 2, lambda x: np.zeros(len(x), dtype=int)),
    "half": (2, 1, lambda x: (x[:, 0] + 0.3 * x[:, 1] > 0.2).astype(int)),
    "circle": (2, 2, lambda x: (np.square(x).sum(axis=1) > 1.2).astype(int)),
    "sectors": (3, 1, lambda x: np.floor(3 * (0.5 + np.arctan2(*x.T) / (2 * np.pi))).astype(int)),
}
NOISE = {
    "none": lambda x, rng: np.zeros((len(x), 2)),
    "normal": lambda x, rng: rng.standard_normal((len(x), 2)),
    "uniform": lambda x, rng: rng.uniform(-1, 1, (len(x), 2)),
    "heavy": lambda x, rng: rng.standard_t(3, (len(x), 2)),
    "uneven": lambda x, rng: np.abs(x[:, :1]) * rng.standard_normal((len(x), 2)),
    "outliers": lambda x, rng: (
        100 * (rng.random((len(x), 1)) < 0.05) * rng.standard_normal((len(x), 2))
    ),
}


def planted(region, noise="normal", n_samples=800, seed=0):
    """Problem and search of affine fields on planted regions, and the number of modes."""
    rng = np.random.default_rng(seed)
    n_modes, degree, modes = REGIONS[region]
    x = rng.uniform(-2, 2, (n_samples, 2))
    features = np.column_stack([np.ones(n_samples), x])
    targets = np.einsum("nkp,np->nk", FIELDS[modes(x)], features)
    problem = SimpleNamespace(
        features=features,
        targets=targets + 0.1 * NOISE[noise](x, rng),
        coordinates=x,
        weight=np.ones(n_samples),
        settings=SwitchingSystemRegressor.settings,
    )
    search = SimpleNamespace(
        trajectory=np.zeros(n_samples, dtype=np.intp),
        parameters=SimpleNamespace(max_modes=6),
        gate_degree=degree,
    )
    return problem, search, n_modes


def compared(problem, search, seed=0):
    return compare_mode_counts(problem, search, np.random.RandomState(seed))


@pytest.mark.parametrize("noise", NOISE)
@pytest.mark.parametrize("region", REGIONS)
def test_planted_modes_are_counted(region, noise):
    problem, search, n_modes = planted(region, noise)
    assert smallest_sufficient(compared(problem, search)) == n_modes


def test_noise_that_depends_on_the_state_is_no_mode():
    problem, search, _ = planted("one", "uneven", seed=1)
    inputs, rng = np.square(problem.coordinates[:, :1]), np.random.default_rng(9)
    problem.targets = problem.targets + 0.3 * inputs * rng.uniform(-1, 1, problem.targets.shape)
    assert smallest_sufficient(compared(problem, search)) == 1


def test_more_than_two_modes_beyond_the_best_are_not_tried():
    problem, search, _ = planted("half")
    assert [candidate.n_modes for candidate in compared(problem, search)] == [1, 2, 3, 4]
    search.parameters.max_modes = 1
    assert [candidate.n_modes for candidate in compared(problem, search)] == [1]


def test_candidates_do_not_depend_on_units():
    problem, search, _ = planted("circle")
    plain = compared(problem, search)
    problem.features = problem.features * [1, 1e2, 1e-3]
    problem.coordinates = problem.coordinates * [1e2, 1e-3]
    problem.targets = problem.targets * [1e3, 1e-2]
    for first, second in zip(plain, compared(problem, search), strict=True):
        # EM stops within 5e-3 nats an iteration
        assert second.cost == pytest.approx(first.cost, abs=0.1)


def test_many_rows_are_thinned():
    problem, search, n_modes = planted("sectors", n_samples=30_000)
    candidates = compared(problem, search)
    assert smallest_sufficient(candidates) == n_modes
    assert (
        candidates[0].cost <= 3.05 * 3000
    )  # hardly more than three nats for each of 3000 rows at most


@pytest.mark.parametrize("n_samples", [1, 2, 3, 5, 12])
def test_few_samples_have_few_modes(n_samples):
    problem, search, _ = planted("half", n_samples=n_samples)
    assert smallest_sufficient(compared(problem, search)) <= 2


def test_weights_are_repetitions():
    rng = np.random.default_rng(3)
    X = rng.uniform(-2, 2, (150, 2))
    Xdot = np.where(X[:, :1] > 0, X @ FIELDS[0, :, 1:].T, X @ FIELDS[1, :, 1:].T)
    weight = rng.integers(0, 3, 150)
    model = SwitchingSystemRegressor(n_modes="auto", max_modes=3, random_state=0)
    weighted = model.fit(X, Xdot, sample_weight=weight).mode_selection_
    repeated = model.fit(np.repeat(X, weight, axis=0), np.repeat(Xdot, weight, axis=0))
    assert weighted == repeated.mode_selection_


class TestByHand:
    def test_costs(self):
        residuals = [np.array([[0.0], [2.0], [4.0]]), np.array([[1.0], [-1.0], [1e9]])]
        costs = _costs(residuals, np.ones(3))
        scale = robust_scale(np.array([1.0]))  # the smaller of the medians, 2 and 1
        likelihood = [np.exp(-0.5 * (size / scale) ** 2) for size in (0.0, 2.0, 4.0)]
        expected = [np.log((1 + np.exp(-3)) / (each + np.exp(-3))) for each in likelihood]
        np.testing.assert_allclose(costs[0], expected, rtol=1e-12, atol=1e-15)
        assert costs[1][2] == pytest.approx(np.log1p(np.exp(3)))

    def test_five_outputs_cost_up_to_five_nats(self):
        costs = _costs([np.zeros((3, 5)), np.ones((3, 5))], np.ones(3))
        np.testing.assert_allclose(costs[1], np.log1p(np.exp(5)))

    def test_exact_residuals_are_not_compared(self):
        costs = _costs([np.full((3, 1), 1e-12), np.full((3, 1), 1e-9)], np.ones(3))
        # rounding errors against a scale of 1e-4
        np.testing.assert_allclose(costs, 0.0, atol=1e-9)

    @pytest.mark.parametrize(
        ("trajectory", "expected"),
        [([0, 1, 2, 3], 2.0), ([0, 0, 1, 1], np.sqrt(8.0)), ([0, 0, 0, 0], 2.0)],
    )
    def test_standard_error_of_rows_and_of_trajectories(self, trajectory, expected):
        part = _Part(*[None] * 2, weight=np.ones(4), trajectory=np.array(trajectory))
        assert _standard_error(np.array([3.0, 3, 1, 1]), part) == pytest.approx(expected)

    def test_search_ends_when_neither_cost_nor_likelihood_gains(self):
        # one to three laws may predict badly, and three no better than one
        assert not _exhausted([5.0, 6.0, 7.0], [9.0, 8.0, 7.0])
        assert not _exhausted([5.0, 6.0], [5.0, 6.0])
        assert _exhausted([5.0, 6.0, 7.0], [5.0, 6.0, 7.0])
        assert _exhausted([5.0, 6.0, 7.0, 4.0, 8.0, 9.0], [9.0, 8.0, 7.0, 6.0, 7.0, 6.5])

    def test_smallest_sufficient(self):
        shares = [(1, 9.0, 3.0), (2, 8.0, 3.5), (3, 0.0, 0.0)]
        candidates = tuple(ModeCandidate(n, 10.0 + d, d, error) for n, d, error in shares)
        assert [candidate.sufficient for candidate in candidates] == [False, True, True]
        assert smallest_sufficient(candidates) == 2
        assert smallest_sufficient(()) == 1


def test_whole_trajectories_are_held_out():
    problem, search, _ = planted("half")
    search.trajectory = np.repeat(np.arange(8), 100)
    train, test = _split(problem, search.trajectory, np.random.RandomState(0))
    assert len(np.unique(test.trajectory)) == 2
    assert not np.intersect1d(train.trajectory, test.trajectory).size
    assert len(train.weight) + len(test.weight) == 800
