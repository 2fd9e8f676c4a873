r"""What rows next to a switch say, where velocities were made of measured states.

A filter has smeared their velocities: they belong to neither law. No window reaches across a
switch, so that hardly a velocity says where a recording switches; the modes that the states have
told do. A guard that remembers is compared with the surface of the same fit by the samples next to
the switches: where a share w of them is in another mode than it says, each of them is worth
:math:`\log w`, and each of the others :math:`\log(1 - w)`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swsysid._data.records import Records
from swsysid._effect_model.equations import guards_with_effects, laws_with_effects
from swsysid._effect_model.joint_fit import JointFit, known_modes
from swsysid._effect_search.coloured_noise import Stretches, in_trajectories, rows_in_order
from swsysid._effect_search.folds import SearchData
from swsysid._effect_search.settings import REPORT, SETTINGS
from swsysid._results import Array
from swsysid.metrics._modes import best_matching, contingency

_BESIDE_A_SWITCH = 2  # rows on each side whose velocities the shortest filter has smeared


Modes = NDArray[np.intp]
Mask = NDArray[np.bool_]


def gain_of_guard(fit: JointFit, data: SearchData) -> Array:
    """Log likelihood of the switches by the guard less that by the surface, (n_rows,).

    A sample counts with the row next to it.
    """
    records, gain = data.records, np.zeros(len(data.rows))
    if fit.guard is None or records.decoded_modes is None:
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
    share = float(np.clip(wrong.mean(), SETTINGS.surprise, 0.5))
    return -np.log(np.where(wrong, share, 1.0 - share))


def _nearest(records: Records, rows: NDArray[np.intp]) -> NDArray[np.intp]:
    """Number of the row nearest in time to each sample, -1 where its trajectory has none."""
    answer, number = np.full(len(records), -1), np.full(len(records), -1)
    number[rows] = np.arange(len(rows))
    for trajectory in records.trajectories:
        indices = np.flatnonzero(number[trajectory] >= 0)
        if len(indices):
            middles = 0.5 * (indices[1:] + indices[:-1])
            own = indices[np.searchsorted(middles, np.arange(len(trajectory)))]
            answer[trajectory] = number[trajectory][own]
    return answer


def at_smeared_switches(data: SearchData, modes: NDArray[np.intp], left: Array) -> Mask:
    """Rows within half the window of a filter, as what is left of the states shows it.

    A short window shows in nothing but these rows: two on each side always count as smeared. None
    where the windows of a recording end at its switches. What other effects leave may be as smooth
    as if a filter had smeared it: most of the record stays.
    """
    near = np.zeros(len(modes), dtype=bool)
    if not data.records.timed or data.records.average is not None or np.ptp(modes) == 0:
        return near
    order, where = rows_in_order(data)
    inexact = [state for state in range(left.shape[1]) if state not in data.exact_states]
    window = max((where.smeared(left[order, state]) for state in inexact), default=1)
    half = max(window // 2, _BESIDE_A_SWITCH)
    distance = _from_a_switch(modes[order], in_trajectories(data), SETTINGS.gap_steps)
    farthest = np.quantile(distance, SETTINGS.most_unsure, method="lower")
    near[order] = distance < min(half, farthest)
    return near


def _from_a_switch(modes: NDArray[np.intp], series: Stretches, gap: float) -> Array:
    """Samples from each to the nearest one of its trajectory that is next to a switch."""
    number = np.arange(len(modes))
    changes = np.diff(modes, prepend=modes[0]) != 0
    switches = np.flatnonzero(changes & (series.waits <= gap * series.step))
    if not len(switches):
        return np.full(len(modes), np.inf)
    after = np.searchsorted(switches, number, side="right")  # the switch is before this sample
    last = switches[np.maximum(after - 1, 0)]
    following = switches[np.minimum(after, len(switches) - 1)]
    since = np.where((after > 0) & (series.stretch[last] == series.stretch), number - last, np.inf)
    until = (after < len(switches)) & (series.stretch[following] == series.stretch)
    return np.minimum(since, np.where(until, following - 1 - number, np.inf))


@dataclass(frozen=True)
class FurtherMode:
    """That mode of a fit which a declared model with one mode less does not have."""

    declared: JointFit
    final: JointFit
    records: Records
    rows: NDArray[np.intp]  # in which modes are compared

    @cached_property
    def _modes(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        before, after = (
            fit.predict_modes(self.records)[self.rows] for fit in (self.declared, self.final)
        )
        return before, after

    @cached_property
    def number(self) -> int:
        """The mode that is left when those declared are matched with those that share most rows."""
        most = max(self.declared.n_modes, self.final.n_modes)
        matched = best_matching(contingency(*self._modes, shape=(most, most)))[1]
        known = matched[: self.declared.n_modes]
        rest = np.setdiff1d(np.arange(self.final.n_modes), known)
        # a fit to more rows may have left one of the modes without rows
        return int(rest[0]) if len(rest) else self.final.n_modes - 1

    @property
    def own(self) -> NDArray[np.bool_]:
        """Its rows among those compared."""
        return self._modes[1] == self.number

    @property
    def share(self) -> float:
        """Of the rows."""
        return float(np.mean(self.own))

    @property
    def equations(self) -> tuple[str, ...]:
        """Its laws, then the surfaces of the fit where these have equations."""
        names, style = self.records.names, (REPORT.precision, "text")
        laws = laws_with_effects(self.final, names, *style)
        own = [law for law in laws if law.startswith(f"mode {self.number}:")]
        try:
            guards = guards_with_effects(self.final, names, *style)
        except TypeError:  # a surface of the user's that has no text
            guards = []
        return (*own, *guards)
