r"""What rows next to a switch say, where velocities were made of measured states.

A filter has smeared their velocities: they belong to neither law, and a further mode that consists
of them is none.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swsysid._data.records import Records
from swsysid._effect_model.equations import guards_with_effects, laws_with_effects
from swsysid._effect_model.joint_fit import JointFit
from swsysid._effect_search.coloured_noise import Stretches, in_trajectories, rows_in_order
from swsysid._effect_search.folds import SearchData
from swsysid._effect_search.settings import REPORT
from swsysid._results import Array
from swsysid.metrics._modes import best_matching, contingency

Modes = NDArray[np.intp]
Mask = NDArray[np.bool_]


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
    half = max(window // 2, data.settings.beside_a_switch)
    distance = _from_a_switch(modes[order], in_trajectories(data), data.settings.gap_steps)
    farthest = np.quantile(distance, data.settings.most_unsure, method="lower")
    near[order] = distance < min(half, farthest)
    return near


def is_smeared_mode(data: SearchData, before: JointFit, after: JointFit) -> bool:
    """Whether one more mode is made of rows that a filter has smeared over switches of the others.

    Velocities between those of two laws are a law of their own wherever the modes change.
    """
    if after.n_modes <= before.n_modes:
        return False
    modes = before.predict_modes(data.records)[data.rows]
    left = after.residuals(data.records, data.rows, data.targets)
    smeared = at_smeared_switches(data, modes, left)
    own = FurtherMode(before, after, data.records, data.rows).own
    return bool(smeared[own].sum() > data.settings.most_smeared * np.count_nonzero(own))


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
