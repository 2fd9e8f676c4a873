"""Records drawn by chance are what their numbers say, and tables count what is in them."""

import numpy as np
import pytest

from benchmarks.sensitivity.__main__ import Change, constants
from benchmarks.sensitivity.tables import BASE, condensed
from benchmarks.sensitivity.tables import tables as sensitivity_tables
from benchmarks.undeclared.fresh import (
    Drawn,
    fresh_counts,
    fresh_tables,
    in_short_stays,
    run_fresh,
)
from benchmarks.undeclared.fresh_plants import FRESH_PLANTS
from swsysid._effect_search.settings import SETTINGS
from swsysid.datasets import unlisted_kinds
from swsysid.datasets._undeclared.make import planted_record
from swsysid.datasets._undeclared.simulation import reference_run
from swsysid.effects import _base, _bristles, _characteristics


def test_a_record_follows_from_its_number():
    first, again, other = (Drawn.of(number) for number in (3, 3, 4))
    np.testing.assert_array_equal(first.plant.coef, again.plant.coef)
    assert (first.kind, first.n_samples, first.seed) == (again.kind, again.n_samples, again.seed)
    assert first.seed != other.seed


@pytest.mark.nightly
def test_records_lie_in_the_ranges_that_are_told():
    many = [Drawn.of(number) for number in range(60)]
    assert all(400 <= one.n_samples <= 20_000 and 0.5 <= one.rate <= 2.0 for one in many)
    for one in many:
        low, high = (0.003, 0.03) if one.is_recording else (0.01, 0.2)
        assert low <= one.noise <= high
        known = {"nothing": (None,), "listed": one.plant.kinds, "unlisted": unlisted_kinds()}
        assert one.kind in known[one.missing]
    assert {one.missing for one in many} == {"nothing", "listed", "unlisted"}
    assert {one.plant.name for one in many} == set(FRESH_PLANTS)
    # a third, of sixty; a fifth of the plants are maps, of which there are no recordings
    assert 8 <= sum(one.is_recording for one in many) <= 28


@pytest.mark.parametrize("name", [name for name in FRESH_PLANTS if name not in ("beam", "sampled")])
def test_nothing_slides_along_a_guard(name):
    for seed in range(3):
        plant = FRESH_PLANTS[name](np.random.RandomState(seed), 1.0)
        done = reference_run(plant)
        # at the samples the guard's state moves to the same side in both modes
        own = int(np.argmax(np.abs(plant.guard(np.eye(2)) - plant.guard(np.zeros((1, 2))))))
        fields = [
            plant.velocities(done.x, done.u, np.full(done.modes.shape, mode))[..., own]
            for mode in (0, 1)
        ]
        assert np.mean(fields[0] * fields[1] < 0.0) == 0.0


def test_short_stays_by_hand():
    # stays of 2, 3, 4 and 1 samples between a first and a last one; then none that ends
    chatters = [0, 0, 1, 1, 0, 0, 0, 1, 1, 1, 1, 0, 1, 1, 1]
    modes = np.column_stack([chatters, np.ones(15, dtype=int)])
    assert in_short_stays(modes) == (2 + 3 + 1) / 30


def test_a_heater_at_its_guard_slides_and_a_motor_does_not():
    assert Drawn.of(13031).plant.name == "heater" and Drawn.of(13031).slides
    assert Drawn.of(13024).plant.name == "motor" and not Drawn.of(13024).slides


def test_a_faster_record_is_of_the_same_plant_under_the_same_drive():
    slow, fast = (FRESH_PLANTS["motor"](np.random.RandomState(0), rate) for rate in (1.0, 2.0))
    np.testing.assert_array_equal(slow.coef, fast.coef)
    assert fast.time_step == slow.time_step / 2.0
    assert fast.drive.periods[0] * fast.time_step == slow.drive.periods[0] * slow.time_step


@pytest.mark.parametrize("name", FRESH_PLANTS)
def test_what_a_plant_is_said_to_have_can_be_planted(name):
    plant = FRESH_PLANTS[name](np.random.RandomState(1), 1.0)
    for kind in plant.kinds:
        data = planted_record(plant, kind, n_samples=400, n_trajectories=4, random_state=0)
        assert np.isfinite(data.X).all() and np.isfinite(data.Xdot).all(), kind
        assert data.effects[0].kind == kind


@pytest.mark.nightly
def test_a_search_in_a_drawn_record_is_told_with_its_verdict():
    number = next(n for n in range(200) if _is_small(Drawn.of(n)))
    [record] = run_fresh(number)
    assert record["cell"] == number and record["verdict"] == "right"
    assert record["found"] == [] and record["told_change"] == 1.0
    counts = fresh_counts([record])
    assert counts["counts"]["all"]["nothing"] == {"right": 1}
    text = fresh_tables({"searches": counts | {"origin": {"commit": "a", "day": "b"}}})
    assert "| all | 0/0 | 0 | 0 | 0 | 0/0 | 0 | 0 | 0/1 |" in text


def _is_small(drawn):
    return drawn.missing == "nothing" and drawn.n_samples < 600 and not drawn.is_recording


def test_a_miss_counts_as_too_small_only_where_the_truth_says_so_and_what_slides_counts_apart():
    one = {
        "plant": "beam",
        "cell": 0,
        "rows": 500,
        "noise": 0.1,
        "is_recording": False,
        "kind": "lag",
    }
    one |= {"kind": "lag", "missing": "listed", "found": [], "told_change": 1.0, "seconds": 1.0}
    one |= {"verdict": "missed", "visible": 1.5, "slides": False}
    apart = {**one, "slides": True}
    counts = fresh_counts([{**one, "visible": 1.01}, one, apart])
    assert counts["counts"]["all"]["listed"] == {"too small": 1, "missed": 1}
    assert (len(counts["wrong"]), counts["sliding"], len(counts["wrong_where_it_slides"])) == (
        2,
        1,
        1,
    )
    no_name = fresh_counts([{**one, "missing": "unlisted", "visible": 1.01}])
    assert no_name["counts"]["all"]["unlisted"] == {"too small": 1}
    text = fresh_tables({"searches": counts | {"origin": {"commit": "a", "day": "b"}}})
    assert "Of 1 more records, whose plants slide along their guards" in text


# -- sensitivity -----------------------------------------------------------------------------------


def test_a_constant_is_changed_in_every_room_and_is_its_own_again():
    from swsysid._effect_search.chance import SETTINGS as seen_elsewhere

    own = SETTINGS.gain_a_row
    with Change("gain_a_row", 2.0).made():
        assert seen_elsewhere.gain_a_row == 2.0 * own
    assert SETTINGS.gain_a_row == own
    own = _base.N_LEVELS
    with Change("N_LEVELS", 0.5).made():
        assert _base.N_LEVELS == _bristles.N_LEVELS == _characteristics.N_LEVELS == own // 2
    assert _base.N_LEVELS == _bristles.N_LEVELS == _characteristics.N_LEVELS == own


def test_a_share_near_one_stays_below_one_and_a_count_is_whole():
    assert Change("_SURE", 2.0).value == pytest.approx(0.9)
    assert Change("_SURE", 0.5).value == pytest.approx(0.975)
    assert Change("n_folds", 0.5).value == 2
    assert {"gain_a_row", "N_LEVELS"} <= set(constants()) and "_KNOTS" not in constants()


def test_constants_that_change_an_answer_come_first_and_the_others_are_named():
    base = {"constant": BASE, "factor": 1.0, "records": [1, 2], "seconds": [1.0, 1.0]}
    base |= {"value": 1.0, "found": [["lag of x2"], []], "verdict": ["right", "right"]}
    tie = base | {"constant": "tie", "factor": 2.0, "value": 6.0}
    gap = base | {"constant": "gap", "factor": 2.0, "value": 0.02}
    gap |= {"found": [["lag of x2"], ["bias of constant"]], "verdict": ["right", "false alarm"]}
    text = sensitivity_tables(
        {"changes": condensed([base, tie, gap]) | {"origin": {"commit": "a", "day": "b"}}}
    )
    assert "| `gap` |  |  |  | 0.02 | 1 | 1 |" in text
    assert "No answer changes with `tie`." in text


@pytest.mark.nightly
def test_a_mode_that_acts_in_an_eighth_of_the_rows_is_found():
    (record,) = run_fresh(2038)  # few blocks of a test see it
    assert record["kind"] == "extra_mode"
    assert record["found"][0] == "extra_mode of modes"
    assert record["told_change"] < 0.8  # of two equations, one of which falls to a tenth or so


@pytest.mark.nightly
def test_a_gain_of_two_per_cent_beyond_a_threshold_is_a_saturation():
    (record,) = run_fresh(14028)  # by 2 of 2900 nats, of which a filter makes as much
    assert record["found"] == ["saturation of x2"]


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("number", "kind", "place"),
    [
        # a gain change, of which it is a special case, explains half a per cent more
        (13024, "dead_zone", "x2"),
        # beside wrong modes its gain lies in too few blocks of rows to be significant
        (2008, "saturation", "x2"),
        # a declared mode has seven rows, whose laws predict nothing of those that are held out
        (2027, "dead_zone", "x2"),
        # two effects with a name, one the other's opposite, were a step that a mode begins with
        (11019, "extra_mode", "modes"),
        # a tenth of the rows were gross errors of every law but the right one, and had no weight
        (11028, "power_law", "x2"),
        # modes told by laws that lack it put the surface where only one was left
        (14023, "power_law", "x2"),
    ],
)
def test_what_was_once_missed_or_misnamed_is_found(number, kind, place):
    (record,) = run_fresh(number)
    assert record["kind"] == kind
    assert record["found"][0] == f"{kind} of {place}"
    assert record["told_change"] < 0.8  # of two equations, one of which falls to a tenth or so


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("number", "kind", "place"),
    [
        # of 473 rows a function of two channels had too few to be told without a product beside it
        (3021, "gated_damping", "x0, times x1"),
        # at the modes of the declared model the shape in the place of two names was another one
        (3035, "hump", "x1"),
        # the modes of the declared model are so wrong that three other shapes explain more
        (5004, "rational", "x1"),
        # a sine of the same channel had driven it out, and was refused by the untouched rows
        (8024, "hump", "x1"),
    ],
)
def test_what_once_had_a_wrong_name_or_channel_is_unknown(number, kind, place):
    (record,) = run_fresh(number)
    assert record["kind"] == kind
    assert record["found"] == [f"unknown_function of {place}"]
    assert record["told_change"] < 0.75  # of two equations, one of which falls to a tenth


@pytest.mark.nightly
def test_a_force_in_a_recording_is_remembered_for_longer_than_its_filter():
    # over ten rows, of which the filter joins three; what it joins was taken to be eight
    (record,) = run_fresh(8001)
    assert record["kind"] == "random_disturbance"
    assert record["found"] == ["unmeasured_disturbance of time"]


@pytest.mark.nightly
def test_a_force_stays_where_rollouts_refuse_a_lag_beside_it():
    (record,) = run_fresh(18007)
    assert record["kind"] == "random_disturbance"
    assert record["found"] == ["unmeasured_disturbance of time"]


@pytest.mark.nightly
def test_a_force_of_two_samples_that_is_noise_is_no_lag():
    (record,) = run_fresh(21013)
    assert record["kind"] == "random_disturbance"
    assert record["found"] == []


@pytest.mark.nightly
def test_a_guard_that_suits_the_modes_better_than_the_surface_need_not_remember():
    # the band was half as wide as the noise of the state; the surface is one of 77 rows
    (record,) = run_fresh(10004)
    assert record["kind"] == "saturation"
    assert not any(one.startswith("guard_hysteresis") for one in record["found"])


@pytest.mark.nightly
def test_rollouts_far_from_the_data_do_not_refuse_a_shape_that_velocities_show():
    # prey and predators: an error of a third, and rollouts .49 of the spread instead of .29
    (record,) = run_fresh(14010)
    (found,) = record["found"]
    assert found.endswith(" of x0")
    assert "unknown_function" in (found.split()[0], *record["rivals"][0])
