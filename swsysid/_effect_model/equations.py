"""The laws and guards of a switching model with effects beside it, as text."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from swsysid._effect_model.joint_fit import JointFit
from swsysid._simulation.law_equations import law_equations
from swsysid.effects import MeasurementEffect
from swsysid.effects._types import WithoutColumns


def laws_with_effects(fit: JointFit, names: Sequence[str], precision: int, style: str) -> list[str]:
    """The law of every mode with the effects' terms, then what sensors and clocks do."""
    # `names` are those of the channels, `style` is "text" or "latex".

    def added(mode: int, state: int) -> Iterator[tuple[float, str, float]]:
        for term, coef in zip(fit.terms, fit.coef, strict=True):
            if term.target == state:
                own = term.in_mode(coef, mode, fit.n_modes)
                written = term.effect.written(term.label(names), term.theta, own)
                yield from ((value, name, 1.0) for value, name in written)

    own = fit.laws
    laws = law_equations(
        own.coef,
        own.feature_map,
        precision,
        style,
        discrete_time=own.discrete_time,
        states=names,
        columns=own.column_names(names),
        added=added,
    )
    return laws + _statements(fit, names, style, of_measurements=True)


def guards_with_effects(
    fit: JointFit, names: Sequence[str], precision: int, style: str
) -> list[str]:
    """The surfaces, or the guard with memory in their place; then what happens at them."""
    statements = _statements(fit, names, style, of_measurements=False)
    if fit.guard is not None:
        return statements
    return fit.laws.guard_equations(names, precision, style) + statements


def _statements(
    fit: JointFit, names: Sequence[str], style: str, *, of_measurements: bool
) -> list[str]:
    """Effects without columns: those of the measurement, or those of guards and modes."""
    texts = [
        term.effect.statement(term.place, names, term.target, *term.theta)
        for term in fit.terms
        if isinstance(term.effect, WithoutColumns)
        and isinstance(term.effect, MeasurementEffect) == of_measurements
    ]
    texts = [text for text in texts if text]
    if style == "latex":
        return [rf"\text{{{text}}}".replace("_", r"\_") for text in texts]
    return texts
