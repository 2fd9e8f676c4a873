"""SpaceEx models of others: which are read, and whether they do what SciPy does with their XML.

    python -m benchmarks.automata.spaceex FOLDER [--names toy.xml ...]

FOLDER is looked through with all folders beneath it, such as the examples and tests of HyST. A
model is read as it stands, else with ``urgent=True``, and with the middle of the ranges that its
settings leave to constants, or 1, where the refusal asks for a value. It is rolled out over its
horizon, from 1 in all states where its settings tell no start, beside an interpreter of the XML
that shares no code with the package: `scipy.integrate.solve_ivp`, an event for each transition.
"""

from __future__ import annotations

import argparse
import math
import re
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.automata.plant import Array
from swsysid import HybridAutomaton
from swsysid.results import FirstModes, Status

_SPACE = "{http://www-verimag.imag.fr/xml-namespaces/sspaceex}"
_NAME = re.compile(r"(?<![\w.])[^\W\d]\w*")
_TIES = 1e-9  # a guard that is as close to zero at an instant counts by where it goes
_ROWS, _MOST_EVENTS = 201, 500
_SAME = 1e-6  # of the largest value of a state: both integrate to 1e-10
_SMALL = 1e-3  # of the largest value of all states, which a state has at least

Values = dict[str, float]


@dataclass
class _Instance:
    """One automaton of a network, its texts in the names of the whole."""

    name: str
    labels: set[str]
    locations: dict[str, tuple[str, list[str], list[str]]]  # name, flows, invariants
    edges: list[tuple[str, str, str, list[str], list[str]]]  # ends, label, guards, assignments


@dataclass
class _Read:
    """A model and its settings, read without the package."""

    instances: list[_Instance] = field(default_factory=list)
    start: dict[str, tuple[float, float]] = field(default_factory=dict)
    places: dict[str, str] = field(default_factory=dict)
    horizon: float = 10.0


def main(arguments: list[str] | None = None) -> None:
    """A line for each model, and how many of each kind."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder")
    parser.add_argument("--names", nargs="+", help="of files; all others are left out")
    options = parser.parse_args(arguments)
    counts: Counter[str] = Counter()
    for path in sorted(Path(options.folder).rglob("*.xml")):
        if b"<sspaceex" in path.read_bytes()[:3000] and path.name in (options.names or [path.name]):
            kind, told = _checked(path)
            counts[kind] += 1
            print(f"{path.relative_to(options.folder)}: {kind}: {told}", flush=True)
    print(", ".join(f"{count} {kind}" for kind, count in counts.most_common()))


def _checked(path: Path) -> tuple[str, str]:
    """What becomes of a model, and what there is to say of it."""
    try:
        automaton, how, given = _automaton(path)
    except ValueError as refused:
        return "refused", str(refused)
    size = f"{automaton.n_modes} modes, {len(automaton.transitions)} transitions"
    off = _apart(automaton, path, given)
    return f"read {how}{' and as SciPy' if off <= _SAME else ' and NOT AS SCIPY'}", (
        f"{size}, apart by {off:.1e}"
    )


def _automaton(path: Path) -> tuple[HybridAutomaton, str, Values]:
    """What is read, how, and the values that constants were given."""
    how, constants, urgent = "as it stands", {}, False
    while True:
        try:
            read = HybridAutomaton.from_spaceex(path, constants, urgent=urgent)
            return read, how, constants
        except ValueError as refused:
            asked = re.search(r"parameters=\{'(\w+)'", str(refused))
            given = _settings(path.with_suffix(".cfg")).start
            if asked and asked[1] not in constants:
                constants[asked[1]] = sum(given.get(asked[1], (1.0, 1.0))) / 2.0
            elif "urgent=True" in str(refused) and not urgent:
                urgent, how = True, "as urgent"
            else:
                raise


def _apart(automaton: HybridAutomaton, path: Path, given: Values) -> float:
    """Largest difference of both rollouts, in units of the largest value of each state."""
    read = _settings(path.with_suffix(".cfg"))
    _instances(path, read)
    t = np.linspace(0.0, read.horizon, _ROWS)
    names = [re.sub(r"^(dwell|time)_2$", r"\1", one) for one in automaton.state_names]
    inputs = automaton.input_names
    told = {name: sum(ends) / 2.0 for name, ends in read.start.items() if np.isfinite(ends).all()}
    told = dict.fromkeys(inputs, 0.0) | dict.fromkeys(names, 1.0) | given | told
    theirs = _rolled_out(read, t, names, told)
    u = np.array([[told.get(name, 0.0) for name in inputs]] * len(t)) if inputs else None
    begins = np.array([[told[name] for name in names]])
    first = automaton.first_modes or FirstModes(begins, np.array([0]))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        run = automaton.simulate(
            first.states[0], t, u, mode=int(first.modes[0]), rtol=1e-10, atol=1e-12
        )
    n = len(run.x)  # one that diverges ends early
    if n > len(theirs) or (n < len(theirs) and run.status is not Status.STATE_LIMIT):
        return math.inf
    size = np.nanmax(np.abs(theirs[:n]), axis=0)
    return float(np.nanmax(np.abs(run.x - theirs[:n]) / np.maximum(size, _SMALL * size.max())))


# -- the XML ---------------------------------------------------------------------------------------


def _settings(path: Path) -> _Read:
    read = _Read()
    text = path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""
    entries = dict(re.findall(r'^\s*([\w-]+)\s*=\s*"?([^"\n]*)"?\s*$', text, re.MULTILINE))
    read.horizon = float(entries.get("time-horizon", 10.0))
    read.places["system"] = entries.get("system", "").strip()
    for part in entries.get("initially", "").split("&"):
        if place := re.match(r"\s*loc\s*\((.*)\)\s*==?\s*(\w+)", part):
            read.places["at " + place[1].strip()] = place[2]
        elif part.strip():
            for left, relation, right in _relations(part):
                name, value = (left, right) if _NAME.fullmatch(left) else (right, left)
                least, most = read.start.get(name, (-math.inf, math.inf))
                number = _function(value, set())({})
                low = relation == "==" or (">" in relation) == (name == left)
                high = relation == "==" or ("<" in relation) == (name == left)
                read.start[name] = (
                    max(least, number) if low else least,
                    min(most, number) if high else most,
                )
    return read


def _instances(path: Path, read: _Read) -> None:
    root = ElementTree.fromstring(path.read_bytes())
    every = {one.get("id", ""): one for one in root.iter(f"{_SPACE}component")}
    bound = {one.get("component") for one in root.iter(f"{_SPACE}bind")}
    top = read.places["system"] or next(name for name in every if name not in bound)

    def add(name: str, prefix: str, names: dict[str, str]) -> None:
        element = every[name]
        for bind in element.findall(f"{_SPACE}bind"):
            inner, inside = bind.get("component", ""), f"{prefix}{bind.get('as')}"
            given = {one.get("key"): (one.text or "").strip() for one in bind}
            told = {
                one.get("name", ""): _put(given[one.get("name")], names)
                if one.get("name") in given
                else f"{inside}_{one.get('name')}".replace(".", "_")
                for one in every[inner].findall(f"{_SPACE}param")
            }
            add(inner, f"{inside}.", told)
        if element.find(f"{_SPACE}location") is not None:
            labels = {names.get(one.get("name", ""), one.get("name", ""))
                      for one in element.findall(f"{_SPACE}param")
                      if one.get("type") == "label"}  # fmt: skip
            read.instances.append(_instance(element, prefix.rstrip("."), names, labels))

    add(top, "", {})
    _put_outputs(read.instances)


def _put_outputs(instances: list[_Instance]) -> None:
    """What defines names that nothing moves, in their places."""
    moved = " & ".join(
        part for one in instances for own in one.locations.values() for part in own[1]
    ) + " ".join(part for one in instances for edge in one.edges for part in edge[4])
    for one in instances:
        same = set.intersection(*({*own[2]} for own in one.locations.values()))
        for name, equal, text in (part.partition("==") for part in sorted(same)):
            if equal and not re.search(rf"\b{name.strip()}\s*('|:=|=)", moved):
                for other in instances:
                    _rename(other, {name.strip(): text.strip()})


def _rename(one: _Instance, names: dict[str, str]) -> None:
    def put(texts: list[str]) -> list[str]:
        return [_put(text, names) for text in texts]

    one.locations = {key: (own[0], put(own[1]), put(own[2])) for key, own in one.locations.items()}
    one.edges = [(*edge[:3], put(edge[3]), put(edge[4])) for edge in one.edges]


def _instance(
    element: ElementTree.Element, name: str, names: dict[str, str], labels: set[str]
) -> _Instance:
    def parts(one: ElementTree.Element, tag: str) -> list[str]:
        text = " & ".join(child.text or "" for child in one.findall(_SPACE + tag))
        split = (_put(" ".join(part.split()), names) for part in text.split("&"))
        return [part for part in split if part not in ("", "true")]

    locations = {
        one.get("id", ""): (one.get("name", ""), parts(one, "flow"), parts(one, "invariant"))
        for one in element.findall(f"{_SPACE}location")
    }
    edges = [
        (one.get("source", ""), one.get("target", ""), " ".join(parts(one, "label")),
         parts(one, "guard"), parts(one, "assignment"))
        for one in element.findall(f"{_SPACE}transition")
    ]  # fmt: skip
    return _Instance(name, labels, locations, edges)


def _put(text: str, names: dict[str, str]) -> str:
    def own(match: re.Match[str]) -> str:
        told = names.get(match[0], match[0])
        return told if _NAME.fullmatch(told) else f"({told})"

    return _NAME.sub(own, text)


def _relations(text: str) -> Iterator[tuple[str, str, str]]:
    pieces = [one.strip() for one in re.split(r"(<=|>=|==|=|<|>)", text)]
    for place in range(0, len(pieces) - 2, 2):
        yield (
            pieces[place],
            pieces[place + 1]
            .replace("==", "=")
            .replace("=", "==")
            .replace("<==", "<=")
            .replace(">==", ">="),
            pieces[place + 2],
        )


def _function(text: str, names: set[str]) -> Callable[[Values], float]:
    """Arithmetic in these names."""
    if not {*_NAME.findall(text)} <= names or not re.fullmatch(r"[\w\s.+*/()^-]*", text):
        raise ValueError(f"{text!r} is more than arithmetic in {sorted(names)}")
    code = compile(text.strip().replace("^", "**"), text, "eval")
    return lambda values: float(eval(code, {"__builtins__": {}}, values))


# -- what it does ----------------------------------------------------------------------------------


def _rolled_out(read: _Read, t: Array, names: list[str], values: Values) -> Array:
    """States at the times, transitions taken as soon as they may be."""
    at = [_first(one, read) for one in read.instances]
    now, rows = 0.0, np.empty((0, len(names)))
    for _ in range(_MOST_EVENTS):
        flows = _flows(read, at, values)
        ways = [way for way in _ways(read, at) if _may_be_entered(read, at, way, values)]
        taken = _open(flows, ways, values)
        if taken is None and flows is not None:
            left = t[len(rows) :]
            order = list(flows)
            made = solve_ivp(
                lambda _, x, f=flows, o=order, v=values: _rates(f, o, v, x),
                (now, t[-1]),
                [values[name] for name in order],
                dense_output=True,
                events=[_event(way, order, values) for way in ways] or None,
                rtol=1e-10,
                atol=1e-12,
                max_step=(t[-1]) / 2000.0,
            )
            passed = left[left <= made.t[-1]]
            seen = dict(zip(order, made.sol(passed), strict=True)) if passed.size else {}
            seen = {name: np.full(len(passed), values[name]) for name in names} | seen
            new = np.array([seen[name] for name in names]).T
            # a row at an instant may stand on either side of it
            new[np.abs(passed - now) < _SAME * t[-1]] = np.nan if now else new[:1]
            rows = np.vstack([rows, new])
            if made.status != 1:
                return rows
            taken, state = next((k, y[-1]) for k, y in enumerate(made.y_events) if len(y))
            now = made.t_events[taken][-1]
            rows[np.abs(t[: len(rows)] - now) < _SAME * t[-1]] = np.nan
            values = values | dict(zip(order, state.tolist(), strict=True))
        if taken is None:
            raise ValueError("no time passes, and no way is open")
        moves, _, assigned = ways[taken]
        values = values | {
            name: _function(text, {*values})(values) for name, text in assigned.items()
        }
        at = [moves.get(k, place) for k, place in enumerate(at)]
    return rows


def _first(one: _Instance, read: _Read) -> str:
    told = read.places.get(f"at {one.name}", read.places.get("at "))
    return next((key for key, own in one.locations.items() if own[0] == told), [*one.locations][0])


def _flows(read: _Read, at: list[str], values: Values) -> dict[str, Callable] | None:
    """The rate of each state, None where no time passes."""
    told = [part for one, place in zip(read.instances, at, strict=True)
            for part in one.locations[place][1]]  # fmt: skip
    if "false" in told:
        return None
    pairs = (re.split(r"'\s*==?", part, maxsplit=1) for part in told)
    return {name.strip(): _function(text, {*values}) for name, text in pairs}


def _rates(flows: dict[str, Callable], order: list[str], values: Values, x: Array) -> list[float]:
    seen = values | dict(zip(order, map(float, x), strict=True))
    return [flows[name](seen) for name in order]


Way = tuple[dict[int, str], list[tuple[str, str, str]], dict[str, str]]


def _ways(read: _Read, at: list[str]) -> Iterator[Way]:
    """Where instances go together, what they ask, and what they set."""
    out = [[edge for edge in one.edges if edge[0] == place]
           for one, place in zip(read.instances, at, strict=True)]  # fmt: skip
    done = set()
    for k, own in enumerate(out):
        for edge in own:
            know = [n for n, one in enumerate(read.instances) if edge[2] and edge[2] in one.labels]
            if edge[2] in done:
                continue
            sides = [[one for one in out[n] if one[2] == edge[2]] for n in know] or [[edge]]
            done |= {edge[2]} - {""}
            for together in product(*sides):
                guards = [one for each in together for part in each[3] for one in _relations(part)]
                sets = dict(_set(part) for each in together for part in each[4])
                ends = zip(know or [k], together, strict=True)
                yield {n: each[1] for n, each in ends}, guards, sets


def _may_be_entered(read: _Read, at: list[str], way: Way, values: Values) -> bool:
    """Whether the equations of the invariants hold where a way leads."""
    moves, _, assigned = way
    after = values | {name: _function(text, {*values})(values) for name, text in assigned.items()}
    parts = (
        told
        for k, (one, place) in enumerate(zip(read.instances, at, strict=True))
        for part in one.locations[moves.get(k, place)][2]
        for told in _relations(part)
    )
    equations = [(left, right) for left, relation, right in parts if relation == "=="]
    sides = ([_function(text, {*values})(after) for text in both] for both in equations)
    return all(math.isclose(one, other, abs_tol=_TIES) for one, other in sides)


def _set(part: str) -> tuple[str, str]:
    name, text = re.split(r":=|==|=", part, maxsplit=1)
    return name.strip().rstrip("'").strip(), text


def _margin(way: Way, entered: Values) -> Callable[[Values], float]:
    """What rises to zero where all conditions hold; an equation from the side of the entry."""
    asked = []
    for left, relation, right in way[1]:
        one, other = (_function(text, {*entered}) for text in (left, right))
        sign = 1.0 if ">" in relation else -1.0
        if relation == "==":
            sign = -1.0 if one(entered) > other(entered) else 1.0
        asked.append((one, other, sign))

    def margin(values: Values) -> float:
        return min((sign * (a(values) - b(values)) for a, b, sign in asked), default=1.0)

    return margin


def _event(way: Way, order: list[str], values: Values) -> Callable[[float, Array], float]:
    margin = _margin(way, values)

    def event(_: float, x: Array) -> float:
        return margin(values | dict(zip(order, map(float, x), strict=True)))

    event.terminal, event.direction = True, 1.0  # type: ignore[attr-defined]
    return event


def _open(flows: dict | None, ways: list[Way], values: Values) -> int | None:
    """The first way that is open at an instant, or opens then."""
    for number, way in enumerate(ways):
        margin = _margin(way, values)
        size = margin(values)
        if size > _TIES:
            return number
        if abs(size) <= _TIES and flows is not None:
            moved = values | {name: values[name] + 1e-7 * f(values) for name, f in flows.items()}
            if margin(moved) > size:
                return number
        if flows is None and size >= -_TIES:
            return number
    return None


if __name__ == "__main__":
    main()
