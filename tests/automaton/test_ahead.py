"""Maps go ahead in blocks until a transition is taken: the same as row by row."""

import numpy as np
import pytest

from swsysid import HybridAutomaton


def row_by_row(x, u, laws, guards, n_rows, lags):
    """The rule of `HybridAutomaton.simulate`, written down plainly; mode 1 jumps onto itself."""
    rows, modes, events = [np.array(one) for one in x], [0] * lags, []
    mode, entered, before = 0, lags, np.nan
    for k in range(lags, n_rows):
        for target, guard in guards[mode]:
            value = guard(rows[k][0], u[k, 0], k - entered)
            if value >= 0.0 and (target != mode or before < 0.0):
                events.append((k, mode, target))
                if target == mode:
                    rows[k] = rows[k] - 0.7
                mode, entered = target, k
                break
        modes.append(mode)
        before = guards[mode][0][1](rows[k][0], u[k, 0], k - entered)
        rows.append(laws[mode](rows, k, u[k, 0]))
    return np.array(rows[:n_rows]), modes, events


@pytest.mark.parametrize("power", [1, 2])
def test_blocks_are_the_same_as_rows_one_by_one(power):
    """Affine laws (power 1) and others; lags, inputs, a jump onto itself, a timer."""
    square = f"0.001 x[k]^{power}"
    automaton = HybridAutomaton.stated(
        [{"x": f"0.7 x[k] + 0.2 x[k-1] + {square} + 0.01 u[k] + 0.02"},
         {"x": "0.5 x[k] + 0.51 x[k-1] + 0.011"}],
        [(0, 1, "dwell >= 90"), (1, 1, "x >= 2.6", {"x": "x - 0.7"}), (1, 0, "u >= 2.5")],
        states=["x"], inputs=["u"], discrete_time=True, lags=1,
    )  # fmt: skip
    u = np.random.default_rng(0).normal(size=(3000, 1))
    laws = [
        lambda x, k, u: 0.7 * x[k] + 0.2 * x[k - 1] + 0.001 * x[k] ** power + 0.01 * u + 0.02,
        lambda x, k, u: 0.5 * x[k] + 0.51 * x[k - 1] + 0.011,
    ]
    guards = [
        [(1, lambda x, u, dwell: dwell - 90.0)],
        [(1, lambda x, u, dwell: x - 2.6), (0, lambda x, u, dwell: u - 2.5)],
    ]
    x0 = [[0.1], [0.2]]
    rows, modes, events = row_by_row(x0, u, laws, guards, 3000, lags=1)
    done = automaton.simulate(x0, np.arange(3000), u, mode=0)
    assert [(int(e.time), e.before, e.after) for e in done.events] == events
    assert len(events) > 30 and (1, 1) in {event[1:] for event in events}
    np.testing.assert_array_equal(done.modes, modes)
    np.testing.assert_allclose(done.x, rows, atol=1e-9)  # rounding of thousands of steps
