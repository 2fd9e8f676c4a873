"""What a search in recordings of one law has to say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from numpy.typing import NDArray

from swsysid._effect_regressor import EffectRegressor
from swsysid._effect_search.contents import EffectData
from swsysid._effect_search.recorded import RecordedOutcome
from swsysid._effect_search.report import EffectReport, in_words, leftover
from swsysid._effect_search.words import named, noise_floor
from swsysid._output_error.scan import skipped


def recorded_report(
    outcome: RecordedOutcome,
    models: Sequence[EffectRegressor],
    trajectory_names: NDArray | None,
    alarms: Sequence[str],
) -> EffectReport:
    """The report of a search; `models` as `EffectReport.of` takes them."""
    measured, split = outcome.measured, outcome.split.of(outcome.measured.rows)
    records, targets = outcome.search.stretches.seen, measured.targets
    seen = replace(measured.records, held=records.held)
    names, terms = trajectory_names, outcome.models[-1].law.terms
    leftovers = [leftover(fit, seen, targets, split, names) for fit in outcome.joint_fits[1:3]]
    added = (f"+ {named(one.effect.kind, one.label(records.names))}" for one in terms)
    models_in_words = ["declared model", *added]
    report = EffectReport(
        targets=records.equations,
        held_out=split.how,
        n_search=len(outcome.search.stretches.rows),
        n_held_out=len(outcome.held_out.rows),
        n_candidates=max((one.n_candidates for one in outcome.findings), default=0),
        errors=[
            {"model": model, "search": inside.tolist(), "held_out": outside.tolist()}
            for model, (inside, outside) in zip(models_in_words, outcome.errors, strict=True)
        ],
        skipped=skipped(outcome.search.library, records),
        residual_before=leftovers[0],
        residual_after=leftovers[1],
        history=tuple(
            {
                "added": in_words(one.candidate, records),
                "p_value": float(one.p_value),
                "n_candidates": one.n_candidates,
                "effects": [in_words(term, records) for term in model.law.terms],
            }
            for one, model in zip(outcome.findings, outcome.models[1:], strict=True)
        ),
        tried=tuple(
            {
                "effect": in_words(one.candidate, records),
                "p_value": float(one.p_value),
                "before": before.tolist(),
                "after": after.tolist(),
                "rollouts": None,
            }
            for one, before, after in outcome.tried
            if one.p_value <= outcome.search.significance and (after < before).any()
        ),
        unsure=None
        if (near := outcome.unsure) is None
        else {
            "effect": in_words(near.candidate, records),
            "p_value": float(near.p_value),
            "share": near.share,
            "longer": near.longer,
        },
        alarms=tuple(alarms),
        of_rollouts=not records.static,
        static=records.static,
        data=EffectData(
            records=seen,
            rows=split.held_out,
            samples=split.held_out_samples,
            targets=targets,
            models=(models[0], models[1]),
            final=models[2],
            covariances=tuple(outcome.covariances),
            trajectory_names=names,
            states=measured.recorded.X[:, : records.n_states] if measured.recorded else None,
            noise=None if measured.noise is None else measured.noise.states,
        ),
    )
    noise = [noise_floor(report, state) for state in range(len(report.targets))]
    return replace(report, effects=tuple(outcome.effects(noise)))
