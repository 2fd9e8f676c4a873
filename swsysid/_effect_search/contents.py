"""What a report of effects holds."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from swsysid._effect_search.data import EffectData
from swsysid._rendering.parts import Parts, plain
from swsysid._residual_report.report import ResidualReport
from swsysid.effects import FoundEffect

__all__ = ["EffectContents"]


@dataclass(frozen=True, eq=False, repr=False)
class EffectContents(Parts):
    """Fields of an `EffectReport`, which are described there, and what follows from them."""

    targets: tuple[str, ...]
    held_out: str
    n_search: int
    n_held_out: int
    n_candidates: int = 0
    errors: list[dict[str, Any]] = field(default_factory=list)
    effects: tuple[FoundEffect, ...] = ()
    skipped: dict[str, str] = field(default_factory=dict)
    not_identifiable: tuple[str, ...] = ()
    residual_before: ResidualReport | None = None
    residual_after: ResidualReport | None = None
    guard_moved: float = 0.0
    history: tuple[dict[str, Any], ...] = ()
    dropped: tuple[str, ...] = ()
    discrete: bool = False
    data: EffectData | None = None

    @property
    def clean(self) -> bool:
        """True if no effect was found."""
        return not self.effects

    @property
    def by_trajectory(self) -> list[dict[str, Any]]:
        """Errors before and after on every held-out trajectory, or stretch of one."""
        return [] if self.data is None else plain(self.data.by_trajectory)

    @property
    def rollouts(self) -> list[dict[str, Any]]:
        """Errors of simulations from the first state of held-out trajectories, and their ends."""
        return [] if self.data is None else [one.to_dict() for one in self.data.rollouts]
