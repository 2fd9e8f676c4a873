"""Two modes that one law of long memory joins, and a guard that is seen seldom."""

import numpy as np

from swsysid import HybridAutomatonRegressor
from swsysid._data.features import FeatureMap
from swsysid._data.recordings import Record
from swsysid._discrete_stays.data import DiscreteData
from swsysid._discrete_stays.lagged import lagged_rows
from swsysid._discrete_stays.relations import parted_by_relations
from swsysid._discrete_stays.rows import alternate, law_of


def triangle(start, mode, length):
    """A state that goes up by .07 to 5 and down to 0, and one that follows the last two modes."""
    x, y, states, modes = start, [0.0, 0.0], [], []
    for _ in range(length):
        before = modes[-1] if modes else mode
        mode = 1 if mode == 0 and x >= 5.0 else 0 if mode == 1 and x <= 0.0 else mode
        states.append((x, y[-1]))
        modes.append(mode)
        x += -0.07 if mode else 0.07
        y = [y[-1], 1.6 * y[-1] - 0.7 * y[0] + 0.05 * (2 - mode - before)]
    return np.array(states), np.array(modes)


def test_modes_that_a_lag_remembers_are_parted_by_relations_of_their_rows():
    seen = [triangle(start, mode, 600) for start, mode in [(0.5, 0), (2.3, 1), (4.1, 0), (3.03, 1)]]
    records = [Record(np.arange(600.0), x, np.empty((600, 0))) for x, _ in seen]
    rows = lagged_rows(records, 1)
    data = DiscreteData.of(rows, FeatureMap(1, rows.columns, rows.names))
    # x[k+1] = 2 x[k] - x[k-1] is the law of both; one row at each turn follows none
    one = alternate(data.problem, law_of(data.problem, np.ones(len(rows), dtype=bool))[None])
    assert len(one.coef) == 1
    both = parted_by_relations(data, one, 4)
    assert both is not None and len(both.coef) == 2
    true = np.concatenate([modes[1:-1] for _, modes in seen])
    told = ~both.unexplained
    right = np.mean(both.modes[told] == true[told])
    assert max(right, 1.0 - right) == 1.0
    # each goes up or down by .07, whatever the older row is
    steps = sorted(data.coef(both.coef)[:, 0, 0])
    np.testing.assert_allclose(steps, [-0.07, 0.07], atol=1e-9)
    assert parted_by_relations(data, both, 4) is None


def test_free_rollouts_ask_for_the_modes_that_one_law_joins():
    """Rows alone prefer the one law, which jumps at each turn and never by itself."""
    seen = [triangle(start, mode, 150)[0] for start, mode in [(0.5, 0), (2.3, 1)]]
    recordings = [{"t": np.arange(150), "x": x} for x in seen]
    found = HybridAutomatonRegressor(lags=1, discrete_time=True).fit(recordings)
    assert found.n_modes_ == 2 and found.report_.rollouts.holds
    unseen, modes = triangle(4.1, 0, 150)
    rising = int(found.coef_[:, 0, 0].argmax())
    run = found.simulate(unseen[:2], np.arange(150), mode=rising if modes[1] == 0 else 1 - rising)
    # turned anywhere between two samples, a step late at most
    assert np.abs(run.x - unseen)[:, 0].max() < 0.15


def test_a_guard_that_is_seen_seldom_shares_the_one_that_is_seen_often():
    """Mode 0 and mode 1 are both left at 2; mode 1 is left twice, by steps of a third."""

    def run(x, mode, length):
        states = []
        for _ in range(length):
            states.append(x)
            mode = {0: 2, 1: 2}.get(mode, mode) if x >= 2.0 else mode
            mode = (0 if x > -0.5 else 1) if mode == 2 and x <= 0.0 else mode
            x += (0.011, 0.33, -0.53)[mode]
        return {"t": np.arange(length), "x": np.array(states)[:, None]}

    recordings = [run(start, 0, 700) for start in (0.1, 0.4, 0.9)]
    recordings += [run(start, 1, 40) for start in (0.05, 0.2)]
    found = HybridAutomatonRegressor(3, discrete_time=True).fit(recordings)
    levels = {
        (one.source, one.target): -one.guard.coef[~one.guard.powers.any(axis=1)][0]
        / one.guard.coef[one.guard.powers[:, 0] == 1][0]
        for one in found.transitions_
        if one.guard is not None
    }
    fall = int(found.coef_[:, 0, 0].argmin())
    into = {pair: level for pair, level in levels.items() if pair[1] == fall}
    assert len(into) == 2
    # the one that is seen often lies between samples that are .011 apart; the other shares it
    np.testing.assert_allclose(list(into.values()), 2.0, atol=0.011)
