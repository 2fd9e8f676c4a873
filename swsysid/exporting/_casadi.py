"""A system for CasADi: one function a mode, guards and resets beside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from swsysid.exporting._expressions import Expression
from swsysid.exporting._extras import extra
from swsysid.exporting._system import HybridSystem
from swsysid.exporting._text import identifiers

if TYPE_CHECKING:
    import casadi


@dataclass(frozen=True)
class CasadiTransition:
    """A way out of a mode.

    Attributes
    ----------
    source, target : int
    guard : casadi.Function
        ``(x, u, t, dwell) -> value``; the transition is taken where it rises to zero.
    reset : casadi.Function or None
        ``(x, u, t, dwell) -> state`` after it; None where the state goes on.
    """

    source: int
    target: int
    guard: casadi.Function
    reset: casadi.Function | None


@dataclass(frozen=True)
class CasadiSystem:
    """A system as functions of CasADi.

    Attributes
    ----------
    states, inputs : tuple of str
    laws : tuple of casadi.Function
        For each mode ``(x, u, t) -> rate`` of the states, in discrete time their next value.
    rhs : casadi.Function or None
        The same of the mode that the state tells; None where modes have memory.
    surfaces : casadi.Function or None
        ``(x, u, t) -> values`` whose signs tell the mode.
    transitions : tuple of CasadiTransition
    """

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    laws: tuple[casadi.Function, ...]
    rhs: casadi.Function | None
    surfaces: casadi.Function | None
    transitions: tuple[CasadiTransition, ...]


def casadi_system(system: HybridSystem) -> CasadiSystem:
    """Laws, surfaces, guards and resets as functions of CasADi."""
    ca = extra("casadi")
    x, u = ca.SX.sym("x", len(system.states)), ca.SX.sym("u", len(system.inputs))
    t, dwell = ca.SX.sym("t"), ca.SX.sym("dwell")
    operations = {
        "add": lambda *parts: sum(parts[1:], parts[0]), "mul": _product,
        "div": lambda a, b: a / b, "pow": lambda a, b: a**b, "min": ca.fmin, "max": ca.fmax,
        "abs": ca.fabs, "positive": lambda a: ca.if_else(a > 0, 1.0, 0.0),
        "where": lambda c, a, b: ca.if_else(c > 0, a, b),
        **{name: vars(ca)[name] for name in _ALIKE},
    }  # fmt: skip

    def leaf(kind: str, argument: float) -> casadi.SX:
        if kind == "number":
            return ca.SX(argument)
        return (
            {"x": x, "u": u}[kind][int(argument)]
            if kind in "xu"
            else (dwell if kind == "dwell" else t)
        )

    def function(name: str, told: Sequence[Expression], seen: Sequence[str]) -> casadi.Function:
        values = ca.vertcat(*(one.folded(leaf, operations) for one in told))
        known = {"x": x, "u": u, "t": t, "dwell": dwell}
        return ca.Function(name, [known[one] for one in seen], [values], list(seen), ["value"])

    laws = tuple(
        function(f"law_{mode}", law, ("x", "u", "t")) for mode, law in enumerate(system.laws)
    )
    rhs = surfaces = None
    if system.surfaces is not None or (len(laws) == 1 and not system.edges):
        value = laws[-1](x, u, t)
        for mode in reversed(range(len(laws) - 1)):
            assert system.surfaces is not None
            enters = system.surfaces.enters(mode).folded(leaf, operations)
            value = ca.if_else(enters >= 0, laws[mode](x, u, t), value)
        rhs = ca.Function("rhs", [x, u, t], [value], ["x", "u", "t"], ["value"])
    if system.surfaces is not None:
        surfaces = function("surfaces", system.surfaces.functions, ("x", "u", "t"))
    seen = ("x", "u", "t", "dwell")
    transitions = tuple(
        CasadiTransition(
            one.source,
            one.target,
            function(f"guard_{place}", [one.guard], seen),
            None if one.reset is None else function(f"reset_{place}", one.reset, seen),
        )
        for place, one in enumerate(system.edges)
    )
    names = identifiers([*system.states, *system.inputs])
    states, inputs = names[: len(system.states)], names[len(system.states) :]
    return CasadiSystem(tuple(states), tuple(inputs), laws, rhs, surfaces, transitions)


_ALIKE = (
    "sign", "sqrt", "exp", "log", "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh",
    "cosh", "tanh",
)  # fmt: skip


def _product(*parts: casadi.SX) -> casadi.SX:
    value = parts[0]
    for part in parts[1:]:
        value = value * part
    return value
