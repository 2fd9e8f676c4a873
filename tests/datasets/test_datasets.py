"""Generated data: equations written out anew, exact truth, reproducible noise."""

import numpy as np
import pytest
from sklearn.preprocessing import PolynomialFeatures

from swsysid._results import Status
from swsysid.datasets import make_damped_oscillator, make_quartic_oscillator, make_switching_network
from swsysid.datasets._generated import integrate_grid

# short, so that every test makes its own
SMALL = dict(n_trajectories=25, t_end=2.0, random_state=0)


def _quartic_code(*args, **kwargs):
    return make_quartic_oscillator(*args, variant="code", **kwargs)


MAKERS = [make_damped_oscillator, make_quartic_oscillator, _quartic_code, make_switching_network]
every_maker = pytest.mark.parametrize("make", MAKERS)


def _laplacian_inside(x):
    return np.array([2 * x[0] - x[1] - x[2], 2 * x[1] - x[0] - x[2], 2 * x[2] - x[0] - x[1]])


def _laplacian_outside(x):
    return np.array([x[0] - x[1], x[1] - x[2], x[2] - x[0]])


def _damped_oscillator(z):
    x, v = z
    return np.array([v, -x - (0.1 if x >= 0 else 0.5) * v])


def _energy(x, y):
    return y**2 / 2 + x**2 / 2 + 0.3 / 4 * x**4


def _quartic(z, exchanged=False):
    x, y = z
    low = _energy(x, y) <= 3.0
    common = -x - 0.3 * x**3 - 0.1 * y**3
    if low != exchanged:
        return np.array([y, common - 0.1 + 0.2 * x**2 + 0.3 * x * y])
    return np.array([y, common + 0.1 * x * y + 0.1 * x**2 - 0.1 * y])


def _network(x):
    law = _laplacian_inside if x @ x <= 9.0 else _laplacian_outside
    return -0.1 * x + 0.01 * x**2 - law(x)


LAWS = dict(
    zip(
        MAKERS,
        [_damped_oscillator, _quartic, lambda z: _quartic(z, exchanged=True), _network],
        strict=True,
    )
)


@every_maker
def test_velocities_are_those_of_the_written_equations(make):
    data = make(800, **SMALL)
    assert 0 < data.modes.sum() < 800  # both sides of the guard are seen
    np.testing.assert_allclose(data.Xdot, [LAWS[make](x) for x in data.X], atol=1e-12)


@pytest.mark.parametrize(
    ("make", "state", "velocity", "mode"),
    [
        (make_damped_oscillator, [2.0, 1.0], [1.0, -2.1], 0),
        (make_damped_oscillator, [-2.0, 1.0], [1.0, 1.5], 1),
        (make_damped_oscillator, [0.0, 1.0], [1.0, -0.1], 0),
        # E = 0.5 + 0.5 + 0.075; -1 - 0.3 - 0.1 - 0.1 + 0.2 + 0.3
        (make_quartic_oscillator, [1.0, 1.0], [1.0, -1.0], 0),
        # -1 - 0.3 - 0.1 + 0.1 + 0.1 - 0.1
        (_quartic_code, [1.0, 1.0], [1.0, -1.3], 0),
        # E = 4.5; -2.7 - 0.3
        (make_quartic_oscillator, [0.0, 3.0], [3.0, -3.0], 1),
        (_quartic_code, [0.0, 3.0], [3.0, -2.8], 1),
        # -0.1 + 0.01 - 2, then 1 - ... to the others
        (make_switching_network, [1.0, 0.0, 0.0], [-2.09, 1.0, 1.0], 0),
        (make_switching_network, [4.0, 0.0, 0.0], [-4.24, 0.0, 4.0], 1),
    ],
)
def test_laws_at_points_worked_out_by_hand(make, state, velocity, mode):
    system = make(10, **SMALL).system
    np.testing.assert_allclose(system.velocities([state]), [velocity], atol=1e-12)
    assert system.modes(np.array([state])).tolist() == [mode]


@every_maker
def test_coefficients_and_guard_are_in_scikit_learns_order(make):
    data = make(400, **SMALL)
    features = (
        data.X
        if data.library_degree is None
        else PolynomialFeatures(data.library_degree).fit_transform(data.X)
    )
    every = np.einsum("mkp,np->mnk", data.coef, features)
    np.testing.assert_allclose(data.Xdot, every[data.modes, np.arange(400)], atol=1e-12)
    others = 1 - data.modes
    velocities = data.system.velocities(data.X, others)
    np.testing.assert_allclose(velocities, every[others, np.arange(400)], atol=1e-12)
    guard = PolynomialFeatures(data.guard_degree).fit_transform(data.X) @ data.guard_coef
    np.testing.assert_allclose(data.guard(data.X), guard, atol=1e-12)
    np.testing.assert_array_equal(data.modes, guard > 0)


def test_guards_are_the_papers():
    X = np.random.default_rng(0).uniform(-4, 4, size=(50, 2))
    np.testing.assert_allclose(make_damped_oscillator(9, **SMALL).guard(X), -X[:, 0])
    quartic = make_quartic_oscillator(9, **SMALL)
    np.testing.assert_allclose(quartic.guard(X), _energy(*X.T) - 3.0, atol=1e-12)
    X = np.random.default_rng(0).uniform(-4, 4, size=(50, 3))
    network = make_switching_network(9, **SMALL)
    np.testing.assert_allclose(network.guard(X), np.sum(X**2, axis=1) - 9.0, atol=1e-12)


def test_the_two_variants_exchange_the_fields_and_nothing_else():
    paper, code = make_quartic_oscillator(9, **SMALL), _quartic_code(9, **SMALL)
    np.testing.assert_array_equal(paper.coef, code.coef[::-1])
    np.testing.assert_array_equal(paper.guard_coef, code.guard_coef)
    np.testing.assert_array_equal(paper.x0, code.x0)
    with pytest.raises(ValueError, match="'paper' or 'code'"):
        make_quartic_oscillator(variant="text")


def test_network_laplacians_have_zero_row_sums():
    laplacians = -make_switching_network(9, **SMALL).coef[:, :, 1:4] - 0.1 * np.eye(3)
    np.testing.assert_allclose(laplacians.sum(axis=2), 0.0, atol=1e-15)
    np.testing.assert_allclose(laplacians[0], 3 * np.eye(3) - 1)
    np.testing.assert_allclose(laplacians[1], np.eye(3) - np.roll(np.eye(3), 1, axis=1))


@every_maker
def test_shapes_order_and_distinct_rows(make):
    data = make(700, **SMALL)
    n_states = data.coef.shape[1]
    assert data.X.shape == data.Xdot.shape == (700, n_states)
    assert data.data is data.X and data.target is data.Xdot
    assert data.t.shape == data.groups.shape == data.modes.shape == (700,)
    assert data.x0.shape == (25, n_states)
    assert len(data.feature_names) == len(data.target_names) == n_states
    assert set(np.diff(data.groups)) <= set(range(26))
    within = np.diff(data.groups) == 0
    assert (np.diff(data.t)[within] > 0).all()  # in time order, none twice
    # times lie on the grid
    np.testing.assert_allclose(data.t / 0.01, np.round(data.t / 0.01), atol=1e-9)
    X, Xdot = make(700, return_X_y=True, **SMALL)
    np.testing.assert_array_equal(X, data.X)
    np.testing.assert_array_equal(Xdot, data.Xdot)


@every_maker
def test_samples_are_a_subset_of_all_points(make):
    grid = SMALL | dict(t_end=1.0, time_step=0.1)
    pool, some = make(None, **grid), make(100, **grid)
    assert pool.X.shape[0] == 25 * 11
    np.testing.assert_array_equal(pool.X[pool.t == 0.0], pool.x0)
    rows = some.groups * 11 + np.round(some.t / 0.1).astype(int)
    np.testing.assert_array_equal(some.X, pool.X[rows])


@every_maker
def test_the_same_number_gives_the_same_data_and_another_does_not(make):
    first, again = (
        make(200, noise=0.1, outliers=0.1, **SMALL),
        make(200, noise=0.1, outliers=0.1, **SMALL),
    )
    np.testing.assert_array_equal(first.X, again.X)
    np.testing.assert_array_equal(first.Xdot, again.Xdot)
    clean = make(200, **SMALL)
    np.testing.assert_array_equal(first.X, clean.X)
    np.testing.assert_array_equal(first.Xdot_clean, clean.Xdot)
    other = make(200, **(SMALL | dict(random_state=1)))
    assert not np.array_equal(first.X, other.X)


@every_maker
def test_noise_and_outliers_have_the_stated_sizes(make):
    n_samples = 20000
    grid = dict(n_trajectories=100, t_end=2.0, random_state=3)
    spread = make(n_samples, **grid).Xdot.std(axis=0)
    noisy = make(n_samples, noise=0.05, **grid)
    relative = (noisy.Xdot - noisy.Xdot_clean) / spread
    # standard error of a standard deviation: 1 / (2 n)^(1/2), half a percent of it; five of them
    np.testing.assert_allclose(relative.std(axis=0), 0.05, rtol=0.025)
    assert not noisy.is_outlier.any()
    hit = make(n_samples, outliers=0.1, **grid)
    assert hit.is_outlier.sum() == n_samples // 10
    error = (hit.Xdot - hit.Xdot_clean) / spread
    assert not error[~hit.is_outlier].any()
    # 2000 rows: 1.6 percent; five of them
    np.testing.assert_allclose(error[hit.is_outlier].std(axis=0), 5.0, rtol=0.08)


@every_maker
def test_grid_states_lie_on_the_true_rollouts(make):
    data = make(None, n_trajectories=5, t_end=4.0, random_state=2)
    switches = 0
    for group in range(5):
        rows = data.groups == group
        rollout = data.system.simulate(data.x0[group], data.t[rows], rtol=1e-10, atol=1e-12)
        assert rollout.status is Status.COMPLETED
        switches += len(rollout.events)
        np.testing.assert_allclose(data.X[rows], rollout.x, atol=1e-5)
    assert switches >= 3  # so that the accuracy above includes switches


def test_the_grid_is_of_fourth_order_across_a_switch():
    system = make_damped_oscillator(9, **SMALL).system
    x0 = np.array([[1.0, 0.5], [2.0, -1.0]])
    exact = [system.simulate(x, [0.0, 8.0], rtol=1e-12, atol=1e-13).x[-1] for x in x0]
    errors = [
        np.abs(integrate_grid(system, x0, n_steps, 8.0 / n_steps)[:, -1] - exact).max()
        for n_steps in (100, 200)
    ]
    assert errors[0] / errors[1] > 10  # 16 but for where the cuts fall; 2 without cuts


def test_energy_falls_along_the_damped_oscillator():
    data = make_damped_oscillator(None, n_trajectories=4, t_end=5.0, random_state=0)
    energy = np.sum(data.X**2, axis=1).reshape(4, -1) / 2
    assert (np.diff(energy, axis=1) < 1e-9).all()


@pytest.mark.parametrize("variant", ["paper", "code"])
def test_four_to_nine_percent_of_the_quartic_samples_are_in_the_minority_mode(variant):
    fractions = [
        make_quartic_oscillator(None, variant=variant, time_step=0.04, random_state=s).modes.mean()
        for s in range(3)
    ]
    assert 0.04 < min(fractions) and max(fractions) < 0.09


@every_maker
def test_no_sample_sits_on_the_guard(make):
    # switches are located but never recorded: the nearest of 2000 samples is as far from the
    # guard as chance has it
    data = make(2000, n_trajectories=60, t_end=3.0, random_state=0)
    assert np.abs(data.guard(data.X)).min() > 1e-6


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (dict(n_samples=10**6), "increase n_trajectories"),
        (dict(n_samples=0), "n_samples=0 must be a positive integer or None"),
        (dict(n_trajectories=0), "n_trajectories=0 must be a positive integer"),
        (dict(t_end=0.001), "longer than one time_step"),
        (dict(noise=-0.1), "noise=-0.1 must be a non-negative number"),
        (dict(outliers=1.5), "outliers=1.5 must be a number at least 0 and at most 1"),
    ],
)
def test_bad_arguments_get_a_sentence(arguments, sentence):
    with pytest.raises(ValueError, match=sentence):
        make_damped_oscillator(**arguments)


def test_a_description_tells_the_law():
    assert "energy" in make_quartic_oscillator(9, **SMALL).DESCR
