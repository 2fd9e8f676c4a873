"""Positions alone: their velocities are hidden, and what a filter makes of them decides nothing."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import least_squares

from swsysid import EffectSearchCV, FunctionLibrary, SwitchingSystemRegressor
from swsysid._data.records import make_records
from swsysid._output_error.estimate import fitted, left_over, rolled_out
from swsysid._output_error.law import Law
from swsysid._output_error.stretches import Stretches
from swsysid.effects import (
    CoulombFriction,
    DeadZone,
    Lag,
    Polynomial,
    QuadraticDrag,
    Trigonometric,
)

NOISE = 0.003
RIGIDLY = 1e-3  # of the noise, that a law may be disturbed: all but none


def swinging(friction=0.0, period=3.0, step=0.02, n_rows=800, releases=(1.0, -0.8, 0.6), seed=0):
    """q'' = -w^2 q - 0.05 q' - friction sign(q'), from rest, measured with noise and in steps.

    Between two turns the motion is that of a linear law about a shifted centre, in closed form.
    """
    rng, parts = np.random.default_rng(seed), []
    t, law = step * np.arange(n_rows), np.array([[0.0, 1.0], [-((2 * np.pi / period) ** 2), -0.05]])
    half = np.pi / np.sqrt(-law[1, 0] - 0.025**2)
    for release in releases:
        q, state, begin, side = np.empty(n_rows), np.array([release, 0.0]), 0.0, -np.sign(release)
        while begin <= t[-1]:
            centre = np.array([side * friction / law[1, 0], 0.0])
            for k in np.flatnonzero((t >= begin) & (t < begin + half)):
                q[k] = (centre + expm(law * (t[k] - begin)) @ (state - centre))[0]
            state = centre + expm(law * half) @ (state - centre)
            begin, side = begin + half, -side
        parts.append(np.round((q + NOISE * rng.standard_normal(n_rows)) / 0.002) * 0.002)
    return np.concatenate(parts)[:, None], np.tile(t, 3), np.repeat(np.arange(3), n_rows)


def stretches_of(q, t, groups, speeds):
    """All rows of positions with these speeds beside them, of a law that is hardly disturbed."""
    records = make_records(np.hstack([q, speeds]), 2, t=t, groups=groups, names=["q", "v"])
    records = replace(records, n_hidden=1)
    return replace(Stretches.of(records, records, np.arange(len(q))), disturbance=RIGIDLY)


def oscillator():
    """v' = a q + b v, with q' = v known."""
    sought = np.array([[False, False], [True, True]])
    return Law.of(lambda X: X, sought, np.array([[0.0, 1.0], [0.0, 0.0]]))


def test_coefficients_are_those_of_an_independent_least_squares():
    q, t, groups = swinging(n_rows=200)
    stretches = stretches_of(q, t, groups, np.gradient(q[:, 0], 0.02)[:, None])

    def left(unknowns):
        one_step = expm(0.02 * np.array([[0.0, 1.0], unknowns[:2]]))
        misfits = []
        for part, start in zip(stretches.parts, unknowns[2:].reshape(-1, 2), strict=True):
            states = [start]
            for _ in part[1:]:
                states.append(one_step @ states[-1])
            misfits.append(np.array(states)[:, 0] - q[part, 0])
        return np.concatenate(misfits)

    begin = np.append([-4.0, 0.0], [[q[part[0], 0], 0.0] for part in stretches.parts])
    expected = least_squares(left, begin, x_scale="jac")
    fit = fitted(oscillator(), stretches)
    # by the disturbance they differ by a part of a standard error, which is .003 of the first
    np.testing.assert_allclose(fit.law.coef[1], expected.x[:2], atol=5e-4)
    assert fit.errors == pytest.approx([np.sqrt(np.mean(expected.fun**2))], rel=1e-3)


def test_speeds_that_a_filter_guesses_wrong_change_nothing():
    q, t, groups = swinging()
    good = np.gradient(q[:, 0], 0.02)[:, None]
    wrong = good + 0.3 * np.random.default_rng(1).standard_normal(good.shape)
    fits = [fitted(oscillator(), stretches_of(q, t, groups, one)) for one in (good, wrong)]
    coef, other = (fit.law.coef[1] for fit in fits)
    np.testing.assert_allclose(coef, other, atol=2e-4)  # a tenth of a standard error


def test_what_is_left_is_of_positions_alone():
    q, t, groups = swinging()
    stretches = stretches_of(q, t, groups, np.gradient(q[:, 0], 0.02)[:, None])
    fit = fitted(oscillator(), stretches)
    assert fit.errors.shape == (1,)
    for samples in (left_over(fit, stretches).samples, rolled_out(fit, stretches)):
        assert samples.shape == (len(stretches.rows), 1)
        # noise, rounding to steps of .002, and less than a hundredth that the starts take
        expected = np.hypot(NOISE, 0.002 / np.sqrt(12.0))
        assert np.sqrt(np.mean(samples**2)) == pytest.approx(expected, rel=0.04)


def declared(degree=1, **options):
    return SwitchingSystemRegressor(1, feature_library=degree, random_state=0, **options)


def test_slow_dry_friction_is_as_large_as_it_is():
    q, t, groups = swinging(friction=0.06)
    library = [CoulombFriction(), QuadraticDrag(), Polynomial(), Lag()]
    search = EffectSearchCV(declared(), effects=library, order=2)
    search.fit(pd.DataFrame({"q": q[:, 0]}), t=t, groups=groups)
    (found,) = search.effects_
    assert (found.kind, found.place, found.target) == ("coulomb_friction", "q'", 1)
    low, high = found.intervals["friction"]
    assert low < 0.06 < high
    assert high - low < 0.004
    assert search.feature_names_in_.tolist() == ["q", "q'"]
    assert [len(model["held_out"]) for model in search.report_.errors] == [1, 1]
    assert "nothing but noise is left" in search.report_.summary


@pytest.mark.parametrize("seed", range(3))
def test_nothing_is_missing_where_nothing_is(seed):
    q, t, groups = swinging(seed=seed)
    library = [CoulombFriction(), QuadraticDrag(), Polynomial()]
    search = EffectSearchCV(declared(), effects=library, order=2).fit(q, t=t, groups=groups)
    assert search.report_.summary == "No effect is missing as far as these data show."


def test_a_short_video_of_falls_shows_their_drag():
    """110 frames in four runs, fewer than a filter of their accelerations leaves for a search."""
    rng, parts, t = np.random.default_rng(1), [], np.arange(27) / 24.0
    for speed in (0.0, 3.0, 0.0, -2.0):
        fall = solve_ivp(
            lambda _, x: [x[1], -9.81 - 0.25 * x[1] * abs(x[1])],
            (0.0, t[-1]), [8.0, speed], t_eval=t, rtol=1e-9, atol=1e-10,
        )  # fmt: skip
        parts.append(fall.y[0] + 0.004 * rng.standard_normal(len(t)))
    terms = FunctionLibrary([lambda h, v: np.ones_like(v), lambda h, v: v])
    library = [QuadraticDrag(), CoulombFriction(), Trigonometric()]
    search = EffectSearchCV(declared(terms), effects=library, order=2)
    heights, runs = np.concatenate(parts)[:, None], np.repeat(np.arange(4), len(t))
    (found,) = search.fit(heights, t=np.tile(t, 4), groups=runs).effects_
    assert found.kind == "quadratic_drag"
    low, high = found.intervals["drag"]
    assert low < 0.25 < high


def test_a_level_is_sought_again_where_an_input_turns_out_to_be_held():
    """A servo that is driven in steps, exact from step to step: the dead zone is that of the plant.

    Beside inputs on lines it is found at 1.006 to 1.012, four to eight standard errors away.
    """
    rng, step = np.random.default_rng(0), 0.01
    u = np.repeat(np.round(rng.uniform(-6.0, 6.0, 40), 1), 40)
    acts = np.sign(u) * np.maximum(np.abs(u) - 1.0, 0.0)
    law = expm(step * np.array([[0.0, 1.0, 0.0], [0.0, -5.0, 8.0], [0.0, 0.0, 0.0]]))
    states = [np.zeros(2)]
    for one in acts[:-1]:
        states.append((law @ np.append(states[-1], one))[:2])
    q = np.array(states)[:, :1] + 0.001 * rng.standard_normal((len(u), 1))
    search = EffectSearchCV(declared(), effects=[DeadZone(), CoulombFriction()], order=2)
    search.fit(q, t=step * np.arange(len(u)), inputs=u[:, None])
    (found,) = search.effects_
    assert found.kind == "dead_zone"
    assert found.parameters["threshold"] == pytest.approx(1.0, abs=0.002)
    assert found.parameters["gain"] == pytest.approx(8.0, abs=0.02)


def test_positions_that_cannot_be_searched_are_refused():
    q, t, groups = swinging(n_rows=200)
    search = EffectSearchCV(declared(), order=2)
    with pytest.raises(ValueError, match="leave y out"):
        search.fit(np.hstack([q, q]), np.hstack([q, q]), t=t, groups=groups)
    with pytest.raises(ValueError, match="order=3"):
        EffectSearchCV(declared(), order=3).fit(q, t=t, groups=groups)
    several = SwitchingSystemRegressor(2, feature_library=1, random_state=0)
    with pytest.raises(ValueError, match="TrajectoryIdentifier"):
        EffectSearchCV(several, order=2).fit(q, t=t, groups=groups)
