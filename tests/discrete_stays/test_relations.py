"""Two modes that one law of long memory joins, and a guard that is seen seldom."""

import numpy as np

from swsysid import HybridAutomatonRegressor


def triangle(start, mode, length):
    """A state that goes up by .07 to 5 and down to 0, and one that follows it with two lags."""
    x, y, states, modes = start, [0.0, 0.0], [], []
    for _ in range(length):
        mode = 1 if mode == 0 and x >= 5.0 else 0 if mode == 1 and x <= 0.0 else mode
        states.append((x, y[-1]))
        modes.append(mode)
        x += -0.07 if mode else 0.07
        y = [y[-1], 1.6 * y[-1] - 0.7 * y[0] + (0.0 if mode else 0.1)]
    return np.array(states), np.array(modes)


def test_modes_that_a_lag_remembers_are_parted_where_rollouts_ask_for_it():
    seen = [triangle(start, mode, 600) for start, mode in [(0.5, 0), (2.3, 1), (4.1, 0), (3.03, 1)]]
    recordings = [{"t": np.arange(len(x)), "x": x} for x, _ in seen]
    found = HybridAutomatonRegressor(lags=1, discrete_time=True).fit(recordings)
    # x[k+1] = 2 x[k] - x[k-1] is the law of both, and tells no switch of a recording's first stay
    assert found.n_modes_ == 2
    modes = np.concatenate([modes for _, modes in seen])
    assert max(np.mean(found.modes_ == modes), np.mean(found.modes_ != modes)) > 0.99
    x, modes = triangle(1.23, 0, 600)
    up = int(found.modes_[1])
    run = found.simulate(x[:2], np.arange(len(x)), mode=up)
    # rounding alone: laws of highest likelihood without noise
    np.testing.assert_allclose(run.x, x, atol=1e-6)


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
