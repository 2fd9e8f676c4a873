"""What a search for effects has to say: text, a dictionary, a picture and a page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from swsysid._data.records import Records
from swsysid._effect_model.joint_fit import JointFit, known_modes
from swsysid._effect_regressor import EffectRegressor
from swsysid._effect_search.contents import (
    EffectContents,
    EffectData,
    RungErrors,
    TriedEffect,
)
from swsysid._effect_search.contents import Round as RoundInWords
from swsysid._effect_search.display import EffectReportDisplay
from swsysid._effect_search.findings import Ladder
from swsysid._effect_search.folds import Split
from swsysid._effect_search.greedy import Round
from swsysid._effect_search.outcome import Tried
from swsysid._effect_search.page import effect_page
from swsysid._effect_search.recording import Measured
from swsysid._effect_search.set_aside import set_aside
from swsysid._effect_search.text import report_lines, summary
from swsysid._effect_search.words import named, rate, title
from swsysid._rendering.parts import entries_of
from swsysid._residual_report.report import ResidualReport, report_on
from swsysid._residual_report.samples import FEWEST_ROWS, ResidualSamples
from swsysid._results import Array
from swsysid._whole_or_nothing import write_text
from swsysid.effects import FoundEffect, PlacedEffect, StructureEffect


@dataclass(frozen=True, eq=False, repr=False)
class EffectReport(EffectContents):
    """Error before and after, the effects found, and what was looked for.

    It is a mapping of its own contents, prints as a table (`print`), draws (`plot`), and writes
    a page (`to_html`), which a notebook shows by itself.

    Attributes
    ----------
    targets : tuple of str
        Names of the state equations.
    held_out : str
        What took no part in any choice.
    n_search, n_held_out : int
        Rows of the two parts.
    n_may_stick : int
        Rows held out at which dry friction that was found may hold the plant, as far as the noise
        of a recording tells: no law says with what force, and their errors do not count.
    n_candidates : int
        Candidates tried in all rounds.
    errors : list of dict
        For the declared model and after each effect: ``model``, and the root mean square errors
        ``search`` and ``held_out`` of each equation; of positions alone those of the positions.
    effects : tuple of FoundEffect
    skipped : dict
        Kinds that were not looked for, and why.
    not_identifiable : tuple of str
        Candidates that the declared library spans already on these data.
    residual_before, residual_after : ResidualReport or None
        What the declared model and the last one leave over on the held-out data; None of positions
        alone, whose velocities nobody measured.
    guard_moved : float
        Share of the samples whose mode the effects changed.
    lost_modes : int
        Declared modes that no row needs beside the effects.
    history : tuple of dict
        For each round of the search: ``added``, ``p_value``, ``n_candidates``, and all
        ``effects`` after the round.
    dropped : tuple of str
        Effects after the last round that chance, or a force that nobody measured, explains as
        well beside the others; they are neither among `effects` nor `tried`.
    tried : tuple of dict
        Effects that chance does not explain and that are not kept, since the held-out error does
        not fall by more than its standard error, or since with them every rollout of untouched
        recordings is worse: ``effect``, ``p_value``, the held-out errors of each equation
        ``before`` and ``after``, and in the second case those of ``rollouts`` before and after.
    unsure : dict or None
        In recordings of one law, the ``effect`` that would have come next if chance could not
        explain it: its ``p_value``, the ``share`` of the squared error of stretches to which it was
        not fitted by which that falls, and about how many times as long a record would be sure
        (``longer``).
    exact : tuple of str
        States whose declared equation leaves rounding only, such as q' = v. They take no part.
    alarms : tuple of str
        What is wrong with the declared model before anything is looked for.
    set_aside : dict or None
        Rows with gross errors: how many (``n_rows``), how many of them follow each other
        (``n_together``) in how many trajectories, the probability of that by chance, and the
        ``place`` of these, None where they are wherever others are: how many of them, ``n_rows``,
        are in which ``interval`` of which ``channel``, and the share of the ``others`` there.
        With ``is_finding`` they are no outliers: another law acts there. A ``time_interval``
        (``trajectory``, ``begin``, ``end``, ``law``) is theirs where they fill one, or several in a
        trajectory, its ``intervals``: a lid was opened, a load switched on.
    discrete : bool
        True if the targets are the next states.
    of_rollouts : bool
        True if errors are those of free rollouts of recordings, in the units of the states, and not
        those of velocities.
    static : bool
        True if the target is a quantity that is no rate: there are no rollouts then.
    data : EffectData or None
        Rows for `plot` and `to_html`; not part of the dict.
    """

    _parts = (
        "summary",
        "clean",
        *(
            name
            for name in EffectContents.__dataclass_fields__
            if name not in ("discrete", "of_rollouts", "static", "data")
        ),
        "by_trajectory",
        "rollouts",
        "free_rollouts",
    )

    @classmethod
    def nothing_done(cls, measured: Measured, enough: str) -> EffectReport:
        """The report of a record too short to hold anything out, and what would be `enough`."""
        return cls(measured.records.equations, f"nothing: {enough}", len(measured.records), 0)

    @classmethod
    def of(
        cls,
        ladder: Ladder,
        rounds: list[Round],
        effects: Sequence[FoundEffect],
        models: Sequence[EffectRegressor],
        covariances: Sequence[Array],
        trajectory_names: NDArray | None,
        tried: Sequence[Tried] = (),
        alarms: Sequence[str] = (),
        n_declared: int = 0,
        measured: Measured | None = None,
    ) -> EffectReport:
        """Everything a search has found.

        `models` are the declared one and that with the effects, fitted to the rows of the search,
        and the final one, fitted to all rows, with the `covariances` of its effects' parameters.
        `n_declared` is how many modes were declared, 0 if they were left open. `measured` has the
        states as they were measured, if velocities were made of them.
        """
        records, split, names = ladder.records, ladder.split, trajectory_names
        first, last = ladder.fits[0], ladder.fits[-1]
        before, after = first.predict_modes(records), last.predict_modes(records)
        rows = np.sort(np.concatenate([split.search, split.held_out]))
        gross = set_aside(last, ladder.context.data, ladder.targets, rows)
        report = report_between(
            (first, last), records, ladder.targets, split, models, covariances, names, measured
        )
        assert report.data is not None
        return replace(
            report,
            n_may_stick=int(ladder.may_stick(split.held_out).sum()),
            n_candidates=max((one.n_candidates for one in rounds), default=0),
            errors=rung_errors([named(one.kind, one.place) for one in effects], ladder.errors),
            effects=tuple(effects),
            skipped={
                effect.kind: reason
                for effect in ladder.context.effects
                if (reason := ladder.context.why_not(effect)) is not None
            },
            not_identifiable=tuple(named(*one) for one in ladder.context.spanned()),
            guard_moved=float(np.mean(before != after)) if last.n_modes == first.n_modes else 1.0,
            lost_modes=max(n_declared - models[2].joint_fit_.n_modes, 0),
            history=tuple(
                round_in_words(one.finding, one.n_candidates, one.structure.terms, records)
                for one in rounds
            ),
            dropped=dropped(rounds, [*last.terms, *(one.candidate for one in tried)], records),
            tried=tuple(tried_in_words(_as_placed(one, ladder), records) for one in tried),
            exact=tuple(
                name
                for state, name in enumerate(records.equations)
                if state in ladder.context.data.exact_states
            ),
            alarms=tuple(alarms),
            set_aside=gross.in_words(last, records, ladder.context.significance, names),
            data=replace(report.data, aside=gross.rows),
        )

    @property
    def summary(self) -> str:
        """What came out, in one sentence."""
        return summary(self)

    def to_dict(self) -> dict[str, object]:
        """Everything but `data`, in types that JSON knows; NaN becomes None."""
        return entries_of(dict(self) | {"effects": [effect.to_dict() for effect in self.effects]})

    def plot(self, *, equation: str | None = None, effect: int | None = None, units=None, ax=None):
        """Draw before and after; see `swsysid.plotting.EffectReportDisplay`."""
        return EffectReportDisplay.from_report(
            self, equation=equation, effect=effect, units=units, ax=ax
        )

    def to_text(self, *, units=None) -> str:
        """What `print` shows, errors with their units.

        Parameters
        ----------
        units : mapping from names to units, default=None
            As in `swsysid.plotting.EffectReportDisplay`.

        Returns
        -------
        str
        """
        return "\n".join(report_lines(self, units))

    def to_html(self, path=None, *, units=None, title: str = "Effect search") -> str:
        """A self-contained page; written to `path` too, if one is given.

        Parameters
        ----------
        path : str or Path, default=None
        units : mapping from names to units, default=None
            As in `swsysid.plotting.EffectReportDisplay`.
        title : str, default="Effect search"

        Returns
        -------
        str
        """
        text = effect_page(self, units=units, title=title)
        if path is not None:
            write_text(path, text)
        return text

    def _repr_html_(self) -> str:
        return self.to_html()

    def __str__(self) -> str:
        return self.to_text()


def report_between(
    ends: tuple[JointFit, JointFit],
    records: Records,
    targets: Array,
    split: Split,
    models: Sequence[EffectRegressor],
    covariances: Sequence[Array],
    names: NDArray | None,
    measured: Measured | None,
) -> EffectReport:
    """What is left over at the two ends of any search, and the rows behind its pictures."""
    before, after = (leftover(fit, records, targets, split, names) for fit in ends)
    states, noise = _as_measured(measured)
    return EffectReport(
        targets=records.equations,
        held_out=split.how,
        n_search=len(split.search),
        n_held_out=len(split.held_out),
        residual_before=before,
        residual_after=after,
        discrete=bool(ends[0].laws.discrete_time),
        static=records.static,
        data=EffectData(
            records=records,
            rows=split.held_out,
            samples=split.held_out_samples,
            targets=targets,
            models=(models[0], models[1]),
            final=models[2],
            covariances=tuple(covariances),
            trajectory_names=names,
            states=states,
            noise=noise,
        ),
    )


def in_words(term: PlacedEffect, records: Records) -> str:
    label = term.label(records.names)
    law = rate(records.equations[term.target], static=records.static)
    return title(term.effect.kind, label, law, term.mode)


def _as_measured(measured: Measured | None) -> tuple[Array | None, Array | None]:
    """States as they were recorded, and their noise; neither where velocities were given."""
    if measured is None or measured.recorded is None or measured.noise is None:
        return None, None
    recorded = measured.recorded
    n_measured = recorded.n_measured
    return recorded.X[:, :n_measured], measured.noise.states[:n_measured]


def dropped(rounds: list[Round], kept: Sequence[PlacedEffect], records: Records) -> tuple[str, ...]:
    """Effects after the last round that are not told otherwise."""
    # A place that a fit moves, such as a guard, and the numbers of the modes may differ.

    def identity(term: PlacedEffect) -> tuple:
        return term.effect.kind, term.target, term.place if term.effect.terms else None

    last = rounds[-1].structure.terms if rounds else ()
    others = {identity(term) for term in kept}
    return tuple(in_words(term, records) for term in last if identity(term) not in others)


class Added(Protocol):
    """What any search says of an effect that it adds."""

    @property
    def candidate(self) -> PlacedEffect: ...

    @property
    def p_value(self) -> float: ...


def rung_errors(added: Sequence[str], errors: list[tuple[Array, Array]]) -> list[RungErrors]:
    """Errors of the declared model and after each effect that was added."""
    models = ["declared model", *(f"+ {name}" for name in added)]
    return [
        {"model": model, "search": inside.tolist(), "held_out": outside.tolist()}
        for model, (inside, outside) in zip(models, errors, strict=True)
    ]


def round_in_words(
    one: Added, n_candidates: int, terms: Sequence[PlacedEffect], records: Records
) -> RoundInWords:
    """What a round of the search has added, and all effects after it."""
    return {
        "added": in_words(one.candidate, records),
        "p_value": float(one.p_value),
        "n_candidates": n_candidates,
        "effects": [in_words(term, records) for term in terms],
    }


def _as_placed(one: Tried, ladder: Ladder) -> Tried:
    """One more mode, which acts in no equation alone, in that which gains most."""
    if not isinstance(one.candidate.effect, StructureEffect):
        return one
    target = ladder.gaining(one.before, one.after)
    return replace(one, candidate=replace(one.candidate, target=target))


def tried_in_words(one: Tried, records: Records) -> TriedEffect:
    """An effect that is not kept, and the held-out errors that say why."""
    return {
        "effect": in_words(one.candidate, records),
        "p_value": float(one.p_value),
        "before": one.before.tolist(),
        "after": one.after.tolist(),
        "rollouts": None if one.rollouts is None else list(one.rollouts),
    }


def leftover(
    fit: JointFit, records: Records, targets: Array, split: Split, names: NDArray | None
) -> ResidualReport | None:
    """The residual report of a fit on the held-out rows, None if these are too few for one.

    None where states are hidden as well: velocities say what a filter has made of them.
    """
    rows = split.held_out
    if len(rows) < FEWEST_ROWS or records.n_hidden:
        return None
    # Where the states have told the modes, a surface that is a little off is no finding.
    modes = fit.predict_modes(records)
    if records.decoded_modes is not None:
        known = known_modes(fit, records, split.search)
        modes = np.where(known >= 0, known, modes)
    samples = ResidualSamples.of(
        fit.estimator,
        records.take(rows),
        targets[rows],
        fit.predict(records, modes, rows),  # whose memory has seen the rows before
        modes[rows],
        [None] if names is None else names.tolist(),
    )
    return report_on(samples, random_state=0)
