"""Encoders, clipped sensors, loggers that hold, records that rest: the answer is not theirs."""

import numpy as np
import pytest

from swsysid import EffectSearchCV, IdentificationWarning, SwitchingSystemRegressor
from swsysid.differentiation import (
    choose_smoothing,
    differentiate,
    estimate_noise,
    inspect_sensors,
)
from swsysid.differentiation._noise import sixth_differences
from swsysid.effects import CoulombFriction

QUANTUM = 0.003  # rad, of an encoder of 2048 lines or so
FRICTION = 0.8


def _mass(seed, step, *, duration=20.0, stiffness=2.0, size=3.0, idle=0.0):
    """Times, position, velocity, acceleration and force of a mass on a spring with dry friction.

    The force is a multisine, switched off for a share of every ten seconds.
    """
    rng = np.random.default_rng(seed)
    frequency, phase = rng.uniform(0.1, 1.2, 6), rng.uniform(0.0, 2 * np.pi, 6)
    fine = int(np.ceil(step / 1e-3)) * 4
    t = np.arange(round(duration / step) * fine) * step / fine
    force = size / np.sqrt(3.0) * np.sin(2 * np.pi * frequency * t[:, None] + phase).sum(axis=1)
    force *= t % 10.0 >= 10.0 * idle
    q, v, a = np.zeros((3, len(t)))
    for i in range(len(t) - 1):
        drive = force[i] - 0.4 * v[i] - stiffness * q[i]
        if v[i] != 0.0 or abs(drive) > FRICTION:
            a[i] = drive - FRICTION * np.sign(v[i] or drive)
        faster = v[i] + a[i] * step / fine
        v[i + 1] = 0.0 if v[i] * faster < 0.0 else faster
        q[i + 1] = q[i] + 0.5 * (v[i] + v[i + 1]) * step / fine
    return [column[::fine] for column in (t, q, v, a, force)]


def _rounded(q, quantum=QUANTUM):
    return quantum * np.round(q / quantum)


def _errors(x, t, v, a, **options):
    """Root mean square errors of velocity and acceleration."""
    done = differentiate(x, t, order=2, **options)
    rows = np.searchsorted(t, done.t - 1e-9)
    found = np.column_stack([done.X[:, 1], done.Xdot[:, 1]])
    return np.sqrt(np.mean((found - np.column_stack([v, a])[rows]) ** 2, axis=0))


def _friction(x, t, force, **options):
    """Friction that the search reports, 0 where it reports none."""
    done = differentiate(x, t, inputs=force, order=2, **options)
    model = SwitchingSystemRegressor(n_modes=1, random_state=0)
    search = EffectSearchCV(model, effects=[CoulombFriction()], random_state=0)
    search.fit(done.X, done.Xdot, t=done.t, groups=done.groups)
    found = [effect.parameters["friction"] for effect in search.effects_ if effect.place == "x1"]
    return found[0] if found else 0.0


# --- values on a grid -------------------------------------------------------------------------


@pytest.mark.parametrize("step", [0.001, 0.004, 0.01, 0.025])
@pytest.mark.parametrize("seed", [20, 21, 22])
def test_an_encoder_costs_no_more_than_noise_of_its_size(seed, step):
    t, q, v, a, force = _mass(seed, step)
    rng = np.random.default_rng(seed)
    noisy = q + QUANTUM / np.sqrt(12.0) * rng.standard_normal(len(q))
    ratio = _errors(_rounded(q), t, v, a)[1] / _errors(noisy, t, v, a)[1]
    assert ratio < 1.3
    if step >= 0.004:  # the finer rate says the same and takes longer
        assert _friction(_rounded(q), t, force) == pytest.approx(
            _friction(noisy, t, force), rel=0.1
        )


@pytest.mark.parametrize("sensor", [0.0002, 0.0015, 0.006])
def test_an_encoder_behind_a_noisy_sensor(sensor):
    t, q, v, a, _ = _mass(23, 0.005)
    noise = np.random.default_rng(23).standard_normal((2, len(q)))
    both = np.hypot(sensor, QUANTUM / np.sqrt(12.0))
    measured = _rounded(q + sensor * noise[0])
    # sqrt of the mean of squares of at most 4000 errors
    assert estimate_noise(measured)[0] == pytest.approx(both, rel=0.15)
    errors = _errors(measured, t, v, a) / _errors(q + both * noise[1], t, v, a)
    assert errors[1] < 1.3


def test_no_window_takes_a_swing_for_noise_that_an_encoder_reads():
    # strong smoothers of many swings agree with each other that nothing moves
    t, pulsation, ending = np.arange(6000) / 150.0, 6.8, 37.2
    size = 1.6 * np.maximum(1.0 - t / ending, 0.0)
    slower = -1.6 / ending * (t < ending)
    swing, turned = np.cos(pulsation * t), -pulsation * np.sin(pulsation * t)
    v = size * turned + slower * swing
    a = -(pulsation**2) * size * swing + 2.0 * slower * turned
    errors = _errors(_rounded(size * swing, np.pi / 1000.0), t, v, a)
    # a window of a tenth of a period leaves a hundredth of the acceleration, at the stop more
    assert (errors < 0.05 * np.array([v.std(), a.std()])).all()


@pytest.mark.parametrize("method", ["savitzky_golay", "butterworth"])
def test_noise_is_at_least_that_of_rounding(method):
    t, q, v, a, _ = _mass(24, 0.002)
    coarse = _rounded(q, 0.01)
    assert estimate_noise(coarse)[0] >= 0.01 / np.sqrt(12.0) * (1 - 1e-9)
    # unsmoothed, the error is tens of times the acceleration
    assert _errors(coarse, t, v, a, method=method)[1] < 0.15 * np.std(a)


def test_the_quantum_is_that_of_the_encoder_whatever_its_zero():
    _, q, *_ = _mass(25, 0.005)
    groups = np.repeat([0, 1], len(q))
    shifted = np.concatenate([_rounded(q), _rounded(q) + np.pi])
    single = _rounded(q).astype(np.float32)
    for values, labels in ((shifted, groups), (single, None), (1e6 * _rounded(q), None)):
        unit = 1e6 if np.ptp(values) > 1e3 else 1.0
        assert inspect_sensors(values, labels).quantum[0] == pytest.approx(unit * QUANTUM, rel=1e-3)


@pytest.mark.parametrize(
    "exact",
    [
        np.linspace(0.0, 4.0, 401),
        np.linspace(0.0, 4.0, 401) ** 2,
        np.abs(np.arange(-100.0, 100.0)),
        np.sin(np.linspace(0.0, 9.0, 500)),
        np.arange(200) // 100 * 1.0,
        np.full(50, 3.0),
    ],
)
def test_exact_values_are_neither_rounded_nor_clipped_nor_held(exact):
    sensors = inspect_sensors(exact)
    assert sensors.quantum[0] == 0.0
    assert not sensors.clipped.any() and not sensors.held.any()


# --- ends of the range ------------------------------------------------------------------------


@pytest.mark.parametrize("noise", [0.0, 0.001])
@pytest.mark.parametrize("quantum", [0.0, QUANTUM])
@pytest.mark.parametrize("seed", [30, 31])
def test_clipped_samples_count_as_missing(seed, quantum, noise):
    t, q, v, a, _ = _mass(seed, 0.005)
    measured = q + noise * np.random.default_rng(seed).standard_normal(len(q))
    limit = np.quantile(np.abs(q), 0.9)
    clipped = np.clip(measured, -limit, limit)
    if quantum:
        measured, clipped = _rounded(measured), _rounded(clipped)
    beyond = inspect_sensors(clipped).clipped[:, 0]
    # those that rounding takes to the end look like those beyond it
    assert np.array_equal(beyond, np.abs(clipped) == np.abs(clipped).max())
    told = rf"in {beyond.sum()} of {len(q)} samples, which .*differentiate\(..., clipped='keep'\)"
    with pytest.warns(IdentificationWarning, match=told):
        errors = _errors(clipped, t, v, a)
    assert errors[1] < 1.3 * _errors(measured, t, v, a)[1]
    with pytest.warns(IdentificationWarning, match="are taken as measured"):
        kept = _errors(clipped, t, v, a, clipped="keep")
    assert kept[1] > 5 * errors[1]


@pytest.mark.parametrize("quantum", [0.0, 0.0005, 0.015])
@pytest.mark.parametrize("seed", [32, 33, 34])
def test_what_comes_to_rest_at_an_end_is_not_clipped(seed, quantum):
    for step in (0.002, 0.02):
        _, q, *_ = _mass(seed, step, size=1.5, idle=0.5)
        values = _rounded(q, quantum) if quantum else q
        assert not inspect_sensors(values).clipped.any()


@pytest.mark.parametrize("seed", range(3))
def test_a_servo_that_stops_at_its_targets_is_not_clipped(seed):
    # at the outermost ones no less suddenly than at the middle one
    place, counts = 2047.0, []
    for target in np.random.default_rng(seed).choice([1947.0, 2047.0, 2147.0], 20):
        for _ in range(12):
            place += np.clip(target - place, -38.0, 38.0)
            counts.append(round(place))
    assert not inspect_sensors(np.array(counts, dtype=float)).clipped.any()


@pytest.mark.parametrize("rest", [0.0, 300.0])
def test_a_wheel_that_stands_until_it_is_driven_is_not_clipped(rest):
    # counts of an encoder: exact while it stands, noisy once it turns
    speeds = 200.0 * (1.0 - np.exp(-np.arange(100) / 20.0)) + 30.0
    noise = 3.0 * np.random.default_rng(0).standard_normal(len(speeds))
    driven = np.concatenate([np.zeros(40), speeds + noise])
    # of zero it stands for rest again later; elsewhere that could be the end of a range
    values = rest + (np.tile(driven, 2) if rest == 0.0 else driven)
    assert not inspect_sensors(values).clipped.any()


def test_no_window_reaches_across_a_long_clipped_stretch():
    t = np.arange(0.0, 20.0, 0.01)
    x = np.clip(np.sin(t), -1.0, 0.5)
    with pytest.warns(IdentificationWarning, match="0.5, in 691 of 2000 samples"):
        done = differentiate(x, t)
    assert np.abs(done.Xdot[:, 0] - np.cos(done.t)).max() < 1e-6
    assert not (np.sin(done.t) >= 0.5).any()


# --- held readings ----------------------------------------------------------------------------


@pytest.mark.parametrize("quantum", [0.0, QUANTUM])
@pytest.mark.parametrize("hold", [2, 7])
def test_a_logger_that_repeats_readings_adds_nothing(hold, quantum):
    t, q, v, a, _ = _mass(40, 0.002, idle=0.3)
    measured = q + 0.001 * np.random.default_rng(40).standard_normal(len(q))
    measured = _rounded(measured) if quantum else measured
    held = measured[np.arange(len(q)) // hold * hold]
    found = inspect_sensors(held).held
    assert np.array_equal(found, np.arange(len(q)) % hold > 0)
    errors = _errors(held, t, v, a) / _errors(measured[::hold], t[::hold], v[::hold], a[::hold])
    np.testing.assert_allclose(errors, 1.0, rtol=1e-6)


# --- rest -------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["exact", "noisy", "rounded"])
@pytest.mark.parametrize("seed", [50, 51, 52])
def test_a_record_that_mostly_rests_gives_the_law_of_the_movement(seed, kind):
    t, q, v, _, force = _mass(seed, 0.005, duration=30.0, stiffness=0.5, size=2.0, idle=0.7)
    noise = QUANTUM / np.sqrt(12.0) * np.random.default_rng(seed).standard_normal(len(q))
    x = {"exact": q, "noisy": q + noise, "rounded": _rounded(q)}[kind]
    assert np.mean(v == 0.0) > 0.5
    # stops that are shorter than the smoothing remain, and pull the friction down
    assert _friction(x, t, force) == pytest.approx(FRICTION, rel=0.25)
    assert _friction(x, t, force, rest="keep") < 0.5 * FRICTION
    rows, kept = (differentiate(x, t, order=2, rest=how) for how in ("thin", "keep"))
    # every row but those at rest stays
    gone = ~np.isin(kept.t, rows.t)
    assert np.mean(np.abs(kept.X[gone, 1]) < 0.1 * np.abs(kept.X[:, 1]).max()) > 0.99


def test_a_record_that_moves_keeps_its_rows():
    t, q, *_ = _mass(53, 0.005)
    for x in (q, _rounded(q)):
        all_rows = differentiate(x, t, order=2, rest="keep")
        np.testing.assert_array_equal(differentiate(x, t, order=2).t, all_rows.t)


# --- sentences --------------------------------------------------------------------------------


def test_a_constant_column_gets_a_sentence():
    t = np.arange(0.0, 5.0, 0.01)
    x = np.column_stack([np.sin(t), np.full_like(t, 2.5)])
    with pytest.warns(IdentificationWarning, match="x1 is 2.5 in all 500 samples: no law"):
        done = differentiate(x, t)
    np.testing.assert_allclose(done.Xdot[:, 1], 0.0, atol=1e-9)


def test_wrong_choices_are_refused():
    t = np.arange(0.0, 5.0, 0.01)
    with pytest.raises(ValueError, match="clipped='fill' is unknown"):
        differentiate(np.sin(t), t, clipped="fill")
    with pytest.raises(ValueError, match="rest='weigh' is unknown"):
        differentiate(np.sin(t), t, rest="weigh")


@pytest.mark.parametrize("spacing", ["even", "drawn", "two rates"])
def test_noise_is_told_at_uneven_times_too(spacing):
    """Waves of a few periods with noise of .01, sampled 2,000 times."""
    rng = np.random.default_rng(0)
    t = {
        "even": np.linspace(0.0, 8.0, 2000),
        "drawn": np.sort(rng.uniform(0.0, 8.0, 2000)),
        "two rates": np.cumsum(np.where(rng.random(2000) < 0.1, 0.02, 0.002)),
    }[spacing]
    x = np.column_stack([np.sin(3.0 * t), np.cos(2.0 * t)]) + 0.01 * rng.standard_normal((2000, 2))
    # a median of 1994 differences, of which seven share each sample
    assert choose_smoothing(x, t).noise == pytest.approx([0.01, 0.01], rel=0.15)


def test_differences_at_uneven_times_leave_polynomials_of_degree_five_and_unit_noise():
    rng = np.random.default_rng(1)
    t = np.cumsum(rng.uniform(0.1, 1.0, 4000))
    smooth = np.polynomial.Polynomial([1.0, -2.0, 0.5, 3.0, -1.0, 0.7])(t / t[-1])
    [left] = sixth_differences(smooth[:, None], t)
    assert np.abs(left).max() < 1e-10 * np.abs(smooth).max()
    [noise] = sixth_differences(rng.standard_normal((4000, 1)), t)
    [even] = sixth_differences(rng.standard_normal((4000, 1)))
    assert noise.std() == pytest.approx(even.std(), rel=0.05)
