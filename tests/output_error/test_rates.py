"""Effects on rates as a whole in recordings: they are told, simulated and fitted."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from swsysid import EffectRegressor, EffectSearchCV, SwitchingSystemRegressor
from swsysid._data.records import make_records
from swsysid._output_error.estimate import fitted
from swsysid._output_error.law import Law
from swsysid._output_error.stretches import Stretches
from swsysid.effects import EndStop, PlacedEffect, RateLimit, Stick

T = np.linspace(0.0, 20.0, 801)


def drive(t):
    """Two sines that have no period in common."""
    return np.sin(1.3 * t) + 0.7 * np.sin(0.41 * t + 1.0)


def recording(rate, highest=np.inf, noise=0.004, seed=0, groups=3):
    """x' = rate(2 (u - x)) below a highest x, stepped ten thousand times, in three recordings."""
    rng, parts = np.random.default_rng(seed), []
    for run in range(groups):
        fine = np.linspace(T[0], T[-1], 20 * (len(T) - 1) + 1)
        u, x = drive(fine + 7.0 * run), np.zeros(len(fine))
        for k in range(len(fine) - 1):  # Euler's method: the error is a thousandth of the noise
            x[k + 1] = min(x[k] + (fine[1] - fine[0]) * rate(2.0 * (u[k] - x[k])), highest)
        parts.append(np.column_stack([x, u])[::20])
    X = np.vstack(parts)
    noisy = X[:, 0] + noise * rng.standard_normal(len(X))
    return noisy[:, None], X[:, 1:], np.tile(T, groups), np.repeat(np.arange(groups), len(T))


STUCK = recording(lambda f: f - np.clip(f, -0.8, 0.8))
LIMITED = recording(lambda f: np.clip(f, -0.6, 0.6))
STOPPED = recording(lambda f: f, highest=0.5)


@pytest.mark.parametrize(
    ("data", "kind", "name", "value"),
    [
        (STUCK, "stick", "threshold", 0.8),
        (LIMITED, "rate_limit", "limit", 0.6),
        (STOPPED, "end_stop", "level", 0.5),
    ],
    ids=["stick", "rate limit", "end stop"],
)
def test_a_rate_as_a_whole_is_told(data, kind, name, value):
    states, inputs, t, groups = data
    search = EffectSearchCV(SwitchingSystemRegressor(1, feature_library=1, random_state=0))
    search.fit(states, t=t, groups=groups, inputs=inputs)
    [found] = search.effects_
    assert found.kind == kind
    # the noise is a hundredth of the spread, and of 2400 samples
    assert found.parameters[name] == pytest.approx(value, rel=0.02)
    low, high = found.intervals[name]
    assert low < value < high
    assert high - low < 0.1 * value
    # a rollout errs by the noise of the sensor, .004, and little more
    [_, outside] = [one["held_out"][0] for one in search.report_["errors"]]
    assert outside == pytest.approx(0.004, rel=0.1)


@pytest.mark.parametrize(
    ("data", "term", "law"),
    [
        (STUCK, PlacedEffect(Stick(), 0, 0, theta=(0.8,)), lambda f, x: f - np.clip(f, -0.8, 0.8)),
        (
            LIMITED,
            PlacedEffect(RateLimit(), 0, 0, theta=(0.6,)),
            lambda f, x: np.clip(f, -0.6, 0.6),
        ),
        (
            STOPPED,
            PlacedEffect(EndStop(), (0, "highest"), 0, theta=(0.5,)),
            lambda f, x: np.where((x >= 0.5) & (f > 0.0), 0.0, f),
        ),
    ],
    ids=["stick", "rate limit", "end stop"],
)
def test_velocities_fit_the_law_under_it_and_simulate_as_scipy_does(data, term, law):
    states, inputs, t, groups = recording_without_noise(data)
    X = np.hstack([states, inputs])
    velocities = law(2.0 * (inputs - states), states)
    model = EffectRegressor(SwitchingSystemRegressor(1, feature_library=1), [term])
    model.fit(X, velocities, t=t, groups=groups)
    coef = model.joint_fit_.laws.coef[0, 0]
    assert coef == pytest.approx([0.0, -2.0, 2.0], abs=1e-3)  # the alternation ends at 1e-6
    own = slice(0, len(T))
    rollout = model.simulate([0.0], T, inputs=inputs[own], input_hold="linear", rtol=1e-8)
    exact = solve_ivp(
        lambda t, x: law(2.0 * (np.interp(t, T, inputs[own, 0]) - x), x),
        (T[0], T[-1]), [0.0], t_eval=T, max_step=0.005, rtol=1e-8, atol=1e-10,
    )  # fmt: skip
    # steps end no nearer to where a rate bends than the solvers' own
    assert np.abs(rollout.x[:, 0] - exact.y[0]).max() < 2e-3


def recording_without_noise(data):
    """The same inputs, and states on lines that pass all that the law says."""
    _, inputs, t, groups = data
    states = 0.8 * np.sin(2.0 * t + groups)[:, None]
    states[states[:, 0] > 0.5] = 0.5
    return states, inputs, t, groups


def test_a_state_is_held_at_its_bound_and_leaves_it_where_the_law_leads_back():
    t = np.linspace(0.0, 8.0, 161)
    u = np.where(t < 4.0, 1.0, -1.0)
    # x' = u with a stop at 1: by hand x = t until 1, rests until 4, then 5 - t
    exact = np.where(t < 1.0, t, np.where(t < 4.0, 1.0, 5.0 - t))
    records = make_records(np.column_stack([exact, u]), 1, t=t, groups=np.zeros(161), names="xu")
    stretches = Stretches.of(records, records, np.arange(161))
    law = Law.of(lambda X: X[:, 1:], np.ones((1, 1), dtype=bool), np.zeros((1, 1)))
    stop = PlacedEffect(EndStop(), (0, "highest"), 0, theta=(1.0,))
    fit = fitted(law.beside([stop]), stretches)
    assert fit.law.coef[0, 0] == pytest.approx(1.0, abs=0.02)  # the input turns between two samples
    assert np.nanmax(np.abs(fit.left)) < 0.03
