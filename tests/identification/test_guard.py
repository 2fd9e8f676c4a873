"""Where the switching is not a function of the state, the fit says so; elsewhere it does not."""

import warnings

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from sklearn.exceptions import ConvergenceWarning
from sklearn.tree import DecisionTreeClassifier

from swsysid import IdentificationWarning, PolynomialSurfaceClassifier, SwitchingSystemRegressor
from swsysid.datasets import make_damped_oscillator, make_quartic_oscillator, make_switching_network

NO_GUARD = "not a function of the state"
LAWS = np.array([[[0.0, 1.0], [-1.0, -0.1]], [[0.0, 1.0], [-2.0, -0.5]]])


def disturbed(Xdot, noise, random_state):
    return Xdot + noise * Xdot.std(axis=0) * random_state.standard_normal(Xdot.shape)


def telegraph(random_state, n_trajectories=10, n_steps=100, step=0.1, rate=0.5):
    """Two linear modes; a switch comes with the given rate, wherever the state is."""
    flows = [expm(step * law) for law in LAWS]
    X, modes = [], []
    for _ in range(n_trajectories):
        x, mode = random_state.uniform(-2, 2, 2), random_state.integers(2)
        for _ in range(n_steps):
            X.append(x)
            modes.append(mode)
            x = flows[mode] @ x
            mode ^= int(random_state.random() < rate * step)
    X = np.array(X)
    return X, np.einsum("nij,nj->ni", LAWS[modes], X)


def epidemic(random_state):
    """Susceptible, infected, recovered, daily; the infection rate depends on the season alone."""

    def velocity(t, x, rate):
        new, died = rate * x[0] * x[1] / 1000, x / 365
        return np.array([1000 / 365 - new, new - x[1] / 5, x[1] / 5]) - died

    starts = np.array([365 * year + day for year in range(5) for day in (0, 35, 155, 225)])
    X, Xdot, x = [], [], np.array([12.0, 13.0, 975.0])
    for k, (start, stop) in enumerate(zip(starts, [*starts[1:], 1825], strict=True)):
        rate = 9.336 / 1.8 if k % 2 == 0 else 9.336 * 1.8
        days = np.arange(start, stop + 1)
        path = solve_ivp(velocity, (start, stop), x, "LSODA", days, args=(rate,), rtol=1e-8).y.T
        X.extend(path[:-1])
        Xdot.extend(velocity(start, x, rate) for x in path[:-1])
        x = np.maximum(path[-1] + random_state.integers(-2, 3, 3), 0.0)
    return np.array(X), np.array(Xdot)


@pytest.mark.parametrize("noise", [0.0, 0.05])
@pytest.mark.parametrize("system, library", [(telegraph, None), (epidemic, 2)])
def test_switching_by_time_is_reported(system, library, noise):
    random_state = np.random.default_rng(0)
    X, Xdot = system(random_state)
    model = SwitchingSystemRegressor(feature_library=library, random_state=0)
    with pytest.warns(IdentificationWarning, match=NO_GUARD):
        model.fit(X, disturbed(Xdot, noise, random_state))
    # the epidemic settles in each season, so the state tells the season on most days
    assert model.guard_score_ < (0.7 if library is None else 0.99)


@pytest.mark.parametrize("disturbance", [{}, {"noise": 0.05}, {"outliers": 0.05}])
@pytest.mark.parametrize(
    "make, degree",
    [(make_damped_oscillator, 1), (make_quartic_oscillator, 4), (make_switching_network, 2)],
)
def test_a_guard_is_recognised(make, degree, disturbance):
    data = make(1200, random_state=1, **disturbance)
    model = SwitchingSystemRegressor(
        feature_library=data.library_degree,
        surface=PolynomialSurfaceClassifier(degree=degree),
        random_state=0,
    ).fit(data.X, data.Xdot)  # warnings are errors
    assert model.guard_score_ > 0.995


def test_a_surface_of_too_low_a_degree_is_no_proof():
    data = make_switching_network(2000, random_state=0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        model = SwitchingSystemRegressor(
            feature_library=2,
            surface=PolynomialSurfaceClassifier(degree=1),
            coupling=0,
            random_state=0,
        ).fit(data.X, data.Xdot)
    assert model.surface_.score(data.X, model.modes_) < 0.9  # no plane is a sphere
    assert model.guard_score_ < 0.9


def test_a_flexible_surface_is_judged_on_held_out_samples():
    X, Xdot = telegraph(np.random.default_rng(1))
    model = SwitchingSystemRegressor(surface=DecisionTreeClassifier(random_state=0), random_state=0)
    with pytest.warns(IdentificationWarning, match=NO_GUARD):
        model.fit(X, Xdot)
    assert model.surface_.score(X, model.modes_) == 1.0  # learned by heart


def test_one_mode_has_no_guard_to_judge():
    X = np.random.default_rng(0).normal(size=(50, 2))
    assert np.isnan(SwitchingSystemRegressor(n_modes=1).fit(X, X).guard_score_)


def test_an_answer_found_once_or_with_a_rival_is_reported():
    data = make_quartic_oscillator(400, noise=0.2, random_state=0)
    model = SwitchingSystemRegressor(
        feature_library=3, surface=PolynomialSurfaceClassifier(degree=4), n_init=32, random_state=0
    )
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model.fit(data.X, data.Xdot)
    said = " ".join(str(w.message) for w in caught if w.category is ConvergenceWarning)
    assert "found by only 1 of 32 starts" in said
    assert "another partition of the samples into modes explains them as well" in said
