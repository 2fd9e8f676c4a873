"""What modes are, in the words of physics, where the laws and their errors say it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from swsysid._cli.from_recordings import FromRecordings
from swsysid._cli.samples import Samples
from swsysid._cli.settings import WORDING
from swsysid._surfaces.surface import solves_margin_program


def physics(found: FromRecordings, samples: Samples) -> list[str]:
    """One line for each mode, or pair of modes, that has a name; none if none has."""
    return [*_sticking(found, samples), *_frictions(found, samples)]


def _sticking(found: FromRecordings, samples: Samples) -> Iterator[str]:
    """Modes in which every state moves by next to nothing, beside what it does in the others."""
    assert samples.recorded is not None
    identifier, groups = found.identifier, samples.recorded.groups
    modes, steps = identifier.modes_, np.abs(np.diff(identifier.states_, axis=0))
    inside = (modes[1:] == modes[:-1]) & (groups[1:] == groups[:-1])
    for mode in range(identifier.n_modes_ if identifier.n_modes_ > 1 else 0):
        own = inside & (modes[1:] == mode)
        others = inside & (modes[1:] != mode)
        if own.any() and others.any():
            moved, usual = steps[own].mean(axis=0), steps[others].mean(axis=0)
            if (moved <= WORDING.still * usual).all():
                yield f"mode {mode}: nothing moves, it sticks"


def _frictions(found: FromRecordings, samples: Samples) -> Iterator[str]:
    """Two laws that differ by a constant where one state changes its sign: dry friction in it."""
    model = found.model
    names = list(model.feature_names_out_)
    if model.n_modes_ != 2 or "1" not in names or not solves_margin_program(model.surface_):
        return
    parting = _parting_state(found, samples)
    if parting is None:
        return
    column, slow, fast = parting
    constant = names.index("1")
    errors = np.hypot(*found.identifier.coef_errors_)
    differ = model.coef_[slow] - model.coef_[fast]
    rounding = WORDING.rounding * np.abs(model.coef_).max(axis=0)
    is_sure = np.abs(differ) > np.maximum(WORDING.sure * errors, rounding)
    others = np.delete(is_sure, constant, axis=1)
    for state in np.flatnonzero(is_sure[:, constant]):
        size, name = 0.5 * differ[state, constant], samples.names[column]
        if others.any() or size <= 0.0:
            return
        unit = samples.unit(samples.rate_names[state])
        half = f"{size:.3g} {unit}".rstrip()
        error = f"{0.5 * errors[state, constant]:.1g}"
        yield (
            f"the two laws differ by a constant at {name} = 0: dry friction of {half} (standard "
            f"error {error}) in {samples.rate_names[state]}"
        )


def _parting_state(found: FromRecordings, samples: Samples) -> tuple[int, int, int] | None:
    """The state whose sign parts two modes, and the mode below zero, and the one above."""
    predicted = found.model.predict_modes(samples.frame)
    n_states = found.model.coef_.shape[1]
    for column in range(n_states):
        above = samples.X[:, column] > 0.0
        for fast in (0, 1):
            if np.mean((predicted == fast) == above) >= WORDING.same_side:
                return column, 1 - fast, fast
    return None
