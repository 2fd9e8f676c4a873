"""One more mode in numbers: which it is, its share of the rows, its laws and what bounds it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swsysid._data.matching import best_matching, contingency
from swsysid._data.records import Records
from swsysid._effect_model.equations import guards_with_effects, laws_with_effects
from swsysid._effect_model.joint_fit import JointFit
from swsysid._effect_search.settings import REPORT


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
