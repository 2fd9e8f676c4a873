"""Recordings that were started anew amid a run, and plants that jump by themselves."""

import numpy as np
import pytest

from swsysid._cli.measurement import Measurement
from swsysid._cli.samples import measure
from swsysid._tables.table import Table

T = np.arange(0.0, 4.0, 0.01)
STARTS = ((1.0, 0.0), (0.2, 1.0), (-0.5, 0.0))


def oscillation(x, v):
    """x'' = -9 x, from a start."""
    phase = 3.0 * T
    return np.column_stack(
        [x * np.cos(phase) + v / 3.0 * np.sin(phase), v * np.cos(phase) - 3.0 * x * np.sin(phase)]
    )


def bounces():
    """A ball that comes down on a plate with 5 m/s and leaves it with 4, then 3.2, ..."""
    rows, height, speed = [], 0.0, 5.0
    for _ in range(3 * len(T)):
        rows.append((height, speed))
        height, speed = height + 0.01 * speed - 0.5e-4 * 9.81, speed - 0.0981
        if height < 0.0:
            height, speed = 0.0, -0.8 * speed
    return np.array(rows)


def table(states):
    """All rows after each other, in a clock that goes on; noise of .002."""
    noise = 0.002 * np.random.default_rng(0).standard_normal(states.shape)
    x, v = (states + noise).T
    return Table("log.csv", {"t": 0.01 * np.arange(len(x)), "x": x, "v": v}, {})


STARTED = np.vstack([oscillation(*one) for one in STARTS])


@pytest.mark.parametrize(
    ("states", "order"), [(("x", "v"), 1), (("x",), 2)], ids=["measured", "positions"]
)
def test_rows_at_which_all_states_jump_are_named_and_begin_runs(states, order):
    """The second start is the sample after 400, the third the one after 800."""
    what = Measurement(states=states, time="t", order=order)
    samples = measure(table(STARTED), what)
    (told,) = [one for one in samples.remarks if "jump at once" in one]
    assert told.startswith("All states jump at once before rows 401, 801: ")
    assert "--restarts" in told and len(set(samples.groups)) == 1
    asked = Measurement(states=states, time="t", order=order, restarts=True)
    samples = measure(table(STARTED), asked)
    assert "All states jump at once, and a new run begins: rows 401, 801." in samples.remarks
    rows = [int(np.sum(samples.recorded.groups == label)) for label in ("0", "0.2", "0.3")]
    assert rows == [len(T)] * 3


@pytest.mark.parametrize(
    ("states", "columns"),
    [(bounces(), ("x", "v")), (STARTED, ("v",)), (oscillation(1.0, 0.0), ("x", "v"))],
    ids=["impacts", "a single state", "one run"],
)
def test_what_a_plant_may_do_by_itself_is_no_restart(states, columns):
    what = Measurement(states=columns, time="t", restarts=True)
    samples = measure(table(states), what)
    assert not any("jump at once" in one for one in samples.remarks)
    assert len(set(samples.groups)) == 1
