"""The library of effects: columns by hand, and what a user's own effect has to say."""

import numpy as np
import pytest
from sklearn.base import clone

from swsysid._data.records import make_records
from swsysid._noise import STUDENT, robust_scale
from swsysid.effects import (
    AsymmetricFriction,
    Backlash,
    Bias,
    ClockLag,
    CoulombFriction,
    DeadZone,
    Delay,
    Drift,
    GainChange,
    GuardHysteresis,
    InputCoupling,
    Lag,
    Overflow,
    PeriodicForcing,
    PlacedEffect,
    Polynomial,
    PowerLaw,
    QuadraticDrag,
    Reset,
    Saturation,
    SensorOffset,
    StribeckFriction,
    Trigonometric,
    all_effects,
    special_effects,
)
from swsysid.effects._guards import Guard, best_band, guards_of
from swsysid.effects._switching import crossing_of


def records(X, **options):
    X = np.asarray(X, dtype=float)
    return make_records(X, options.pop("n_states", X.shape[1]), names=list("abcd"), **options)


COLUMN = np.array([[-2.0], [-0.5], [0.0], [0.5], [2.0]])
# effect, parameters, columns at -2, -1/2, 0, 1/2, 2, worked out by hand
BY_HAND = [
    (CoulombFriction(), (), [[1.0], [1.0], [0.0], [-1.0], [-1.0]]),
    (QuadraticDrag(), (), [[4.0], [0.25], [0.0], [-0.25], [-4.0]]),
    (
        AsymmetricFriction(),
        (),
        [[0, 1, 0], [0, 1, 0], [0, 0, 0], [-1, 0, -0.5], [-1, 0, -2.0]],
    ),
    (DeadZone(), (1.0,), [[-1.0], [0.0], [0.0], [0.0], [1.0]]),
    (Saturation(), (1.0,), [[-1.0], [-0.5], [0.0], [0.5], [1.0]]),
    (GainChange(), (1.0,), [[-1.0], [0.0], [0.0], [0.0], [1.0]]),
    (PowerLaw(), (2.0,), [[-4.0], [-0.25], [0.0], [0.25], [4.0]]),
    (Overflow(), (0.5,), [[0.0], [0.0], [0.0], [0.0], [-1.5]]),
]


@pytest.mark.parametrize(
    ("effect", "theta", "expected"), BY_HAND, ids=[type(row[0]).__name__ for row in BY_HAND]
)
def test_static_columns_by_hand(effect, theta, expected):
    columns = effect.columns(records(COLUMN), 0, *theta)
    np.testing.assert_allclose(columns, expected, atol=1e-15)


def test_stribeck_and_sine_by_hand():
    columns = StribeckFriction().columns(records(COLUMN), 0, 0.5)
    np.testing.assert_allclose(columns[3], [-1.0, -np.exp(-1.0)], atol=1e-15)
    columns = Trigonometric().columns(records(COLUMN), 0, np.pi)
    np.testing.assert_allclose(columns[3], [1.0, 0.0], atol=1e-15)
    told = Trigonometric().physical({"wavenumber": 2.0}, {"sine": 3.0, "cosine": 4.0})
    assert told == pytest.approx({"wavenumber": 2.0, "amplitude": 5.0, "phase": np.arctan2(4, 3)})


def test_an_input_in_steps_shows_no_wave_between_its_levels():
    """Waves whose numbers differ by 2 pi over the step are one at such values: one of them is."""
    steps, gap = np.repeat(np.arange(6.0), 20)[:, None] * 0.1, 0.1
    (waves,) = Trigonometric().parameters(records(steps), 0)
    assert len(waves.values) and waves.values.max() < np.pi / gap
    slow, fast = (
        Trigonometric().columns(records(steps), 0, one)
        for one in (waves.values[0], 2.0 * np.pi / gap + waves.values[0])
    )
    np.testing.assert_allclose(slow, fast, atol=1e-12)  # both columns, sine and cosine
    (dense,) = Trigonometric().parameters(records(np.linspace(0.0, 0.5, 120)[:, None]), 0)
    assert len(dense.values) == 32


def test_monomials_have_the_places_of_their_factors():
    data = records([[2.0, 3.0]])
    assert Polynomial().columns(data, (0, 0, 1)).item() == 12.0
    assert Polynomial().label((0, 0, 1), ["x", "v"]) == "x^2 v"
    assert (0,) * 5 in Polynomial().places(data) and (0,) * 6 not in Polynomial().places(data)


def test_time_and_signals():
    data = records(np.ones((3, 1)), t=[0.0, 0.25, 0.5], signals=[[5.0], [6.0], [7.0]])
    np.testing.assert_allclose(Drift().columns(data, "level")[:, 0], [0.0, 0.25, 0.5])
    np.testing.assert_allclose(
        PeriodicForcing().columns(data, "time", 1.0), [[0, 1], [1, 0], [0, -1]], atol=1e-15
    )
    (place,) = InputCoupling().places(data)
    np.testing.assert_allclose(InputCoupling().columns(data, place)[:, 0], [5.0, 6.0, 7.0])


def test_a_forcing_has_five_periods_in_the_record():
    t = np.arange(1001) * 0.1  # 100 s
    (one,) = PeriodicForcing().parameters(records(np.ones((1001, 1)), t=t), "time")
    assert one.values[0] == pytest.approx(0.05) and one.values[-1] == pytest.approx(2.5)
    # ten trajectories of 10 s: less than a period in each may do
    many = records(np.ones((1001, 1)), t=t, groups=np.minimum(np.arange(1001) // 100, 9))
    (ten,) = PeriodicForcing().parameters(many, "time")
    assert 0.05 < ten.values[0] < 0.08
    # at the same times a period that is as long as each of them has come once
    same = records(np.ones((1000, 1)), t=np.tile(t[:100], 10), groups=np.arange(1000) // 100)
    (again,) = PeriodicForcing().parameters(same, "time")
    assert again.values[0] == pytest.approx(2.0 / 9.9)
    (short,) = PeriodicForcing().parameters(records(np.ones((9, 1)), t=t[:9]), "time")
    assert len(short.values) == 0


def test_zero_is_no_middle_of_a_level():
    level, position = np.linspace(1.0, 9.0, 50), np.linspace(-1.0, 1.0, 50)
    data = records(np.column_stack([level, position, level]), n_states=2)
    for effect in (DeadZone(), GainChange()):
        assert list(effect.places(data)) == [1, 2]  # the input may be one-sided
    assert list(Overflow().places(data)) == [0, 1]


def test_memory_stays_inside_a_trajectory():
    # two trajectories whose rows are interleaved; each begins at rest at its first value
    t = np.array([0.0, 0.0, 1.0, 1.0, 2.0, 2.0])
    groups = ["one", "two"] * 3
    values = np.array([[0.0], [9.0], [1.0], [9.0], [2.0], [9.0]])
    data = records(values, t=t, groups=groups)
    delayed = Delay().columns(data, 0, 0.5)[:, 0]
    np.testing.assert_allclose(delayed, [0.0, 9.0, 0.5, 9.0, 1.5, 9.0])
    lagging = Lag().columns(data, 0, 1.0)[:, 0]
    # ramp of slope one into a lag of one second: t - 1 + exp(-t)
    np.testing.assert_allclose(lagging[::2], [0.0, np.exp(-1.0), 1.0 + np.exp(-2.0)], atol=1e-14)
    np.testing.assert_allclose(lagging[1::2], 9.0)
    followed = Backlash().columns(data, 0, 1.0)[:, 0]
    np.testing.assert_allclose(followed, [0.0, 9.0, 0.5, 9.0, 1.5, 9.0])


def test_uneven_steps_make_the_same_lag():
    t = np.array([0.0, 0.3, 1.0, 1.1, 2.5])
    data = records(t[:, None], t=t)
    np.testing.assert_allclose(
        Lag().columns(data, 0, 0.7)[:, 0], t - 0.7 + 0.7 * np.exp(-t / 0.7), atol=1e-14
    )


def test_sensors_are_undone():
    t = np.arange(5.0)
    data = records(np.column_stack([t + 0.5, 2.0 * (t - 0.5)]), t=t)
    assert SensorOffset().corrected(data, 0, 0.5).X[:, 0].tolist() == t.tolist()
    corrected = ClockLag().corrected(data, 1, 0.5).X[:, 1]
    np.testing.assert_allclose(corrected[:-1], 2.0 * t[:-1])  # the end has no reading to come


@pytest.mark.parametrize(
    "effect", [*all_effects(), *special_effects()], ids=lambda effect: effect.kind
)
def test_every_effect_says_what_it_is(effect):
    assert effect.kind and effect.meaning and repr(clone(effect)) == repr(effect)
    sentence = effect.describe("speed", "force")
    assert "{" not in sentence


def test_exchangeable_rows_have_no_memory_and_say_so():
    data = records(COLUMN)
    assert "give t or groups" in Delay().missing(data)
    assert "give t" in Drift().missing(data)
    assert "give signals" in InputCoupling().missing(data)
    assert CoulombFriction().missing(data) is None


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"t": [0.0, 1.0, 0.5, 2.0, 3.0]}, "must increase along every trajectory"),
        ({"t": [0.0, 1.0]}, "one value for each of the 5 samples"),
        ({"t": [0.0, 1.0, np.nan, 2.0, 3.0]}, "NaN"),
        ({"groups": [0, 1]}, "groups has shape .2,.; give one name for each"),
        ({"signals": np.ones((3, 2))}, "signals has shape .3, 2.; give one row for each"),
        ({"signals": np.full((5, 1), np.inf)}, "NaN or infinity"),
    ],
)
def test_bad_records_are_refused_in_a_sentence(options, message):
    with pytest.raises(ValueError, match=message):
        records(COLUMN, **options)


def test_influence_of_a_students_error_has_its_own_slope():
    errors = np.array([-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 3.0])
    scale = float(robust_scale(errors))
    weight, slope = STUDENT.influence(errors)
    squares = (errors / scale) ** 2
    np.testing.assert_allclose(weight, 5.0 / (4.0 + squares), rtol=1e-14)
    step = 1e-6

    def pulled(values):
        return 5.0 / (4.0 + (values / scale) ** 2) * values

    numeric = (pulled(errors + step) - pulled(errors - step)) / (2.0 * step)
    np.testing.assert_allclose(slope, numeric, atol=1e-8)


@pytest.mark.parametrize("decimals", [1, 8])
def test_the_best_band_of_a_guard_is_that_of_all_rows(decimals):
    rng = np.random.default_rng(0)
    # three trajectories whose rows lie between each other's, some rows exactly on an edge
    X = np.round(np.cumsum(rng.normal(scale=0.3, size=(300, 1)), axis=0), decimals)
    data = records(X, t=np.arange(300.0), groups=rng.integers(0, 3, 300))
    guard, sides = Guard(((0,),), (1.0,), 1), rng.choice([-1.0, 0.0, 1.0], 300)
    levels = np.quantile(X, [0.1, 0.3, 0.5, 0.7, 0.9])
    bands = [(low, high) for low in levels for high in levels if low <= high]
    every = [sides @ np.where(guard.modes(data, *band) == 1, 1.0, -1.0) for band in bands]
    excess, band = best_band(bands, data, guard(data.X), sides)
    assert excess == max(every) and band == bands[int(np.argmax(every))]


def test_a_guard_with_memory_is_told_in_the_sign_of_its_channel():
    # a heater that goes on below 20 and off above 22: mode 1 is below the band
    T = 21.0 + 2.0 * np.sin(0.05 * np.arange(600.0))
    data = records(T[:, None], t=np.arange(600.0), groups=np.zeros(600, dtype=int))
    modes = Guard(((0,),), (1.0,), 0).modes(data, 20.0, 22.0)
    options = guards_of(data, modes)
    assert all(max(option.guard.weights, key=abs) == 1.0 for option in options)
    best = max(options[:2], key=lambda option: option.agreement)
    guard, (low, high) = best.guard, best.band
    # a step of the record is at most 0.1
    assert low == pytest.approx(20.0, abs=0.1) and high == pytest.approx(22.0, abs=0.1)
    assert GuardHysteresis().label(guard, ["T_C"]) == "T_C"
    assert GuardHysteresis().label(Guard(((0,), (1,)), (1.0, -0.5), 0), ["a", "b"]) == "+1 a -0.5 b"


def test_the_edges_of_a_band_lie_midway_between_the_samples_that_bound_them():
    # on from the sample at 4, off from that at 1: the edges are somewhere in (3, 4] and [1, 2)
    up_and_down = np.tile([0.0, 1, 2, 3, 4, 5, 4, 3, 2, 1], 8)
    data = records(up_and_down[:, None], t=np.arange(80.0), groups=np.zeros(80, dtype=int))
    modes = np.tile([0, 0, 0, 0, 1, 1, 1, 1, 1, 0], 8)
    best = max(guards_of(data, modes)[:2], key=lambda option: option.agreement)
    assert best.band == (1.5, 3.5) and best.agreement == 1.0


def test_of_the_guards_without_a_memory_that_which_agrees_best():
    data = records([[0.0], [1.0], [2.0], [3.0], [4.0]], groups=np.zeros(5, dtype=int))
    effect, guard = GuardHysteresis(), Guard(((0,),), (1.0,), 1)
    cases = {
        (0, 0, 1, 1, 1): 1.5,
        (0, 1, 0, 1, 1): 0.5,
        (1, 1, 1, 1, 1): 0.0,
        (0, 0, -1, 1, 1): 2.0,
    }
    for modes, threshold in cases.items():
        (same, single), *others = effect.without_memory(guard, data, np.array(modes), 0.5, 2.5)
        assert same == guard and single == (threshold, threshold)
        assert not any(effect.remembers(*theta) for _, theta in [(same, single), *others])
    assert effect.remembers(0.5, 2.5)


@pytest.mark.parametrize(("modes", "place", "expected"), [
    ([0, 0, 1, 0, 0], 2, (1, 0)),  # there and back at once
    ([0, 0, 1, 0, 0], 1, (0, 1)),
    ([1, 1, 0, 0], 2, (1, 0)),  # told too early by one sample
    ([0, 0, 0, 0], 0, (0, 0)),
])  # fmt: skip
def test_the_modes_between_which_a_state_jumps(modes, place, expected):
    assert crossing_of(np.array(modes), place) == expected


def test_a_threshold_that_one_side_alone_reaches_is_scanned():
    u = np.concatenate([np.linspace(-4.0, 0.0, 50), np.linspace(0.0, 10.0, 100)])
    (parameter,) = Saturation().parameters(records(np.column_stack([u, u]), n_states=1), 1)
    assert parameter.values.max() == pytest.approx(9.5, abs=0.1)  # 95 % of the longer side


def test_modes_that_are_there_no_more_keep_their_numbers():
    order = np.array([1, 0])
    reset = PlacedEffect(Reset(), (0, 2), 0, theta=(-0.8,))
    assert reset.renumbered(order).place == (1, 2)
    assert PlacedEffect(Bias(), "constant", 0, mode=1).renumbered(order).mode == 0
    assert PlacedEffect(Bias(), "constant", 0, mode=2).renumbered(order).mode == 2
    assert PlacedEffect(Bias(), "constant", 0).renumbered(order).mode is None
