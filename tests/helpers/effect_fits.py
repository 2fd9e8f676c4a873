"""Fits with given laws and effects, made by hand, for the tests of their rollouts.

The declared model is fitted to its own exact velocities, and the effects' coefficients are given.
"""

import numpy as np
from scipy.integrate import solve_ivp

from swsysid import SwitchingSystemRegressor
from swsysid._effect_model.joint_fit import JointFit
from swsysid.effects import GuardHysteresis, PlacedEffect
from swsysid.effects._guards import Guard

TIGHT = {"rtol": 1e-11, "atol": 1e-12, "max_step": 0.01}


def fit_by_hand(laws, terms=(), coef=(), guard=None, discrete=False):
    """A fit with given laws, (n_modes, n_states, n_states + n_inputs + 1), constant last."""
    laws = np.atleast_3d(np.asarray(laws, dtype=float))
    rng = np.random.default_rng(0)
    X = rng.uniform(-1, 1, (400, laws.shape[2] - 1))
    modes = np.zeros(len(X), int) if guard is None else (guard(X) > 0).astype(int)
    features = np.column_stack([X, np.ones(len(X))])
    Xdot = np.einsum("nkf,nf->nk", laws[modes], features)
    start = {} if guard is None else {"init": modes}
    estimator = SwitchingSystemRegressor(
        n_modes=len(laws), feature_library=1, discrete_time=discrete, random_state=0, **start
    ).fit(X, Xdot)
    return JointFit(estimator, tuple(terms), tuple(map(np.array, coef)), estimator.modes_)


MASS = [[[0.0, 1.0, 0.0, 0.0], [-4.0, -0.5, 1.0, 0.0]]]  # x' = v, v' = -4 x - v / 2 + u
FREE = [[[0.0, 1.0, 0.0], [0.0, 0.0, 0.0]]]  # x' = v, v' = 0


def reference(right, x0, t):
    solved = solve_ivp(right, (t[0], t[-1]), x0, t_eval=t, **TIGHT)
    return solved.y.T


def drive(t):
    return np.sin(1.3 * t) + 0.5 * np.cos(3.1 * t)


T = np.linspace(0.0, 6.0, 121)
U = drive(T)


def relay(low, high, terms=(), coef=()):
    """x' = 1 below the band, -1 above it; the surface itself is at x = 0."""
    laws = [[[0.0, 1.0]], [[0.0, -1.0]]]
    fit = fit_by_hand(laws, guard=lambda X: X[:, 0])
    upper = int(fit.estimator.predict_modes([[0.5]])[0])
    guard = Guard(terms=((0,),), weights=(1.0,), upper_mode=upper)
    term = PlacedEffect(GuardHysteresis(), guard, 0, theta=(low, high))
    return JointFit(fit.estimator, (term, *terms), (np.zeros(0), *coef), fit.modes), upper
