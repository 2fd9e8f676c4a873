"""What a search has found: an effect with its numbers, and its rivals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from swsysid.effects._placed import PlacedEffect

__all__ = ["FoundEffect", "Rival"]


@dataclass(frozen=True)
class Rival:
    """Another effect that explains the data as well.

    Attributes
    ----------
    kind : str
    target : int
        State equation.
    mode : int or None
    place : str
        Channel or term, by name.
    parameters : dict
        Nonlinear parameters.
    error : float
        Root mean square error of `target` on the held-out data with it in the effect's place.
    advice : str
        Measurement that would tell the two apart.
    """

    kind: str
    target: int
    mode: int | None
    place: str
    parameters: dict[str, float]
    error: float
    advice: str


@dataclass(frozen=True)
class FoundEffect:
    """An effect that the declared model lacked.

    Attributes
    ----------
    kind : str
    target : int
        Index of the state equation it acts in (of the state that is recorded wrongly or jumps).
    mode : int or None
        Mode it acts in, None for all.
    place : str
        Channel or term it is a function of, by name.
    parameters : dict
        Values by their physical names, in the user's units.
    intervals : dict
        95 % confidence intervals of those that have one.
    p_value : float
        Probability that the residual is predicted so well by chance, times the number of
        candidates tried.
    error_before, error_after : float
        Root mean square error of `target`, in its unit, on data that took no part in any choice:
        with the effects before this one, and with this one as well. An effect of a sensor, a
        guard or a mode has those of the equation that gains most.
    rivals : tuple of Rival
        Effects whose held-out error is within one standard error.
    meaning : str
        What it means physically, in one sentence.
    formula : str
        The term with its numbers.
    placed : PlacedEffect
        The effect as `EffectRegressor` takes it.
    """

    kind: str
    target: int
    mode: int | None
    place: str
    parameters: dict[str, Any]
    intervals: dict[str, tuple[float, float]]
    p_value: float
    error_before: float
    error_after: float
    rivals: tuple[Rival, ...]
    meaning: str
    formula: str
    placed: PlacedEffect

    @property
    def channel(self) -> int | None:
        """Number of the channel (column of X, then of the signals) if it is one."""
        return self.placed.place if isinstance(self.placed.place, int) else None

    def to_dict(self) -> dict[str, Any]:
        """Everything but the object itself, ready for JSON."""
        names = [name for name in self.__dataclass_fields__ if name not in ("placed", "rivals")]
        listed = {name: getattr(self, name) for name in names}
        listed["intervals"] = {name: list(pair) for name, pair in self.intervals.items()}
        return listed | {"rivals": [dict(rival.__dict__) for rival in self.rivals]}
