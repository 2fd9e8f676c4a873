"""A system as one C99 file without dependencies: laws, guards, resets, steps with events."""

from __future__ import annotations

from collections.abc import Sequence

from swsysid.exporting._c_runtime import CONTINUOUS, DISCRETE
from swsysid.exporting._expressions import Expression
from swsysid.exporting._slides import with_slides
from swsysid.exporting._system import Edge, HybridSystem
from swsysid.exporting._text import Style, identifiers, shared

C = Style(
    power=lambda base, exponent: f"pow({base}, {exponent})",
    choice=lambda condition, one, other: f"({condition} > 0.0 ? {one} : {other})",
    functions={"abs": "fabs", "min": "fmin", "max": "fmax"},
)
_SEEN = "const double *x, const double *u, double dwell, double t"
_UNUSED = "    (void)x; (void)u; (void)dwell; (void)t;"


def c_source(system: HybridSystem, name: str) -> str:
    """The file; what the functions take and return stands beside them.

    Examples
    --------
    >>> from swsysid import HybridAutomaton
    >>> timer = HybridAutomaton.stated(
    ...     [{"x": "1"}, {"x": "-1"}], [(0, 1, "dwell >= 2"), (1, 0, "x <= 0")], states=["x"]
    ... )
    >>> source = c_source(timer.to_hybrid_system(), "timer")
    >>> "int timer_step(timer_state *s, double t0, const double *u0" in source
    True
    """
    [prefix] = identifiers([name])
    written = with_switches(system)
    runtime = DISCRETE if system.discrete_time else CONTINUOUS
    sizes = f"\nstatic const double {prefix}_size[] = {{{listed(system.sizes)}}};\n"
    return (
        formulas(written, prefix, system.notes)
        + ("" if system.discrete_time else sizes)
        + runtime.replace("NAME", prefix)
    )


def with_switches(system: HybridSystem) -> HybridSystem:
    """The system with edges alone; those of surfaces of a map have no slides."""
    if not system.discrete_time:
        return with_slides(system)
    if system.surfaces is None:
        return system
    modes, surfaces = range(len(system.laws)), system.surfaces
    return HybridSystem(
        system.states,
        system.inputs,
        system.laws,
        edges=tuple(
            Edge(one, other, surfaces.enters(other))
            for one in modes
            for other in modes
            if one != other
        ),
        discrete_time=True,
        starts=tuple((mode, surfaces.enters(mode)) for mode in modes),
        origin=system.origin,
        sizes=system.sizes,
    )


def formulas(system: HybridSystem, prefix: str, notes: Sequence[str], static: str = "") -> str:
    """Laws, guards, resets and starts as functions of a mode or of an edge."""
    n, m, edges = len(system.states), len(system.inputs), system.edges
    texts = [f"x[{place}]  {name}" for place, name in enumerate(system.states)]
    texts += [f"u[{place}]  {name}" for place, name in enumerate(system.inputs)]
    texts += [f"mode {mode}  {title}" for mode, title in enumerate(system.titles)]
    comment = "\n".join(f"   {one}" for one in (*texts, *notes)).replace("*/", "* /")
    sources, targets = ([one.source for one in edges], [one.target for one in edges])
    lines = [
        f"/* {prefix}, written by swsysid.\n{comment} */",
        "#include <float.h>\n#include <math.h>\n#include <string.h>\n",
        f"enum {{ {prefix}_STATES = {n}, {prefix}_INPUTS = {m}, "
        f"{prefix}_MODES = {len(system.laws)}, "
        f"{prefix}_EDGES = {len(edges)},",
        f"       {prefix}_N = {max(n, 1)}, {prefix}_U = {max(m, 1)}, {prefix}_E = "
        f"{max(len(edges), 1)} }};  /* no array is empty */",
        f"static const int {prefix}_source[] = {{{listed(sources)}}};",
        f"static const int {prefix}_target[] = {{{listed(targets)}}};",
        f"static const int {prefix}_label[] = {{{listed(system.labels)}}};",
        "static double sign(double a) { return (a > 0.0) - (a < 0.0); }\n",
        "/* The rate of each state in a mode (of a map its next value). */",
        f"{static}void {prefix}_rhs(int mode, const double *x, const double *u, double t, "
        "double *dx)",
        "{",
        "    (void)x; (void)u; (void)t; (void)sign;",
        "    switch (mode) {",
    ]
    for mode, law in enumerate(system.laws):
        lines += _case(mode, list(law), "dx[{}] = {};")
    lines += [
        "    }\n}\n",
        "/* An edge leaves its mode where its guard rises to zero. */",
        f"{static}double {prefix}_guard(int edge, {_SEEN})",
        "{",
        "    double value = -1.0;",
        _UNUSED,
        "    switch (edge) {",
    ]
    for place, edge in enumerate(edges):
        lines += _case(place, [edge.guard], "value = {1};")
    lines += [
        "    }\n    return value;\n}\n",
        "/* The state y after an edge from the state x. */",
        f"{static}void {prefix}_reset(int edge, {_SEEN}, double *y)",
        "{",
        _UNUSED,
        f"    memcpy(y, x, {prefix}_STATES * sizeof *y);",
        "    switch (edge) {",
    ]
    for place, edge in enumerate(edges):
        if edge.reset is not None:
            lines += _case(place, list(edge.reset), "y[{}] = {};")
    lines += [
        "    }\n}\n",
        "/* The mode to start in, of those of a label; -1 if there is none. */",
        f"{static}int {prefix}_start(const double *x, const double *u, double t, int label)",
        "{",
        "    const double dwell = 0.0;",
        f"{_UNUSED} (void)label;",
    ]
    for mode, known in system.starts:
        asked = f"label < 0 || label == {system.labels[mode]}"
        lines.append(f"    if (({asked}) && {_text(known)} >= 0.0) return {mode};")
    lines.append("    return -1;\n}")
    return "\n".join(lines)


def listed(values: Sequence[float]) -> str:
    """Numbers of an array, which in C is never empty."""
    return ", ".join(map(repr, values)) or "0"


def _case(number: int, formulas: Sequence[Expression], assigned: str) -> list[str]:
    """One case of a switch, parts that occur twice named once."""
    parts, left = shared(formulas)
    lines = [f"    case {number}: {{"]
    lines += [f"        const double s{k} = {_text(part)};" for k, part in enumerate(parts)]
    lines += ["        " + assigned.format(k, _text(one)) for k, one in enumerate(left)]
    return [*lines, "        break;", "    }"]


def _text(expression: Expression) -> str:
    return C.text(expression, _leaf)


def _leaf(kind: str, place: int) -> str:
    return {"dwell": "dwell", "time": "t"}.get(kind, f"{kind}[{place}]")
