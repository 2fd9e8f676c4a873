"""A system as a Modelica model: laws by mode, transitions in `when`, resets by `reinit`."""

from __future__ import annotations

from collections.abc import Sequence

from swsysid._checks.arrays import state
from swsysid._checks.parameters import whole
from swsysid.exporting._expressions import Expression, NoFormulaError, evaluated
from swsysid.exporting._slides import with_slides
from swsysid.exporting._system import HybridSystem
from swsysid.exporting._text import Names, Style, identifiers, named

MODELICA = Style(
    power=lambda base, exponent: f"{base}^({exponent})",
    choice=lambda condition, one, other: f"(if {condition} > 0 then {one} else {other})",
)
# words of the language, its functions and our own variables
_TAKEN = (
    "model equation algorithm when then if else elseif elsewhen end discrete Integer Real input "
    "output parameter reinit pre der time mode entered and or not in for while loop function "
    "constant flow stream block class connector type package protected public final each "
    "initial replaceable redeclare true false break return import operator record external"
).split()


def modelica_source(system: HybridSystem, name: str, x0: object, mode: int | None) -> str:
    """The model, which starts at `x0` in a mode.

    Examples
    --------
    >>> from swsysid import HybridAutomaton
    >>> ball = HybridAutomaton.stated(
    ...     [{"h": "v", "v": "-9.81"}], [(0, 0, "h <= 0", {"v": "-0.8 v"})], states=["h", "v"]
    ... )
    >>> source = modelica_source(ball.to_hybrid_system(), "Ball", [10.0, 0.0], None)
    >>> [line.strip() for line in source.splitlines() if "reinit" in line]
    ['reinit(v, -0.8*pre(v));']
    """
    if system.discrete_time:
        raise NoFormulaError(
            "this writes models of continuous time and this model is a map; write it with to_c."
        )
    n = len(system.states)
    start = system.origin if x0 is None else tuple(state("x0", x0, n).tolist())
    whole("mode", mode, least=0, most=max(system.labels), also=(None,))
    written = with_slides(system)
    [prefix, *names] = identifiers([name, *system.states, *system.inputs], _TAKEN)
    states, inputs = names[:n], names[n:]
    seen = named(states, inputs, ("(time - entered)", "time"))
    first = _first(written, start, mode)
    lines = [f'model {prefix} "written by swsysid"']
    lines += [f"  // {note}" for note in system.notes]
    lines += [f"  // mode {number}: {title}" for number, title in enumerate(written.titles)]
    lines += [f"  input Real {one};" for one in inputs]
    lines += [
        f"  Real {one}(start={value!r}, fixed=true);"
        for one, value in zip(states, start, strict=True)
    ]
    if written.edges:
        lines.append(f"  discrete Integer mode(start={first}, fixed=true);")
        lines.append("  discrete Real entered(start=0.0, fixed=true);")
    lines.append("equation")
    lines += [
        f"  der({one}) = {_by_mode([MODELICA.text(law[place], seen) for law in written.laws])};"
        for place, one in enumerate(states)
    ]
    branches = []
    for edge in written.edges:
        condition = f"pre(mode) == {edge.source} and {MODELICA.text(edge.guard, seen)} > 0"
        branches.append((condition, edge.target))
        if edge.reset is not None:
            lines.append(f"  when {condition} then")
            lines += _reset(edge.reset, states, inputs)
            lines.append("  end when;")
    lines += ["algorithm"] * bool(branches)
    for place, (condition, target) in enumerate(branches):
        lines += [
            f"  {'elsewhen' if place else 'when'} {condition} then",
            f"    mode := {target};",
            "    entered := time;",
        ]
    lines += ["  end when;"] * bool(branches)
    return "\n".join([*lines, f"end {prefix};", ""])


def _first(system: HybridSystem, x0: Sequence[float], mode: int | None) -> int:
    """The mode to start in, of those of a mode of the model."""
    point = {"x": x0, "u": [0.0] * len(system.inputs)}
    for number, known in system.starts:
        if mode in (None, system.labels[number]) and evaluated(known, point) >= 0.0:
            return number
    raise ValueError(f"the state tells another mode than mode={mode}; leave mode out.")


def _by_mode(laws: Sequence[str]) -> str:
    text = "".join(
        f"{'elseif' if mode else 'if'} mode == {mode} then {law} "
        for mode, law in enumerate(laws[:-1])
    )
    return f"{text}else {laws[-1]}" if text else laws[-1]


def _reset(reset: Sequence[Expression], states: Sequence[str], inputs: Sequence[str]) -> list[str]:
    """What becomes of the states that change, from those before."""
    before: Names = named([f"pre({one})" for one in states], inputs, ("(time - entered)", "time"))
    return [
        f"    reinit({one}, {MODELICA.text(value, before)});"
        for place, (one, value) in enumerate(zip(states, reset, strict=True))
        if value != Expression("x", (place,))
    ]
