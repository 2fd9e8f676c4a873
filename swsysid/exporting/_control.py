"""A system for python-control."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from swsysid._results import Array
from swsysid.exporting._expressions import NUMBERS, Expression, NoFormulaError
from swsysid.exporting._extras import extra
from swsysid.exporting._system import HybridSystem
from swsysid.exporting._text import identifiers

if TYPE_CHECKING:
    import control

Point = tuple[Sequence[float], Sequence[float], float]  # states, inputs, time
Function = Callable[[Point], float]


def nonlinear_system(
    system: HybridSystem, name: str, mode: int | None
) -> control.NonlinearIOSystem:
    """A `control.nlsys`, of one mode or of that which the state tells."""
    control = extra("control")
    laws = [[compiled(one) for one in law] for law in system.laws]
    if mode is None and system.surfaces is None and len(laws) > 1:
        raise NoFormulaError(
            "the modes have memory and python-control has no events; give mode= for the law of one "
            "of them."
        )
    if mode is None and system.edges:
        raise NoFormulaError(
            "the state jumps and python-control has no events; give mode= for the law in between."
        )
    if mode is not None and not 0 <= mode < len(laws):
        raise ValueError(f"mode={mode}; the modes are numbered from 0 to {len(laws) - 1}.")
    decisions = [] if system.surfaces is None else list(map(compiled, system.surfaces.decisions))
    fixed = 0 if mode is None else mode

    def rates(t: float, x: Array, u: Array, params: Mapping[str, object]) -> Array:
        point = (np.ravel(x).tolist(), np.ravel(u).tolist(), float(t))
        own = fixed
        if mode is None and decisions:
            own = int(np.argmax([decision(point) for decision in decisions]))
        return np.array([law(point) for law in laws[own]])

    if mode is None and len(laws) > 1 and not system.discrete_time:
        warnings.warn(
            "python-control's solver has no events: it steps over the surfaces between the modes "
            "and is accurate to its step there; give max_step in solve_ivp_kwargs, or use to_c or "
            "to_fmu.",
            UserWarning,
            stacklevel=3,
        )
    names = identifiers([*system.states, *system.inputs])
    states, inputs = names[: len(system.states)], names[len(system.states) :]
    return control.nlsys(
        rates,
        None,
        name=name,
        states=states,
        inputs=inputs,
        outputs=states,
        dt=True if system.discrete_time else 0,
    )


def compiled(expression: Expression) -> Function:
    """A formula as a function of (states, inputs, time), much sooner than `evaluated`."""

    def leaf(kind: str, argument: float) -> Function:
        if kind == "number":
            return lambda point: argument
        if kind == "time":
            return lambda point: point[2]
        if kind == "dwell":
            raise NoFormulaError("a law depends on the time since its mode was entered")
        number = int(argument)
        if kind == "x":
            return lambda point: point[0][number]
        return lambda point: point[1][number]

    def made(operation: Callable[..., float]) -> Callable[..., Function]:
        return lambda *parts: lambda point: operation(*(part(point) for part in parts))

    return expression.folded(leaf, {kind: made(own) for kind, own in NUMBERS.items()})
