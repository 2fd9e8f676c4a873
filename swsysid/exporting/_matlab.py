"""A system as one MATLAB function: laws, guards, resets, an event function, and rollouts."""

from __future__ import annotations

from collections.abc import Sequence

from swsysid.exporting._c import listed
from swsysid.exporting._expressions import Expression, NoFormulaError
from swsysid.exporting._matlab_runtime import RUNTIME
from swsysid.exporting._slides import with_slides
from swsysid.exporting._system import HybridSystem
from swsysid.exporting._text import Style, identifiers, shared

MATLAB = Style(
    power=lambda base, exponent: f"{base}^({exponent})",
    choice=lambda condition, one, other: f"pick({condition}, {one}, {other})",
)


def matlab_source(system: HybridSystem, name: str) -> str:
    """The file, whose function gives a struct of functions.

    Examples
    --------
    >>> from swsysid import HybridAutomaton
    >>> timer = HybridAutomaton.stated(
    ...     [{"x": "1"}, {"x": "-1"}], [(0, 1, "dwell >= 2"), (1, 0, "x <= 0")], states=["x"]
    ... )
    >>> source = matlab_source(timer.to_hybrid_system(), "timer")
    >>> source.splitlines()[0], "value = -x(1);" in source
    ('function model = timer()', True)
    """
    if system.discrete_time:
        raise NoFormulaError(
            "this writes models of continuous time and this model is a map; write it with to_c."
        )
    written, [prefix] = with_slides(system), identifiers([name])
    seen = [f"x({place})  {one}" for place, one in enumerate(written.states, 1)]
    seen += [f"u({place})  {one}" for place, one in enumerate(written.inputs, 1)]
    seen += [f"mode {mode}  {title}" for mode, title in enumerate(written.titles)]
    starts = [
        f"    if mode < 0 && (label < 0 || label == {written.labels[mode]}) && "
        f"{_text(known)} >= 0, mode = {mode}; end"
        for mode, known in written.starts
    ]
    edges = written.edges
    return "\n".join(
        [
            f"function model = {prefix}()",
            f"%{prefix.upper()}  written by swsysid",
            *(f"%   {line}" for line in (*seen, *system.notes)),
            RUNTIME.split("%%")[0].replace("NAME", prefix),
            f"    model.states = {_words(written.states)};",
            f"    model.inputs = {_words(written.inputs)};",
            f"    model.source = [{listed([one.source for one in edges]) if edges else ''}];",
            f"    model.target = [{listed([one.target for one in edges]) if edges else ''}];",
            f"    model.label = [{listed(written.labels)}];",
            f"    model.size = [{listed(written.sizes)}]';",
            "end\n",
            "function dx = rhs(t, x, u, mode)",
            f"    dx = zeros({len(written.states)}, 1);",
            "    switch mode",
            *(_case(mode, list(law), "dx({}) = {};") for mode, law in enumerate(written.laws)),
            "    end\nend\n",
            "function value = guard(edge, t, x, u, entered)",
            "    dwell = t - entered; value = -1;",
            "    switch edge",
            *(_case(place, [one.guard], "value = {1};") for place, one in enumerate(edges, 1)),
            "    end\nend\n",
            "function y = reset(edge, t, x, u, entered)",
            "    dwell = t - entered; y = x;",
            "    switch edge",
            *(
                _case(place, list(one.reset), "y({}) = {};")
                for place, one in enumerate(edges, 1)
                if one.reset is not None
            ),
            "    end\nend\n",
            "function mode = start(t, x, u, label)",
            "    mode = -1; dwell = 0;",
            *starts,
            "end\n",
            RUNTIME.split("%%")[1].replace("NAME", prefix).lstrip(),
        ]
    )


def _words(names: Sequence[str]) -> str:
    quoted = ["'" + name.replace("'", "''") + "'" for name in names]
    return "{" + ", ".join(quoted) + "}"


def _case(number: int, formulas: Sequence[Expression], assigned: str) -> str:
    """One case of a switch, parts that occur twice named once."""
    parts, left = shared(formulas)
    lines = [f"        case {number}"]
    lines += [f"            s{k} = {_text(part)};" for k, part in enumerate(parts)]
    lines += ["            " + assigned.format(k, _text(one)) for k, one in enumerate(left, 1)]
    return "\n".join(lines)


def _text(expression: Expression) -> str:
    return MATLAB.text(expression, _leaf)


def _leaf(kind: str, place: int) -> str:
    return {"dwell": "dwell", "time": "t"}.get(kind, f"{kind}({place + 1})")
