r"""What a guard that remembers is worth where velocities were made of measured states.

No window reaches across a switch, so that hardly a velocity says where a recording switches. The
modes that the states have told do. A guard is compared with the surface of the same fit by the
samples next to the switches: where a share w of them is in another mode than it says, each of them
is worth :math:`\log w`, and each of the others :math:`\log(1 - w)`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swsysid._data.records import Records
from swsysid._effect_model.joint_fit import JointFit, known_modes
from swsysid._effect_search.folds import SearchData
from swsysid._results import Array

Modes = NDArray[np.intp]


def gain_of_guard(fit: JointFit, data: SearchData) -> Array:
    """Log likelihood of the switches by the guard less that by the surface, (n_rows,).

    A sample counts with the row next to it.
    """
    records, gain = data.records, np.zeros(len(data.rows))
    if fit.guard is None or records.told is None:
        return gain
    known = known_modes(fit, records, data.rows)
    near = known >= 0
    near[data.rows] = False
    if not near.any():
        return gain
    by_surface, by_guard = (
        (modes != known)[near] for modes in (fit.surface_modes(records), fit.predict_modes(records))
    )
    # Neighbours are wrong together: the samples of a stretch say the same once.
    stretches = max(1, int(np.sum(np.diff(by_surface.astype(int), prepend=0) > 0)))
    together = max(1.0, by_surface.sum() / stretches)
    worth = (_cost(by_surface, data) - _cost(by_guard, data)) / together
    owner = _nearest(records, data.rows)[near]
    inside = owner >= 0
    np.add.at(gain, owner[inside], worth[inside])
    return gain


def _cost(wrong: NDArray[np.bool_], data: SearchData) -> Array:
    """Negative log likelihood of each sample by the share that is wrong."""
    share = float(np.clip(wrong.mean(), data.settings.surprise, 0.5))
    return -np.log(np.where(wrong, share, 1.0 - share))


def _nearest(records: Records, rows: NDArray[np.intp]) -> NDArray[np.intp]:
    """Number of the row nearest in time to each sample, -1 where its trajectory has none."""
    answer, number = np.full(len(records), -1), np.full(len(records), -1)
    number[rows] = np.arange(len(rows))
    for trajectory in records.trajectories:
        places = np.flatnonzero(number[trajectory] >= 0)
        if len(places):
            middles = 0.5 * (places[1:] + places[:-1])
            own = places[np.searchsorted(middles, np.arange(len(trajectory)))]
            answer[trajectory] = number[trajectory][own]
    return answer
