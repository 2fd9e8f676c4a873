"""What a search for effects has to say: text, a dictionary, and the parts of a page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from swsysid._records import Records
from swsysid._search.folds import Split
from swsysid._search.greedy import Round, Search
from swsysid.diagnosis._ladder import Ladder
from swsysid.diagnosis._report import ResidualReport
from swsysid.diagnosis._residuals import residual_report
from swsysid.effects import FoundEffect

__all__ = ["EffectReport"]


@dataclass(frozen=True)
class EffectReport(Mapping):
    """Error before and after, the effects found, and what was looked for.

    It is a mapping of its own contents, prints as a table, and writes HTML.

    Attributes
    ----------
    targets : tuple of str
        Names of the state equations.
    held_out : str
        What took no part in any choice.
    n_search, n_held_out : int
        Rows of the two parts.
    n_candidates : int
        Candidates tried in all rounds.
    errors : list of dict
        For the declared model and after each effect: ``model``, and the root mean square errors
        ``search`` and ``held_out`` of each equation.
    effects : tuple of FoundEffect
    skipped : dict
        Kinds that were not looked for, and why.
    not_identifiable : tuple of str
        Candidates that the declared library spans already on these data.
    residual_before, residual_after : ResidualReport or None
        What the declared model and the last one leave over on the held-out data.
    guard_moved : float
        Share of the samples whose mode the effects changed.
    """

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

    @classmethod
    def nothing_done(cls, records: Records) -> EffectReport:
        """The report of a record too short to hold anything out."""
        names = tuple(records.names[: records.n_states])
        return cls(names, "nothing: the record is too short", len(records), 0)

    @classmethod
    def of(
        cls,
        search: Search,
        ladder: Ladder,
        rounds: list[Round],
        estimator: Any,
        records: Records,
        targets: Any,
        split: Split,
    ) -> EffectReport:
        """Everything a search has found."""
        models = ["declared model"] + [
            f"+ {effect.kind.replace('_', ' ')} of {effect.place}" for effect in estimator.effects_
        ]
        errors = [
            {"model": model, "search": inside.tolist(), "held_out": outside.tolist()}
            for model, inside, outside in zip(models, ladder.search, ladder.held_out, strict=True)
        ]
        first, last = ladder.fits[0], ladder.fits[-1]
        before, after = first.predict_modes(records), last.predict_modes(records)
        return cls(
            targets=tuple(records.names[: records.n_states]),
            held_out=split.how,
            n_search=len(split.search),
            n_held_out=len(split.held_out),
            n_candidates=max((one.n_candidates for one in rounds), default=0),
            errors=errors,
            effects=tuple(estimator.effects_),
            skipped={
                effect.kind: reason
                for effect in search.effects
                if (reason := effect.missing(records)) is not None
            },
            not_identifiable=search.spanned(ladder.fits[0]),
            residual_before=_leftover(first, records, targets, split),
            residual_after=_leftover(last, records, targets, split),
            guard_moved=float(np.mean(before != after)) if last.n_modes == first.n_modes else 1.0,
        )

    @property
    def clean(self) -> bool:
        """True if no effect was found."""
        return not self.effects

    def to_dict(self) -> dict[str, Any]:
        """Everything, ready for JSON."""
        listed = {name: getattr(self, name) for name in self.__dataclass_fields__}
        listed["effects"] = [effect.to_dict() for effect in self.effects]
        for name in ("residual_before", "residual_after"):
            listed[name] = None if listed[name] is None else listed[name].to_dict()
        return listed

    def __getitem__(self, name: str) -> Any:
        return getattr(self, name)

    def __iter__(self) -> Iterator[str]:
        return iter(self.__dataclass_fields__)

    def __len__(self) -> int:
        return len(self.__dataclass_fields__)

    def __str__(self) -> str:
        lines = [f"Searched {self.n_search} samples, held out {self.n_held_out} ({self.held_out})."]
        lines += _error_table(self)
        if not self.effects:
            lines.append("No effect is missing as far as these data show.")
        for number, effect in enumerate(self.effects, start=1):
            lines += _effect_lines(number, effect, self.targets)
        if self.skipped:
            lines.append("Not looked for:")
            lines += [f"  {kind}: {reason}" for kind, reason in self.skipped.items()]
        return "\n".join(lines)


def _leftover(fit, records: Records, targets, split: Split) -> ResidualReport | None:
    """The residual report of a fit on the held-out rows."""
    predicted, modes = fit.predict(records), fit.predict_modes(records)
    rows = split.held_out

    class Known:
        """The predictions of a fit, whose memory has seen the rows before."""

        def predict(self, X):
            return predicted[rows]

        def predict_modes(self, X):
            return modes[rows]

    part = records.take(rows)
    return residual_report(
        Known(),
        part.X,
        targets[rows],
        t=part.t if part.timed else None,
        groups=part.groups,
        signals=part.signals if part.signals.shape[1] else None,
        random_state=0,
    )


def _error_table(report: EffectReport) -> list[str]:
    """Held-out errors of every equation, one line a model."""
    width = max([len(row["model"]) for row in report.errors] + [5])
    head = "  ".join(f"{name + chr(39):>12}" for name in report.targets)
    lines = [f"{'held-out RMS error':{width}}  {head}"] if report.errors else []
    for row in report.errors:
        values = "  ".join(f"{value:12.4g}" for value in row["held_out"])
        lines.append(f"{row['model']:{width}}  {values}")
    return lines


def _effect_lines(number: int, effect: FoundEffect, targets: tuple[str, ...]) -> list[str]:
    where = "all modes" if effect.mode is None else f"mode {effect.mode}"
    lines = [
        f"{number}. {effect.kind.replace('_', ' ')} of {effect.place} in "
        f"{targets[effect.target]}' ({where}): {effect.meaning}.",
        f"   held-out error {effect.error_before:.4g} -> {effect.error_after:.4g}, "
        f"p = {effect.p_value:.1g}",
    ]
    for name, value in effect.parameters.items():
        low, high = effect.intervals.get(name, (np.nan, np.nan))
        sure = f"  (95 %: {low:.4g} to {high:.4g})" if np.isfinite(low) else ""
        lines.append(f"   {name} {value:.5g}{sure}")
    for rival in effect.rivals:
        lines.append(
            f"   as good: {rival.kind.replace('_', ' ')} of {rival.place}, error "
            f"{rival.error:.4g}; to tell: {rival.advice}"
        )
    return lines
