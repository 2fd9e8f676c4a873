"""`HybridAutomatonRegressor` on automata that others published, as its page of the manual says.

What DAINARX is told says which of the documented ways it is: samples that its difference equations
see beyond the present one are lags, laws without further terms are maps, others are flows, as those
of Flowcean are; further terms are polynomials of their degree, or functions; guards that are no
planes are quadrics. A map is given its inputs with those of the next sample: they go on between the
samples. Recordings with noise that need earlier samples are of flows: differences of these are
mostly noise.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.automata.others.dainarx import Recorded
from benchmarks.automata.others.scoring import Published
from benchmarks.automata.plant import Array
from swsysid import FunctionLibrary, HybridAutomatonRegressor

__all__ = ["Ours", "ours"]

_STEP = 1e-6  # of the range, where a guard is differentiated


@dataclass(frozen=True)
class Ours:
    """A fitted regressor in the terms of the figures."""

    fitted: HybridAutomatonRegressor

    @property
    def n_modes(self) -> int:
        """Modes found."""
        return int(self.fitted.n_modes_)

    @property
    def modes(self) -> NDArray[np.intp]:
        """Of all samples."""
        return self.fitted.modes_

    @property
    def n_first(self) -> int:
        """Lagged samples, or those that tell a speed."""
        if self.fitted.discrete_time:
            return int(self.fitted.automaton_.lags) + 1
        return 2 if self.fitted.order == 2 else 1

    @property
    def doubts(self) -> bool:
        """Whether the report does not say that guards tell all switches."""
        return "guards tell all switches" not in str(self.fitted.report_)

    def rollout(self, seen: Recorded, mode: int) -> tuple[Array, NDArray[np.intp]]:
        """States and modes."""
        at, n_states = self.n_first - 1, seen.x.shape[1]
        inputs = seen.u if seen.u.size else None
        if self.fitted.discrete_time:
            inputs = inputs if inputs is None else _with_next(inputs)
            start = seen.x[: at + 1] if at else seen.x[0]
            done = self.fitted.simulate(start, seen.t, inputs, mode=mode)
            return done.x[at:], done.modes[at:]
        start = seen.x[at]
        if self.fitted.order == 2:
            start = np.append(start, (seen.x[at + 1] - seen.x[at - 1]) / (2.0 * seen.t[0]))
        inputs = inputs if inputs is None else inputs[at:]
        done = self.fitted.simulate(start, seen.t[at:], inputs, mode=mode)
        return done.x[:, :n_states], done.modes

    def passed(self, seen: list[Recorded], source: int, target: int) -> Array:
        """Distance beyond the guard, as `scoring.Model` says."""
        columns = np.vstack([self._columns(one) for one in seen])
        ranges = np.ptp(columns, axis=0)
        beyond = [np.full(len(columns), np.nan)]
        for one in self.fitted.automaton_.transitions:
            if (one.source, one.target) == (source, target):
                values = one.guard.values
                moved = [
                    columns + sign * step for step in _STEP * np.diag(ranges) for sign in (-1, 1)
                ]
                slopes = np.diff(
                    np.reshape(list(map(values, moved)), (-1, 2, len(columns))), axis=1
                )
                size = np.linalg.norm(slopes[:, 0] / (2.0 * _STEP), axis=0)
                beyond.append(values(columns) / np.where(size > 0.0, size, np.nan))
        return np.asarray(np.fmax.reduce(beyond))

    def _columns(self, seen: Recorded) -> Array:
        """Of guards, at the samples of a recording: its first stay counts from its start."""
        as_map, at = self.fitted.discrete_time, np.arange(len(seen.t))
        entered = np.append(True, np.diff(seen.modes) != 0)
        # a sample at which a mode is entered ends the stay before it
        dwell = at - np.append(0, np.maximum.accumulate(np.where(entered, at, 0))[:-1])
        lags = range(self.fitted.automaton_.lags + 1 if as_map else 1)
        states = [seen.x[np.maximum(at - lag, 0)] for lag in lags]
        if self.fitted.order == 2:
            states.append(np.diff(seen.x, axis=0, prepend=seen.x[:1]) / (seen.t[1] - seen.t[0]))
        u = _with_next(seen.u) if as_map else seen.u
        inputs = [u[np.maximum(at - lag, 0)] for lag in lags]
        clocks = (dwell, at) if as_map else (dwell * (seen.t[1] - seen.t[0]), seen.t)
        return np.column_stack([*states, *inputs, *clocks])


def ours(training: list[Recorded], automaton: Published) -> Ours:
    """The automaton that the package finds, its number of modes and edges included."""
    degree, library = _features(automaton)
    is_flow = automaton.is_flow or (automaton.order > 1 and _has_noise(training))
    as_map = degree == 1 and not is_flow
    fitted = HybridAutomatonRegressor(
        discrete_time=as_map,
        lags=automaton.order - 1 if as_map else 0,
        order=1 if as_map else min(automaton.order, 2),
        feature_library=library,
        guard_degree=1 if automaton.kernel == "linear" else 2,
        max_modes=8,
        random_state=0,
    )
    recordings = []
    for one in training:
        recordings.append({"t": one.t, "x": one.x})
        if one.u.size:
            recordings[-1]["inputs"] = _with_next(one.u) if as_map else one.u
    return Ours(fitted.fit(recordings))


def _has_noise(training: list[Recorded]) -> bool:
    """Whether samples are off by more than a thousandth of the spread, as third differences tell.

    Those of white noise are as large as the root of twenty times its variance.
    """
    x = np.vstack([one.x for one in training])
    rough = np.vstack([np.diff(one.x, 3, axis=0) for one in training])
    sizes = np.median(np.abs(rough), axis=0) / np.sqrt(20.0)
    return bool((sizes > 1e-3 * x.std(axis=0)).any())


def _with_next(u: Array) -> Array:
    """Inputs beside those of the next sample; those after the last act on nothing."""
    return np.hstack([u, np.vstack([u[1:], u[-1:]])])


def _features(automaton: Published) -> tuple[int, int | FunctionLibrary]:
    """Degree of the further terms that DAINARX is told, 0 if they are functions; and a library."""
    terms = [one.split(":")[-1].strip() for one in automaton.features.split(";") if one.strip()]
    if any("/" in one or "(" in one for one in terms):
        functions = [lambda x: np.ones_like(x), lambda x: x]
        names = ["1", "{}"]
        for one in terms:
            if called := re.match(r"(sin|cos)\(", one):
                functions.append(getattr(np, called[1]))
                names.append(f"{called[1]}({{}})")
            elif re.match(r"sqrt\(x0 - x1\)", one):
                functions.append(lambda x, y: np.sqrt(np.maximum(x - y, 0.0)))
                names.append("sqrt({0} - {1})")
            elif re.match(r"1\s*/", one):
                functions.append(lambda x: 1.0 / x)
                names.append("1/{}")
            elif "/" in one:
                functions.append(lambda x, y: y / x)
                names.append("{1}/{0}")
        return 0, FunctionLibrary(functions, names)
    degrees = [_degree(one) for one in terms]
    return (max(degrees), max(degrees)) if degrees else (1, 1)


def _degree(term: str) -> int:
    """Of a product of samples and their powers."""
    return sum(int(power or 1) for power in re.findall(r"\[\?\](?:\s*\*\*\s*(\d+))?", term))
