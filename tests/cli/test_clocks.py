"""Channels with clocks of their own: states where they were measured, inputs held or on lines."""

import numpy as np
import pytest

from swsysid import SwitchingSystemRegressor, TrajectoryIdentifier
from swsysid._cli.clocks import with_own_clocks
from swsysid._cli.measurement import Measurement
from swsysid._cli.samples import measure
from swsysid._cli.text import preparation
from swsysid._tables.table import Table, TableError

N = 600
T = 0.01 * np.arange(N)
RNG = np.random.default_rng(0)
X = np.sin(1.3 * T) + 1e-3 * RNG.standard_normal(N)
V = 1.3 * np.cos(1.3 * T) + 1e-3 * RNG.standard_normal(N)
COMMAND = RNG.normal(size=N // 10)  # a new one every ten rows
WHAT = Measurement(states=("x", "v"), inputs=("u",), time="t")


def union(**channels):
    """A table with a row for each time of any channel, and holes where the others have none."""
    every = np.unique(np.concatenate([t for t, _ in channels.values()]))
    columns = {"t": every}
    for name, (t, values) in channels.items():
        columns[name] = np.full(len(every), np.nan)
        columns[name][np.searchsorted(every, t)] = values
    return Table("log", columns, {})


def at(t):
    """The held command, 3 ms late."""
    return COMMAND[np.clip(np.floor((t - 0.003) / 0.1 + 1e-9), 0, None).astype(int)]


SLOW = (T[::10] + 0.003, COMMAND)


def test_a_slow_input_is_held_at_the_times_of_the_states():
    recorded = measure(union(x=(T, X), v=(T, V), u=SLOW), WHAT).recorded.of_samples()
    np.testing.assert_array_equal(recorded.t, T[1:])  # before its first sample it is not known
    np.testing.assert_array_equal(recorded.states, np.column_stack([X, V])[1:])
    np.testing.assert_array_equal(recorded.inputs[:, 0], at(T[1:]))


@pytest.mark.parametrize("late", [0.003, 0.0])
def test_a_held_input_steps_at_its_own_instants(late):
    """Not on a line from one sample of the states to the next."""
    samples = measure(union(x=(T, X), v=(T, V), u=(T[::10] + late, COMMAND)), WHAT)
    recorded, left_out = samples.recorded, [r for r in samples.remarks if r.startswith("Left out")]
    assert [each.partition(" rows")[0] for each in left_out] == ["Left out: 2 of 660"] * bool(late)
    limits = ~recorded.holds_a_state
    sides = 2 if late else 1  # the right one stands beside the state that was measured there
    np.testing.assert_array_equal(recorded.t[limits], np.repeat(T[10::10] + late, sides))
    np.testing.assert_array_equal(recorded.inputs[limits][::sides, 0], COMMAND[:-1])
    area = np.sum(np.diff(recorded.t) * (recorded.inputs[1:, 0] + recorded.inputs[:-1, 0]) / 2)
    ends = np.clip([*(T[::10] + late), T[-1]], recorded.t[0], None)
    np.testing.assert_allclose(area, np.sum(np.diff(ends) * COMMAND), atol=1e-12)


def test_commands_between_the_samples_of_a_state_leave_nothing_but_noise():
    rng = np.random.default_rng(7)
    times = np.r_[0.0, np.sort(rng.uniform(0.0, 6.0, 40))]
    levels = rng.normal(size=len(times))
    grid = np.arange(0.0, 6.0, 0.05)
    x, last = np.zeros(len(grid)), 0.0  # x' = 3 u - 2 x, exactly from one instant to the next
    every = np.union1d(grid, times)
    for begin, end in zip(every[:-1], every[1:], strict=True):
        goal = 1.5 * levels[np.searchsorted(times, begin, side="right") - 1]
        last = goal + (last - goal) * np.exp(-2.0 * (end - begin))
        x[grid == end] = last
    noisy = x + 0.002 * rng.standard_normal(len(x))
    what = Measurement(states=("x",), inputs=("u",), time="t")
    recorded = measure(union(x=(grid, noisy), u=(times, levels)), what).recorded
    estimator = SwitchingSystemRegressor(1, feature_library=1, random_state=0)
    found = TrajectoryIdentifier(estimator).fit(*recorded.named(("x", "u"), slice(None)))
    errors = found.coef_errors_[0, 0]
    assert (np.abs(found.estimator_.coef_[0, 0] - [0.0, -2.0, 3.0]) <= 3.0 * errors).all()
    assert (errors <= 0.02).all() and found.report_.excess[0] <= 1.2


def test_steps_belong_to_the_run_in_which_they_lie():
    table = union(x=(T, X), v=(T, V), u=SLOW)
    columns = {name: np.concatenate([each, each]) for name, each in table.columns.items()}
    recorded = measure(Table("log", columns, {}), WHAT).recorded
    assert np.unique(recorded.groups).tolist() == [0, 1]
    for label in (0, 1):
        t = recorded.t[recorded.groups == label]
        assert (np.diff(t) >= 0.0).all()
        assert np.count_nonzero(np.diff(t) == 0.0) == len(COMMAND) - 1


@pytest.mark.parametrize(
    ("t", "values", "hold", "line"),
    [
        (*SLOW, (), True),  # as asked for
        (T[::10] + 0.003, np.sin(T[::10]), None, True),  # moves gradually
        (T + 0.003, X + V, None, True),  # as fast as the states
        (T[::10] + 0.003, np.sin(T[::10]), ("u",), False),
        (T[::10] + 0.003, (T[::10] % 2 > 1).astype(float), None, False),  # a switch
    ],
)
def test_an_input_lies_on_lines_where_it_moves_gradually_or_is_asked_to(t, values, hold, line):
    what = Measurement(states=("x", "v"), inputs=("u",), time="t", hold=hold)
    samples = measure(union(x=(T, X), v=(T, V), u=(t, values)), what)
    recorded = samples.recorded.of_samples()
    inside = recorded.t <= t[-1]
    expected = values[np.searchsorted(t, recorded.t, side="right") - 1]
    if line:
        expected = np.interp(recorded.t, t, values)
    np.testing.assert_allclose(recorded.inputs[inside, 0], expected[inside], atol=1e-12)
    told = "lies on a line" if line else "keeps its value"
    assert any("u has times of its own" in each and told in each for each in samples.remarks)


def test_states_of_different_clocks_are_used_where_they_were_measured():
    late = T + 0.004
    recorded = measure(
        union(x=(T, X), v=(late, V)), Measurement(states=("x", "v"), time="t")
    ).recorded
    known = np.isfinite(recorded.states)
    np.testing.assert_array_equal(recorded.states[known[:, 0], 0], X)
    np.testing.assert_array_equal(recorded.states[known[:, 1], 1], V)
    assert len(recorded.t) == 2 * N and (known.sum(axis=1) == 1).all()


def test_rows_one_rounding_apart_are_one():
    other = np.cumsum(np.r_[0.0, np.full(N // 10 - 1, 0.1)])  # 0.1 + 0.1 + 0.1 is not 0.3
    table = union(x=(T, X), v=(T, V), u=(other, COMMAND))
    more = len(table.columns["t"]) - N
    samples = measure(table, WHAT)
    recorded = samples.recorded.of_samples()
    assert more and samples.remarks[0].endswith(f"one rounding apart, are one: {more} rows joined.")
    np.testing.assert_allclose(recorded.t, T, atol=1e-12)
    np.testing.assert_array_equal(recorded.inputs[:, 0], np.repeat(COMMAND, 10))


def test_rows_one_rounding_apart_are_one_although_they_were_filled_forward():
    other = np.cumsum(np.r_[0.0, np.full(N // 10 - 1, 0.1)])
    table = union(x=(T, X), v=(T, V), u=(other, COMMAND))
    for column in table.columns.values():
        last = np.maximum.accumulate(np.where(np.isfinite(column), np.arange(len(column)), 0))
        column[:] = column[last]
    recorded = measure(table, WHAT).recorded
    np.testing.assert_allclose(recorded.t, T, atol=1e-12)
    np.testing.assert_array_equal(recorded.states, np.column_stack([X, V]))
    assert np.mean(recorded.inputs[:, 0] == np.repeat(COMMAND, 10)) > 0.99


def test_two_rows_at_exactly_one_time_are_not_joined():
    t, u = np.sort(np.r_[T, T[::50]]), np.repeat([0.0, 1.0], N // 2 + 6)
    columns = {"t": t, "x": np.sin(t), "v": np.cos(t), "u": u}
    table = Table("log", columns, {})
    assert with_own_clocks(table, WHAT) is table


def test_channels_that_stand_one_below_the_other_are_one_recording():
    columns = {"t": np.r_[T, T[::10]], "x": np.r_[X, np.full(N // 10, np.nan)]}
    columns["v"] = np.r_[V, np.full(N // 10, np.nan)]
    columns["u"] = np.r_[np.full(N, np.nan), COMMAND]
    recorded = measure(Table("log", columns, {}), WHAT).recorded.of_samples()
    np.testing.assert_array_equal(recorded.t, T)
    np.testing.assert_array_equal(recorded.inputs[:, 0], np.repeat(COMMAND, 10))


def test_two_runs_keep_their_inputs_apart():
    one = union(x=(T, X), v=(T, V), u=SLOW)
    columns = {name: np.tile(column, 2) for name, column in one.columns.items()}
    recorded = measure(Table("log", columns, {}), WHAT).recorded.of_samples()
    np.testing.assert_array_equal(recorded.inputs[:, 0], np.tile(at(T[1:]), 2))


def test_a_state_that_was_filled_forward_is_used_at_its_samples_alone():
    slow = V[::10]
    columns = {"t": T, "x": X, "v": np.repeat(slow, 10), "u": at(T + 0.003)}
    samples = measure(Table("log", columns, {}), WHAT)
    values = samples.recorded.states
    np.testing.assert_array_equal(values[:, 0], X)
    np.testing.assert_array_equal(np.flatnonzero(np.isfinite(values[:, 1])), np.arange(0, N, 10))
    assert preparation(samples)[0].startswith("v changes in every 10th row only: it was filled")


@pytest.mark.parametrize(
    "values",
    [
        np.round(X / 0.02) * 0.02,  # an encoder repeats its values where it is slow
        np.repeat(np.arange(N // 10), 10) * 0.1,  # and steps by one quantum at constant speed
        X,
        np.where(np.sin(9.0 * T) > 0.0, 1.0, 0.0) + np.where(np.sin(T) > 0.0, 0.5, 0.0),
    ],
)
def test_what_repeats_its_values_otherwise_is_no_filled_column(values):
    columns = {"t": T, "x": values, "v": V, "u": at(T + 0.003)}
    recorded = measure(Table("log", columns, {}), WHAT).recorded
    np.testing.assert_array_equal(recorded.states[:, 0], values)


def test_values_that_a_tool_put_on_lines_are_suspected_aloud_and_may_be_held():
    lines = np.round(np.interp(T, T[::10], COMMAND), 6)
    columns = {"t": T, "x": X, "v": V, "u": lines}
    samples = measure(Table("log", columns, {}), WHAT)
    assert any("u lies on straight lines between every 10th row" in r for r in samples.remarks)
    np.testing.assert_array_equal(samples.recorded.inputs[:, 0], lines)  # nothing is done
    hold = Measurement(states=("x", "v"), inputs=("u",), time="t", hold=("u",))
    recorded = measure(Table("log", columns, {}), hold).recorded.of_samples()
    held = np.repeat(COMMAND, 10)[: len(recorded.t)]
    np.testing.assert_allclose(recorded.inputs[:590, 0], held[:590], atol=1e-6)


@pytest.mark.parametrize("values", [np.abs(T % 1.0 - 0.5), X, np.repeat(COMMAND, 10), 2.0 * T])
def test_signals_that_are_straight_by_themselves_are_not_suspected(values):
    samples = measure(Table("log", {"t": T, "x": X, "v": V, "u": values}, {}), WHAT)
    assert not any("straight lines" in remark for remark in samples.remarks)


def test_a_column_to_hold_must_be_an_input():
    what = Measurement(states=("x", "v"), inputs=("u",), time="t", hold=("x",))
    with pytest.raises(TableError, match="--hold x is no input; name it with --inputs"):
        measure(union(x=(T, X), v=(T, V), u=SLOW), what)


def test_newest_row_first_and_a_run_that_lacks_a_channel():
    one = union(x=(T, X), v=(T, V), u=SLOW)
    newest = Table("log", {name: column[::-1] for name, column in one.columns.items()}, {})
    recorded = measure(newest, WHAT).recorded.of_samples()
    np.testing.assert_array_equal(recorded.inputs[:, 0], at(T[1:]))
    # the clock starts again: nothing of the first run may stand between rows of the second
    other = union(x=(T, -X), v=(T, -V), u=(T[:2], [0.0, 0.0]))
    other.columns["u"][:] = np.nan
    columns = {name: np.r_[one.columns[name], other.columns[name]] for name in one.columns}
    recorded = measure(Table("log", columns, {}), WHAT).recorded.of_samples()
    np.testing.assert_array_equal(recorded.states, np.column_stack([X, V])[1:])


@pytest.mark.parametrize("names", [("a", "b", ""), (1.0, 2.0, np.nan)])
def test_rows_of_other_channels_belong_to_the_trajectory_around_them(names):
    one = union(x=(T, X), v=(T, V), u=SLOW)
    columns = {name: np.tile(column, 2) for name, column in one.columns.items()}
    run = np.repeat(np.array(names[:2], dtype=object), len(one.columns["t"]))
    run[np.isnan(columns["x"])] = names[2]
    columns["run"] = run if isinstance(names[0], str) else run.astype(float)
    what = Measurement(states=("x", "v"), inputs=("u",), time="t", groups="run")
    recorded = measure(Table("log", columns, {}), what).recorded.of_samples()
    np.testing.assert_array_equal(recorded.inputs[:, 0], np.tile(at(T[1:]), 2))
    assert recorded.labels == list(names[:2])
