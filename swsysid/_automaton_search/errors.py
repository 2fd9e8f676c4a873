"""Standard errors of an automaton, and its lines with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton.equations import asked_text, guard_terms, relation
from swsysid._automaton.model import HybridAutomaton
from swsysid._automaton.transitions import AffineReset, PolynomialGuard
from swsysid._automaton_search.found import FoundTransition, place_of
from swsysid._automaton_search.settings import SETTINGS
from swsysid._rendering.printing import (
    between,
    determined,
    rate,
    sum_with_errors,
    with_error,
)
from swsysid._results import Array


@dataclass(frozen=True)
class AutomatonErrors:
    """Standard errors in the order of an automaton: 0 where fixed, infinite where nothing tells."""

    coef: Array  # (n_modes, n_states, n_features_out)
    guards: tuple[Array, ...]  # like the coefficients of the guard of each transition
    resets: tuple[Array | None, ...]  # (n_states, 1 + n_states), of offset and matrix

    @classmethod
    def by_parts(
        cls,
        coef: Array,
        found: Sequence[FoundTransition],
        automaton: HybridAutomaton,
        order: NDArray[np.intp],
    ) -> AutomatonErrors:
        """Those of what was found part by part; `coef` has the modes as they were found."""
        guards, resets = [], []
        for one in automaton.transitions:
            own = found[place_of(one, found, order)]
            assert own.guard is not None, "a transition of the automaton has a guard"
            guards.append(own.guard.all_errors)
            resets.append(None if one.reset is None or own.reset is None else own.reset.errors)
        return cls(coef[order], tuple(guards), tuple(resets))

    def lines(self, automaton: HybridAutomaton) -> list[str]:
        """Laws and transitions as text."""
        return [*self._laws(automaton), *self._transitions(automaton)]

    def _laws(self, automaton: HybridAutomaton) -> list[str]:
        feature_map, lines = automaton.feature_map, []
        sizes = np.maximum(feature_map.sizes, np.finfo(float).tiny)
        every = determined(automaton.coef, self.coef, sizes)
        # beside what is determined: a mode of few samples may have any size
        told = np.where(np.isfinite(every), np.abs(automaton.coef * sizes), 0.0)
        rounding = SETTINGS.exact * told.max(axis=(0, 2))
        for mode, (coef, errors) in enumerate(zip(automaton.coef, every, strict=True)):
            for state, name in enumerate(automaton.state_names):
                terms = _beyond(rounding[state] / sizes, coef[state], errors[state])
                left = f"{name}[k+1]" if automaton.discrete_time else rate(name, "text")
                if _is_named(left, coef[state], list(feature_map.names_out)):
                    continue  # q' = 1.0 q' says nothing
                right = sum_with_errors(*terms, list(feature_map.names_out))
                lines.append(f"mode {mode}: {left} = {right}")
        return lines

    def _transitions(self, automaton: HybridAutomaton) -> list[str]:
        columns, lines = automaton.guard_columns, []
        for one, guard, reset in zip(automaton.transitions, self.guards, self.resets, strict=True):
            conditions = one.guard.conditions
            is_uniform = automaton.discrete_time or one.asked_every is not None
            ends = np.cumsum([len(part.coef) for part in conditions])[:-1]
            where = " and ".join(
                _guard(part, errors, columns, uniform=is_uniform)
                for part, errors in zip(conditions, np.split(guard, ends), strict=True)
            )
            then = _resets(one.reset, reset, columns)
            line = f"mode {one.source} -> {one.target} where {where}{asked_text(one)}"
            lines.append(f"{line}: {', '.join(then)}" if then else line)
        return lines


def _is_named(rate: str, law: Array, names: Sequence[str]) -> bool:
    """Whether a law is that the rate is the state of this name."""
    own = np.array([name == rate for name in names])
    return bool(own.any() and np.allclose(law, own, rtol=0.0, atol=1e-9))


def _beyond(rounding: Array, values: Array, errors: Array) -> tuple[list[float], list[float]]:
    """Values and errors of the terms of a law, without those that are rounding."""
    seen = (np.abs(values) > rounding) | (errors > rounding)
    return np.where(seen, values, 0.0).tolist(), np.where(seen, errors, 0.0).tolist()


def _guard(guard: PolynomialGuard, errors: Array, columns: Sequence[str], *, uniform: bool) -> str:
    """The inequality; a threshold that is one of an interval between two samples as that."""
    names = guard_terms(guard, columns)
    values = dict(zip(names, guard.coef.tolist(), strict=True))
    others = [name for name, value in values.items() if value and name != "1"]
    if len(others) != 1:
        return f"{sum_with_errors(guard.coef.tolist(), errors.tolist(), names)} >= 0"
    [name], sizes = others, dict(zip(names, errors.tolist(), strict=True))
    slope, level = values[name], -values.get("1", 0.0) / values[name]
    error = float(np.hypot(sizes.get("1", 0.0), level * sizes[name]) / abs(slope))
    shown, half = with_error(level, error), np.sqrt(3.0) * error  # of a uniform one
    ends = between(level - half, level + half) if uniform and np.isfinite(error) else ""
    if ends:
        shown = f"{shown.partition(' (')[0]} ({ends})"
    return f"{name} {relation(slope)} {shown}"


def _resets(reset: AffineReset | None, errors: Array | None, columns: Sequence[str]) -> list[str]:
    """What becomes of each state that changes."""
    if reset is None or errors is None:
        return []
    maps = np.column_stack([reset.offset, reset.matrix])
    names = ["1", *columns[: len(reset.matrix)]]
    goes_on = np.eye(len(maps), len(maps) + 1, 1)
    return [
        f"{names[1 + state]} := {sum_with_errors(row.tolist(), errors[state].tolist(), names)}"
        for state, row in enumerate(maps)
        if (row != goes_on[state]).any()
    ]
