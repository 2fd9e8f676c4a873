"""Automata written down by hand: laws, guards and resets as polynomials in named columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from swsysid._automaton.columns import CLOCKS, lagged_names, other_names
from swsysid._automaton.polynomial_text import (
    Polynomial,
    inequalities_in,
    read_inequality,
    read_polynomial,
)
from swsysid._automaton.transitions import (
    AffineReset,
    Guard,
    PolynomialGuard,
    Transition,
    guard_of,
)
from swsysid._checks.arrays import numbers
from swsysid._checks.parameters import names_of_columns, real, shown
from swsysid._data.features import FeatureMap
from swsysid._results import Array

Expression = str | float
StatedLaws = Sequence[Mapping[str, Expression]] | ArrayLike
StatedTransition = Transition | tuple


class Statement:
    """The names of an automaton, and what texts in these names stand for.

    `columns` are those of the laws: with lags the newest first; ``x`` is another name of ``x[k]``.
    """

    def __init__(self, states, inputs, parameters: Mapping[str, float] | None, lags: int):
        self.states = names_of_columns("states", states)
        self.inputs = names_of_columns("inputs", inputs)
        self.constants = constants_of(parameters)
        for name in {*self.states, *self.inputs} & {*CLOCKS, *self.constants}:
            raise ValueError(
                f"{name!r} names a state or an input and something else too; dwell and time are "
                "the clocks of guards, and each parameter needs a name of its own."
            )
        self.columns = [*lagged_names(self.states, lags), *lagged_names(self.inputs, lags)]
        self.lags = lags

    # -- laws --------------------------------------------------------------------------------------

    def laws(self, laws: StatedLaws, feature_library) -> tuple[Array, FeatureMap]:
        """Coefficients of the modes and their features."""
        rows = np.ones((1, len(self.columns)))
        texts = _texts(laws)
        if not texts:
            coef = numbers("laws", laws)
            features = FeatureMap(feature_library, rows, self.columns)
            return coef[None] if coef.ndim == 2 else coef, features
        if feature_library is not None:
            raise ValueError(
                "laws given as text are polynomials and take no feature_library; give their "
                "coefficients, (n_modes, n_states, n_features), beside a library."
            )
        read = [self._law(mode, law) for mode, law in enumerate(texts)]
        degrees = [sum(powers) for law in read for one in law for powers in one]
        features = FeatureMap(max([1, *degrees]), rows, self.columns)
        places = {tuple(powers): k for k, powers in enumerate(features.library.powers_.tolist())}
        coef = np.zeros((len(read), len(self.states), len(places)))
        for mode, law in enumerate(read):
            for state, one in enumerate(law):
                for powers, value in one.items():
                    coef[mode, state, places[powers]] = value
        return coef, features

    def _law(self, mode: int, law: Mapping[str, Expression]) -> list[Polynomial]:
        if set(law) != set(self.states):
            raise ValueError(
                f"the law of mode {mode} is one of {', '.join(map(str, law))}; give one polynomial "
                f"for each of {', '.join(self.states)}."
            )
        return [self._read(law[name], self.columns) for name in self.states]

    # -- transitions -------------------------------------------------------------------------------

    def transitions(self, told: Sequence[StatedTransition]) -> tuple[Transition, ...]:
        """All transitions: each itself, or (source, target, guard) with or without a reset."""
        if not isinstance(told, (list, tuple)):
            raise TypeError(f"transitions={shown(told)} must be a list of transitions.")
        return tuple(self._transition(number, one) for number, one in enumerate(told))

    def _transition(self, number: int, told: StatedTransition) -> Transition:
        if isinstance(told, Transition):
            return told
        if not isinstance(told, tuple) or len(told) not in (3, 4):
            raise TypeError(
                f"transitions[{number}]={shown(told)} must be a Transition or a tuple (source, "
                "target, guard, reset), the reset left out where the state goes on."
            )
        source, target, guard, reset = (*told, None)[:4]
        if isinstance(reset, Mapping):
            reset = self._reset(number, reset) if reset else None
        if not isinstance(reset, AffineReset | None):
            raise TypeError(
                f"transitions[{number}] has the reset {shown(reset)}; give a dict from states to "
                'affine functions, such as {"v": "-0.8 v"}, an AffineReset, or None.'
            )
        if not isinstance(guard, Guard):
            guard = self._guard(guard)
        return Transition(source, target, guard, reset)

    def _guard(self, condition: str) -> Guard:
        """That of inequalities that are joined by ``and`` or ``&``."""
        columns, conditions = [*self.columns, *CLOCKS], []
        parts = inequalities_in(condition) if isinstance(condition, str) else [condition]
        for part in parts:
            told = read_inequality(part, columns, self.constants)
            powers = np.array(list(told), dtype=np.intp).reshape(len(told), len(columns))
            conditions.append(PolynomialGuard(np.array(list(told.values())), powers))
        return guard_of(conditions)

    def _reset(self, number: int, told: Mapping[str, Expression]) -> AffineReset:
        """An affine map of the newest state, or of the lagged one if it takes part."""
        n_all = len(self.states) * (self.lags + 1)
        names = self.columns[:n_all]
        matrix, offset = np.eye(n_all), np.zeros(n_all)
        for name, expression in told.items():
            if not isinstance(name, str):
                raise TypeError(
                    f"transitions[{number}] resets {shown(name)}; name the state that it resets."
                )
            place = self._place(number, name, names)
            matrix[place] = 0.0
            for powers, value in self._read(expression, names).items():
                if sum(powers) > 1:
                    raise ValueError(
                        f"the reset of {name} in transitions[{number}] is not affine in the states."
                    )
                if any(powers):
                    matrix[place, powers.index(1)] = value
                else:
                    offset[place] = value
        n_newest = len(self.states)
        older = matrix - np.eye(n_all)
        if older[n_newest:].any() or older[:, n_newest:].any() or offset[n_newest:].any():
            return AffineReset(matrix, offset)
        return AffineReset(matrix[:n_newest, :n_newest], offset[:n_newest])

    def _place(self, number: int, name: str, names: list[str]) -> int:
        for known in other_names(name):
            if known in names:
                return names.index(known)
        raise ValueError(
            f"transitions[{number}] resets {name!r}, which is no state; choose among "
            f"{', '.join(names)}."
        )

    def _read(self, told: Expression, columns: list[str]) -> Polynomial:
        return read_polynomial(told, columns, self.constants)


def constants_of(parameters: Mapping[str, float] | None) -> dict[str, float]:
    """Names in texts that stand for numbers."""
    if parameters is not None and not isinstance(parameters, Mapping):
        raise TypeError(f"parameters={shown(parameters)} must be a dict from names to numbers.")
    told = parameters or {}
    if not all(isinstance(name, str) for name in told):
        raise TypeError(f"parameters={shown(told)} has keys that are no text; name each number.")
    return {name: real(name, value) for name, value in told.items()}


def _texts(laws: StatedLaws) -> list[Mapping[str, Expression]]:
    """The laws if they are told as text, else none."""
    told = laws if isinstance(laws, Sequence) else []
    texts = [law for law in told if isinstance(law, Mapping)]
    return texts if len(texts) == len(told) else []
