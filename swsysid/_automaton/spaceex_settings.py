"""How a SpaceEx model is run: its ``.cfg``, written and read.

Of what is read only the component, the values of constants and where a run begins are used; the
rest says how SpaceEx computes.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from swsysid._automaton.columns import CLOCKS
from swsysid._automaton.parts import AutomatonParts
from swsysid._automaton.polynomial_text import read_polynomial
from swsysid._automaton.spaceex import clocks_used
from swsysid._automaton.spaceex_network import refusal
from swsysid._checks.arrays import column, state
from swsysid._checks.parameters import shown, whole
from swsysid.exporting._text import identifiers

_ENTRY = re.compile(r"^\s*([\w-]+)\s*=\s*\"?([^\"\n]*)\"?\s*$", re.MULTILINE)
_LOCATION = re.compile(r"loc\s*\(\s*([\w.]*)\s*\)\s*==?\s*(\w+)")
_RELATION = re.compile(r"\s*(<=|>=|==|=|<|>)\s*")


@dataclass
class SpaceexRun:
    """What a ``.cfg`` says of a model."""

    system: str | None = None
    #: Of names: the least and the greatest value at the start.
    ranges: dict[str, tuple[float, float]] = field(default_factory=dict)
    #: Of instances: the location in which they start.
    locations: dict[str, str] = field(default_factory=dict)

    def constants(self, names: list[str], given: Mapping[str, float]) -> dict[str, float]:
        """Values of constants; what is given counts."""
        values = dict(given)
        for name in names:
            least, most = self.ranges.get(name, (np.nan, np.nan))
            if name in given or np.isnan(least):
                continue
            if least < most:
                raise ValueError(
                    f"the settings leave the constant {name!r} between {least:g} and {most:g}; "
                    f"give parameters={{{name!r}: ...}}."
                )
            values[name] = least
        return values

    def start(self, states: list[str]) -> list[float] | None:
        """The middle of where a run begins, if that is told of all states."""
        if not set(states) <= set(self.ranges):
            return None
        middle = [sum(self.ranges[name]) / 2.0 for name in states]
        return middle if np.isfinite(middle).all() else None


def read_settings(text: str) -> SpaceexRun:
    r"""The settings that a ``.cfg`` tells.

    Examples
    --------
    >>> told = read_settings('system = tank\ninitially = "0 <= h <= 2 & g == 2*4.9 & loc()==full"')
    >>> told.system, told.ranges, told.locations
    ('tank', {'h': (0.0, 2.0), 'g': (9.8, 9.8)}, {'': 'full'})
    """
    entries = dict(_ENTRY.findall("\n".join(re.split(r"^\s*#.*$", text, flags=re.MULTILINE))))
    found = SpaceexRun(entries.get("system", "").strip() or None)
    for part in entries.get("initially", "").split("&"):
        location = _LOCATION.fullmatch(part.strip())
        if location:
            found.locations[location[1]] = location[2]
        elif part.strip():
            _bounded(found.ranges, part)
    return found


def _bounded(ranges: dict[str, tuple[float, float]], condition: str) -> None:
    """Narrow the range of the one name in a condition such as ``0 <= x <= 1``."""
    sides, relations = _RELATION.split(condition.strip())[::2], _RELATION.findall(condition)
    for left, relation, right in zip(sides[:-1], relations, sides[1:], strict=True):
        name, value = (right, left) if re.fullmatch(r"[^\W\d][\w.]*", right) else (left, right)
        if not re.fullmatch(r"[^\W\d][\w.]*", name):
            raise refusal(f"its settings say {shown(condition.strip())} of the start")
        number = read_polynomial(value, (), {}).get((), 0.0)
        least, most = ranges.get(name, (-np.inf, np.inf))
        if relation in ("==", "=") or ("<" in relation) == (name == left):
            most = min(most, number)
        if relation in ("==", "=") or ("<" in relation) == (name == right):
            least = max(least, number)
        ranges[name] = least, most


def spaceex_settings(
    automaton: AutomatonParts,
    component: str,
    x0: ArrayLike | None,
    t: ArrayLike | None,
    mode: int | None,
) -> str:
    """How a model is run: the start, the horizon, the step, and what is drawn.

    What is not given is that of the first recorded state where there is one. What is not known
    either is named in a comment.
    """
    first = None if x0 is None else state("x0", x0, automaton.n_states)
    times = None if t is None else column("t", t)
    whole("mode", mode, least=0, most=automaton.n_modes - 1, also=(None,))
    recorded = automaton.first_modes
    if first is None and recorded is not None:
        first = recorded.states[0, : automaton.n_states]
        mode = int(recorded.modes[0]) if mode is None else mode
    comments = [
        f"# {what} is not known to the automaton: put yours here, or give {argument} to to_spaceex"
        for what, argument, value in (
            ("the state at the start", "x0", first),
            ("the mode at the start", "mode", mode if automaton.n_modes > 1 else 0),
            ("the horizon", "t", times),
        )
        if value is None
    ]
    names = identifiers(automaton.feature_map.names_in, CLOCKS)[: automaton.n_states]
    first = np.zeros(len(names)) if first is None else first
    times = np.linspace(0.0, 10.0, 1001) if times is None else times
    clocks = clocks_used(automaton.transitions)
    start = dict(zip(names, first.tolist(), strict=True))
    start.update({name: float(times[0]) if name == "time" else 0.0 for name in clocks})
    initially = " & ".join(
        [f"loc()==mode{mode or 0}", *(f"{name}=={value!r}" for name, value in start.items())]
    )
    told = {
        "system": identifiers([component], CLOCKS)[0],
        "initially": initially,
        "scenario": "simulation",
        "sampling-time": f"{np.median(np.diff(times)):.12g}",
        "time-horizon": repr(float(times[-1] - times[0])),
        "iter-max": "1000",
        "output-variables": ", ".join(start),
        "output-format": "GEN",
        "rel-err": "1.0e-9",
        "abs-err": "1.0e-12",
    }
    return "\n".join([*comments, *(f'{key} = "{value}"' for key, value in told.items()), ""])
