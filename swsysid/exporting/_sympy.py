"""A system for SymPy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from swsysid.exporting._expressions import Expression
from swsysid.exporting._extras import extra
from swsysid.exporting._system import HybridSystem
from swsysid.exporting._text import identifiers

if TYPE_CHECKING:
    import sympy


@dataclass(frozen=True)
class SymbolicTransition:
    """A way out of a mode.

    Attributes
    ----------
    source, target : int
    guard : sympy.Expr
        The transition is taken where it rises to zero.
    reset : sympy.Matrix or None
        The state after it; None where the state goes on.
    """

    source: int
    target: int
    guard: sympy.Expr
    reset: sympy.Matrix | None


@dataclass(frozen=True)
class SymbolicSystem:
    """A system as formulas of SymPy.

    Attributes
    ----------
    states, inputs : tuple of sympy.Symbol
    time, dwell, mode : sympy.Symbol
        Time, the time since the mode was entered, and the number of the mode.
    laws : tuple of sympy.Matrix
        For each mode the rate of each state, in discrete time its next value.
    rhs : sympy.Matrix
        The same of the active mode: piecewise in the states where surfaces tell the mode, piecewise
        in `mode` where it has memory.
    surfaces : tuple of sympy.Expr
        Functions whose signs tell the mode; none where it has memory.
    transitions : tuple of SymbolicTransition
    """

    states: tuple[sympy.Symbol, ...]
    inputs: tuple[sympy.Symbol, ...]
    time: sympy.Symbol
    dwell: sympy.Symbol
    mode: sympy.Symbol
    laws: tuple[sympy.Matrix, ...]
    rhs: sympy.Matrix
    surfaces: tuple[sympy.Expr, ...]
    transitions: tuple[SymbolicTransition, ...]


def symbolic(system: HybridSystem) -> SymbolicSystem:
    """Laws, surfaces, guards and resets as formulas of SymPy."""
    sp = extra("sympy")
    fixed = ("t", "dwell", "mode")
    names = identifiers([*system.states, *system.inputs], fixed)
    symbols = [sp.Symbol(name, real=True) for name in names]
    states = tuple(symbols[: len(system.states)])
    inputs = tuple(symbols[len(system.states) :])
    time, dwell, mode = (sp.Symbol(name, real=True) for name in fixed)
    known = {"x": states, "u": inputs, "dwell": (dwell,), "time": (time,)}
    operations = {
        "add": sp.Add, "mul": sp.Mul, "div": lambda a, b: a / b, "pow": sp.Pow, "min": sp.Min,
        "max": sp.Max, "abs": sp.Abs, "sign": sp.sign, "sqrt": sp.sqrt, "exp": sp.exp,
        "log": sp.log, "sin": sp.sin, "cos": sp.cos, "tan": sp.tan, "asin": sp.asin,
        "acos": sp.acos, "atan": sp.atan, "atan2": sp.atan2, "sinh": sp.sinh, "cosh": sp.cosh,
        "tanh": sp.tanh, "positive": lambda a: sp.Piecewise((1, a > 0), (0, True)),
        "where": lambda c, a, b: sp.Piecewise((a, c > 0), (b, True)),
    }  # fmt: skip

    def leaf(kind: str, argument: float) -> sympy.Expr:
        if kind == "number":
            whole = float(argument).is_integer() and abs(argument) < 1e6
            return sp.Integer(int(argument)) if whole else sp.Float(argument)
        return known[kind][int(argument)]

    def told(expression: Expression) -> sympy.Expr:
        return sp.sympify(expression.folded(leaf, operations))

    laws = tuple(sp.Matrix([told(one) for one in law]) for law in system.laws)
    surfaces, edges = system.surfaces, system.edges
    if surfaces is not None:
        active = [told(surfaces.enters(one)) >= 0 for one in range(len(laws))]
    else:
        active = [sp.Eq(mode, one) for one in range(len(laws))]
    rhs = laws[0]
    if len(laws) > 1:
        rhs = sp.Matrix(
            [
                sp.Piecewise(*zip(rows, [*active[:-1], True], strict=True))
                for rows in zip(*laws, strict=True)
            ]
        )
    return SymbolicSystem(
        states, inputs, time, dwell, mode, laws, rhs,
        () if surfaces is None else tuple(map(told, surfaces.functions)),
        tuple(
            SymbolicTransition(
                one.source, one.target, told(one.guard),
                None if one.reset is None else sp.Matrix([told(each) for each in one.reset]),
            )
            for one in edges
        ),
    )  # fmt: skip
