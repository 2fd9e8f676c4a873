"""Modes of recordings, told by the states: guards that remember and resets are found by them."""

from dataclasses import replace

import numpy as np
import pytest

from swsysid import EffectSearchCV
from swsysid._data.records import make_records
from swsysid._data.windows import stays_of
from swsysid._effect_model.models import declared_model
from swsysid._effect_search.recording import from_states
from swsysid.datasets import make_undeclared
from swsysid.effects import Bias, CoulombFriction, ExtraMode, GuardHysteresis, Polynomial, Reset


def recorded(effect, system, seed, noise=0.01):
    """Data, states with noise of one per cent of their spread, and the input."""
    data = make_undeclared(effect, system=system, random_state=seed)
    x, u = np.split(data.X, [data.Xdot.shape[1]], axis=1)
    drawn = np.random.default_rng(seed).standard_normal(x.shape)
    return data, x + noise * x.std(axis=0) * drawn, u


def measured(effect, system, seed):
    data, x, u = recorded(effect, system, seed)
    names = [f"x{k}" for k in range(data.X.shape[1])]
    records = make_records(np.hstack([x, u]), x.shape[1], t=data.t, groups=data.groups, names=names)
    return data, from_states(declared_model(data.estimator, records), records)


@pytest.mark.parametrize("effect", [None, "guard_hysteresis"])
@pytest.mark.parametrize("system", ["oscillator", "two_mass"])
def test_states_tell_their_modes_whatever_the_guard(system, effect):
    data, found = measured(effect, system, seed=100)
    sure = found.records.decoded_modes >= 0
    told = found.records.decoded_modes[sure]
    right = max(np.mean(told == data.modes[sure]), np.mean(told != data.modes[sure]))
    assert right > 0.98 and sure.mean() > 0.8
    # every window is in one true mode, but for few whose switch was told far too late
    half = found.window // 2
    pure = [np.ptp(data.modes[row - half : row + half + 1]) == 0 for row in found.rows]
    assert np.mean(pure) > 0.98


def test_velocities_of_a_right_model_have_no_more_than_the_noise_of_their_windows():
    data, found = measured(None, "oscillator", seed=100)
    shown = found.records.averaged(data.Xdot_clean)
    error = (found.targets - shown)[found.rows]
    # the slope of a line through w samples, dt apart, has the deviation sigma / (dt sqrt(w^3/12))
    noise = 0.01 * data.X[:, :2].std(axis=0)
    expected = noise / (data.time_step * np.sqrt(found.window * (found.window**2 - 1) / 12.0))
    np.testing.assert_allclose(error.std(axis=0), expected, rtol=0.4)
    assert (np.abs(error.mean(axis=0)) < 4.0 * error.std(axis=0) / np.sqrt(len(error))).all()


@pytest.mark.parametrize(
    ("kind", "system"),
    [
        pytest.param("guard_hysteresis", "oscillator", marks=pytest.mark.nightly),
        ("reset", "oscillator"),
        pytest.param("reset", "two_mass", marks=pytest.mark.nightly),
    ],
)
def test_an_effect_at_the_switches_is_found_without_velocities(kind, system):
    data, x, u = recorded(kind, system, seed=100)
    library = [Bias(), CoulombFriction(), Polynomial(), GuardHysteresis(), Reset(), ExtraMode()]
    search = EffectSearchCV(data.estimator, effects=library)
    (found,) = search.fit(x, t=data.t, groups=data.groups, inputs=u).effects_
    assert found.kind == kind
    if kind == "reset":
        truth = data.effects[0]
        assert found.target == truth.target
        # one per cent of noise on each of some twenty jumps
        assert found.parameters["factor"] == pytest.approx(truth.parameters["factor"], abs=0.05)


def test_stays_are_stretches_of_one_mode():
    modes = np.array([0, 0, -1, 1, 1, 1, 0])
    stays = stays_of(modes, [np.arange(4), np.arange(4, 7)])
    assert [stay.tolist() for stay in stays] == [[0, 1], [2], [3], [4, 5], [6]]


def crossings(jump, seed=0):
    """Forty stays of mode 0 then 1: in the first x is straight, in the second it bends with x."""
    rng, half, bend = np.random.default_rng(seed), 2, 0.8
    t = np.tile(0.1 * np.arange(-8, 9), 40)
    level, slope = (np.repeat(rng.uniform(*limits, 40), 17) for limits in ((1, 3), (-2, 2)))
    after = np.clip(t, 0.0, None)
    # the velocities of the two samples next to a switch are the same
    loss = -bend * level * 0.1 * half
    x = level + slope * t + loss * after + 0.5 * bend * level * after**2
    velocity = slope + (loss + bend * level * after) * (t > 0)
    x, told = np.where(t > 0, (1 + jump) * x, x), np.where(t > 0, 1, 0)
    velocity = np.where(t > 0, (1 + jump) * velocity, velocity)
    told[np.abs(t) < 0.1 * half - 0.01] = -1
    groups = np.repeat(np.arange(40), 17)
    records = make_records(
        (x + 1e-4 * rng.standard_normal(x.shape))[:, None], 1, t=t, groups=groups, names=["x"]
    )
    return replace(records, decoded_modes=told), velocity[:, None], told


def test_what_bends_between_two_stays_is_no_reset():
    assert Reset().candidate(*crossings(0.0), 0) is None
    crossing, (factor,) = Reset().candidate(*crossings(-0.3), 0)
    assert crossing == (0, 1)
    assert factor == pytest.approx(0.7, abs=0.02)
