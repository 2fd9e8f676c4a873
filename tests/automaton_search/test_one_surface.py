"""Ways into one mode that cross one surface: a dead zone and three levels of a held input."""

import warnings

import numpy as np
import pytest

from swsysid import HybridAutomatonRegressor

ZONE = 0.8


def held(seed, draw, law, step, n_stays, rows):
    """x' = f - a x with an input that is held for some rows: exact, with noise of 1 %."""
    rng = np.random.default_rng(seed)
    u = np.repeat(draw(rng, n_stays), rows)
    x = [0.0]
    for f, a in map(law, u[:-1]):
        x.append(f / a + (x[-1] - f / a) * np.exp(-a * step))
    x = np.array(x)[:, None]
    return x + 0.01 * x.std() * rng.standard_normal(x.shape), step * np.arange(len(u)), u[:, None]


def motor(seed):
    """A motor whose voltage does nothing within a dead zone."""
    past = lambda u: np.sign(u) * max(abs(u) - ZONE, 0.0)  # noqa: E731
    return held(
        seed, lambda rng, n: rng.uniform(-3.0, 3.0, n), lambda u: (5.0 * past(u), 2.0), 0.05, 40, 10
    )


def fan(seed):
    """A heated box with a fan of three speeds."""
    rates = np.array([0.02, 0.05, 0.12])
    return held(
        seed, lambda rng, n: rng.integers(0, 3, n).astype(float),
        lambda u: (1.6 + 20.0 * rates[int(u)], rates[int(u)]), 1.0, 60, 12,
    )  # fmt: skip


def thresholds(found):
    """Of each transition that of the input, by source and target, numbered by law."""
    which = np.argsort(np.argsort(found.coef_[:, 0, 0]))
    told = {}
    for one in found.automaton_.transitions:
        [row] = np.eye(1, 4, 1)  # state, input, dwell, time
        zero = one.guard.values(np.zeros((1, 4)))[0]
        slope = one.guard.values(row[None])[0] - zero
        told[which[one.source], which[one.target]] = -zero / slope, slope
    return told


@pytest.mark.parametrize(("seed", "n_modes"), [(1, "auto"), (11, 3)])
def test_a_dead_zone_of_a_held_input_is_three_modes(seed, n_modes):
    x, t, u = motor(seed)
    found = HybridAutomatonRegressor(
        n_modes, feature_library=1, input_hold="zero", random_state=0
    ).fit(x, t, inputs=u)
    assert found.n_modes_ == 3
    order = np.argsort(found.coef_[:, 0, 0])
    # [-4, 0, 4] + [5, 0, 5] u - 2 x; of nine within four standard errors chance leaves one in 1,700
    true = [[-5.0 * ZONE, -2.0, 5.0], [0.0, -2.0, 0.0], [5.0 * ZONE, -2.0, 5.0]]
    errors = found.coef_errors_[order][:, 0]
    assert (np.abs(found.coef_[order][:, 0] - true) < 4.0 * errors).all()
    # between the levels that were held beside each end of the zone
    levels = np.unique(u)
    told = thresholds(found)
    for (source, target), (at, slope) in told.items():
        # into an outer mode at its end of the zone, and out of it to the middle
        outer = target if target != 1 else source
        end = ZONE if outer == 0 else -ZONE
        assert levels[levels < end].max() < at < levels[levels > end].min()
        assert (slope > 0.0) == (target < source)
    assert len(told) == 6 and found.report_.rollouts.holds
    assert "same guard" not in str(found.report_)


def test_levels_of_a_held_input_lie_on_both_sides_of_surfaces():
    x, t, u = fan(1)
    found = HybridAutomatonRegressor(
        "auto", feature_library=1, input_hold="zero", random_state=0
    ).fit(x, t, inputs=u)
    assert found.n_modes_ == 3
    for (source, target), (at, _) in thresholds(found).items():
        # the mode of the least level is left, or entered, where it ends; so is that of the largest
        between = 0 if 0 in (source, target) and target != 2 else 1
        assert between < at < between + 1
    assert found.report_.rollouts.holds and "same guard" not in str(found.report_)


def test_stays_that_guards_tell_and_the_laws_refute_are_not_taken():
    """A motor with dry friction that sticks: told by its guards the laws left .12 for .038."""
    rng = np.random.default_rng(5)
    u = np.repeat(rng.uniform(-6.0, 6.0, 30), 20)
    x, inner = [0.0], 200
    for force in 3.0 * u[:-1]:
        w = x[-1]
        for _ in range(inner):  # Euler's steps that stop at zero where friction holds
            drive = force - 1.2 * w - 4.0 * np.sign(w if w != 0.0 else force)
            held = w == 0.0 and abs(force) <= 4.0
            after = w if held else w + 0.04 / inner * drive
            w = 0.0 if w * after < 0.0 else after
        x.append(w)
    x = np.array(x)[:, None]
    measured = x + 0.01 * x.std() * rng.standard_normal(x.shape)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # not every way out of rest was taken twice
        found = HybridAutomatonRegressor(
            3, feature_library=1, input_hold="zero", random_state=0
        ).fit(measured, 0.04 * np.arange(len(u)), inputs=u[:, None])
    share = np.bincount(found.modes_) / len(u)
    moving = np.argsort(-share)[:2]
    order = moving[np.argsort(found.coef_[moving, 0, 0])]
    # [-4, 4] - 1.2 x + 3 u; of six within four standard errors chance leaves one in 2,600
    errors = found.coef_errors_[order][:, 0]
    assert (np.abs(found.coef_[order][:, 0] - [[-4, -1.2, 3], [4, -1.2, 3]]) < 4.0 * errors).all()
    assert found.noise_[0] < 1.1 * 0.01 * x.std()
