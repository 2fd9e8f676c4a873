"""Modes parted where one leaves much: asked for by free rollouts alone."""

import numpy as np

from swsysid._data.features import FeatureMap
from swsysid._data.recordings import Record
from swsysid._discrete_stays.data import DiscreteData
from swsysid._discrete_stays.found import Found
from swsysid._discrete_stays.lagged import lagged_rows
from swsysid._discrete_stays.more_modes import finer_modes
from swsysid._discrete_stays.rows import alternate

RATES, LEVELS = (0.97, 0.95), (2.0, -2.0)


def relay(start, length):
    """A state that goes to 2 until it is above 1, and to -2 until it is below -1."""
    x, mode, rows, modes = start, 0, [], []
    for _ in range(length):
        mode = 1 if x > 1.0 else 0 if x < -1.0 else mode
        rows.append(x)
        modes.append(mode)
        x = RATES[mode] * x + (1.0 - RATES[mode]) * LEVELS[mode]
    return np.array(rows)[:, None], np.array(modes)


def test_no_modes_are_parted_that_leave_nothing():
    seen = [relay(start, 400) for start in (-0.9, 0.1)]
    records = [Record(np.arange(400.0), x, np.empty((400, 0))) for x, _ in seen]
    rows = lagged_rows(records, 0)
    data = DiscreteData.of(rows, FeatureMap(1, rows.columns, rows.names))
    laws = np.array(
        [[[(1.0 - rate) * level, rate]] for rate, level in zip(RATES, LEVELS, strict=True)]
    )
    both = alternate(data.problem, laws * data.feature_unit / data.target_unit[:, None])
    assert len(both.coef) == 2 and finer_modes(data, Found(both, None, ()), 4) is None
    one = Found(alternate(data.problem, both.coef[:1]), None, ())
    assert finer_modes(data, one, 1) is None
    found = finer_modes(data, one, 4)
    assert found is not None and len(found.coef) == 2
    true = np.concatenate([modes[:-1] for _, modes in seen])
    right = np.mean(found.fit.modes == true)
    assert max(right, 1.0 - right) == 1.0
