"""The laws and guards of a switching model with effects beside it, as text."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from swsysid._search.joint_fit import JointFit

__all__ = ["guards_with_effects", "laws_with_effects"]


def laws_with_effects(fit: JointFit, names: Sequence[str], precision: int, style: str) -> list[str]:
    """The law of every mode with the effects' terms, then what sensors and clocks do.

    Parameters
    ----------
    fit : JointFit
    names : sequence of str
        Names of the channels.
    precision : int
    style : {"text", "latex"}
    """

    def added(mode: int, state: int) -> Iterator[tuple[float, str, float]]:
        for term, coef in zip(fit.terms, fit.coef, strict=True):
            if term.target == state and term.effect.terms:
                label = term.effect.label(term.place, names)
                columns = term.effect.column_names(label, *term.theta)
                values = term.in_mode(coef, mode, fit.n_modes).tolist()
                yield from (
                    (value, name, 1.0) for value, name in zip(values, columns, strict=False)
                )

    laws = fit.switching.switching_model.equations(
        precision, style, states=names, columns=_columns(fit, names), added=added
    )
    return laws + _statements(fit, names, style, guards=False)


def guards_with_effects(
    fit: JointFit, names: Sequence[str], precision: int, style: str
) -> list[str]:
    """The surfaces, or the guard with memory in their place; then what happens at them."""
    told = _statements(fit, names, style, guards=True)
    if any(term.effect.remembers for term in fit.terms):
        return told
    columns = _columns(fit, names)
    return fit.switching.switching_model.surface_equations(precision, style, columns) + told


def _columns(fit: JointFit, names: Sequence[str]) -> list[str] | None:
    """Names of what the switching regressor sees; None where a pipeline does not name them."""
    n_columns = fit.switching.n_features_in_
    steps = getattr(fit.estimator, "steps", ())
    if len(steps) < 2:
        return list(names[:n_columns])
    try:
        before = fit.estimator[:-1]
        return list(before.get_feature_names_out(list(names[: before.n_features_in_])))
    except (AttributeError, ValueError):
        return None


def _statements(fit: JointFit, names: Sequence[str], style: str, *, guards: bool) -> list[str]:
    """Effects without columns, those of the guards or the others."""
    listed = [
        term.effect.statement(term.place, names, term.target, *term.theta)
        for term in fit.terms
        if term.effect.acts_at_guards == guards
    ]
    told = [text for text in listed if text]
    return [rf"\text{{{text}}}".replace("_", r"\_") for text in told] if style == "latex" else told
