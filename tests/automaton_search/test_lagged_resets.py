"""A motion sampled in its position alone: at a switch the whole lagged state is made anew."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import expm

from swsysid import HybridAutomatonRegressor
from swsysid._automaton_search import sampled
from swsysid._automaton_search.mode_rows import ModeRows
from swsysid._data.recordings import Record
from swsysid._discrete_stays.identify import identify_stays

STEP = 0.05
FIELDS = {
    2: [np.array([[0.0, 1.0], [-0.8, -0.5]]), np.array([[0.0, 1.0], [-2.0, -0.5]])],
    3: [np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-stiff, -1.2, -1.5]]) for stiff in (0.8, 2.0)],
}


def recordings(order, count, seed=0):
    """Position, modes and input of a chain of integrators that switches at 1 and back at .2."""
    flows = [expm(STEP * field) for field in FIELDS[order]]
    unit = np.eye(order)[-1]
    driven = [
        np.linalg.solve(field, (flow - np.eye(order)) @ unit)
        for field, flow in zip(FIELDS[order], flows, strict=True)
    ]
    generator, found = np.random.default_rng(seed), []
    for _ in range(count):
        state, mode, positions = generator.uniform(-0.5, 0.5, order), 0, []
        u = np.repeat(generator.uniform(-0.2, 2.5, 20), 30)
        for force in u:
            positions.append(state[0])
            if (mode == 0 and state[0] >= 1.0) or (mode == 1 and state[0] <= 0.2):
                mode = 1 - mode
            state = flows[mode] @ state + driven[mode] * force
        found.append({"t": np.arange(len(u)), "x": np.array(positions)[:, None],
                      "inputs": u[:, None]})  # fmt: skip
    return found


@pytest.mark.parametrize("order", [2, 3])
def test_rollouts_of_unseen_recordings_are_exact(order):
    *seen, unseen = recordings(order, 5)
    found = HybridAutomatonRegressor(2, lags=order - 1, discrete_time=True).fit(seen)
    run = found.simulate(
        unseen["x"][:order],
        unseen["t"],
        unseen["inputs"],
        mode=int(found.modes_[order]),
        input_hold="zero",
    )
    # resets are told to a millionth of a spread; without them positions are off by a hundredth
    assert np.abs(run.x - unseen["x"]).max() < 2e-5
    assert all(one.reset.matrix.shape == (order, order) for one in found.transitions_)
    assert all((one.reset.matrix[0] == np.eye(order)[0]).all() for one in found.transitions_)
    levels = sorted(
        -one.guard.coef[~one.guard.powers.any(axis=1)][0]
        / one.guard.coef[one.guard.powers[:, 0] == 1][0]
        for one in found.transitions_
    )
    # anywhere between two samples, which are up to .04 apart
    np.testing.assert_allclose(levels, [0.2, 1.0], atol=0.02)
    assert "follow none of the laws" not in str(found.report_)


def test_a_state_that_jumps_still_resets_its_newest_row():
    """x[k+1] = .9 x[k] + .05 x[k-1] + .2, taken to .3 where it reaches 2: the newest row jumps."""
    x = [0.0, 0.1]
    for _ in range(400):
        new = 0.9 * x[-1] + 0.05 * x[-2] + 0.2
        x.append(0.3 if new >= 2.0 else new)
    found = HybridAutomatonRegressor(1, lags=1, discrete_time=True).fit(
        np.array(x)[:, None], np.arange(len(x))
    )
    [jump] = found.transitions_
    assert jump.reset.matrix.shape == (1, 1)
    np.testing.assert_allclose([jump.reset.matrix[0, 0], jump.reset.offset[0]], [0.0, 0.3],
                               atol=1e-6)  # fmt: skip


def test_what_is_left_before_a_jump_counts_and_is_of_its_own_recording():
    """x[k+1] = .5 x[k] + .2 x[k-1] + .1 x[k-2] + 1, which leaves 3 of some rows."""
    given = []
    for start in (0.0, 5.0):
        x = [start, start + 1.0, start]
        for _ in range(40):
            x.append(0.5 * x[-1] + 0.2 * x[-2] + 0.1 * x[-3] + 1.0)
        given.append(Record(np.arange(43.0), np.array(x)[:, None], np.empty((43, 0))))
    stays = identify_stays(given, 2, library=1, n_modes=1)
    straddling = np.zeros(len(stays.rows), dtype=bool)
    # the first and the last row of each, and two in a row
    straddling[[0, 19, 20, 39, 40, 79]] = True

    def leaving(size):
        targets = stays.rows.targets.copy()
        targets[straddling] += 3.0
        targets[19] += size - 3.0
        own = replace(stays, straddling=straddling, rows=replace(stays.rows, targets=targets))
        return ModeRows(own, SimpleNamespace(records=given))

    rows = leaving(3.0)
    assert rows.taken.rows.tolist() == [1, 21, 41]
    np.testing.assert_allclose(rows.left_before(rows.taken), [[0.0], [3.0], [0.0]], atol=1e-9)
    # half of the nats of three switches: so many rows are of those before
    costs = [sampled._cost_of_reset(rows.taken, leaving(size)) for size in (3.0, 0.3)]
    assert costs[0] - costs[1] == pytest.approx(3 * 0.5 * np.log(10.0), rel=1e-6)
