"""Hybrid automata in the JSON files of DAINARX, and recordings made as its own generator does.

The format is told in the README of the tool (Yu et al., HSCC 2026, arXiv 2507.16426). A law gives
the highest derivative of each variable (``x1[2] = ...``), a step is one of Runge and Kutta's
fourth order, and the edges of a mode are tested at samples, in their order: a sample is what stood
before the edge was taken. Files come with 15 starts; the first six make the unseen recordings, the
other nine those of the training, as in its papers.
"""

from __future__ import annotations

import ast
import json
import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from benchmarks.automata.plant import Array

__all__ = ["N_UNSEEN", "Published", "Recorded", "published"]

N_UNSEEN = 6
_DEFAULTS = {"dt": 0.01, "total_time": 10.0, "order": 3, "other_items": "", "kernel": "linear"}
_FUNCTIONS = {name: getattr(math, name) for name in ("sin", "cos", "tan", "exp", "log", "sqrt")}
_FUNCTIONS |= {"abs": abs, "pi": math.pi}
_ALLOWED = (
    ast.Expression, ast.BinOp, ast.UnaryOp, ast.BoolOp, ast.Compare, ast.Call, ast.Name, ast.Load,
    ast.Constant, ast.Subscript, ast.operator, ast.unaryop, ast.boolop, ast.cmpop,
)  # fmt: skip


@dataclass(frozen=True)
class Recorded:
    """One recording: samples, inputs, and the mode whose law makes the next sample."""

    t: Array
    x: Array
    u: Array
    modes: NDArray[np.intp]


@dataclass(frozen=True)
class Edge:
    """A way out of a mode: where it is taken, and what derivatives become then, in order."""

    target: int
    condition: Callable[[dict], object]
    resets: list[tuple[int, int, Callable[[dict], float]]]


@dataclass(frozen=True)
class Published:
    """An automaton that others described, and what their tool is told of it.

    Attributes
    ----------
    name : str
        Folder and file.
    states, inputs : list of str
    orders : list of int
        Of derivatives of each state, the largest over the modes.
    dt : float
    n_steps : int
    order : int
        Samples that the difference equations of DAINARX see.
    features : str
        Its ``other_items``: further terms of the difference equations.
    kernel : str
        Of its guards: "linear" or "rbf".
    laws : dict of int to list of (int, callable)
        Order and highest derivative of each state.
    edges : dict of int to list of Edge
    numbers : dict of int to int
        Of the modes; those of the same laws have the same.
    starts : list of dict
    """

    name: str
    states: list[str]
    inputs: list[str]
    dt: float
    n_steps: int
    order: int
    features: str
    kernel: str
    laws: dict[int, list[tuple[int, Callable[[dict], float]]]]
    edges: dict[int, list[Edge]]
    numbers: dict[int, int]
    starts: list[dict] = field(repr=False)
    is_flow: ClassVar[bool] = False  # difference equations, unless they have further terms

    def training(self) -> list[Recorded]:
        """Recordings for a fit."""
        return [self.recorded(start) for start in self.starts[N_UNSEEN:]]

    def unseen(self) -> list[Recorded]:
        """Recordings for the figures."""
        return [self.recorded(start) for start in self.starts[:N_UNSEEN]]

    def recorded(self, start: dict) -> Recorded:
        """What the automaton does from a start."""
        mode, time = start["mode"], 0.0
        size = max(order for laws in self.laws.values() for order, _ in laws)
        state = np.zeros((len(self.states), size))
        for row, name in zip(state, self.states, strict=True):
            given = start.get(name, [])[: len(row)]
            row[: len(given)] = given
        state = self._held(state, mode)
        given = [_made(str(start.get(name, 0))) for name in self.inputs]
        rows, modes, inputs = [], [], []
        for _ in range(self.n_steps):
            state = self._stepped(state, mode, time, given)
            time += self.dt
            rows.append(state[:, 0].copy())
            mode, state = self._switched(state, mode)
            modes.append(mode)
            inputs.append([one({"t": time}) for one in given])
        t = self.dt * np.arange(1, self.n_steps + 1)
        return Recorded(t, np.array(rows), np.reshape(inputs, (len(t), -1)), np.array(modes))

    def _held(self, state: Array, mode: int) -> Array:
        """Derivatives that a law has, the others zero."""
        held = np.zeros_like(state)
        for k, (order, _) in enumerate(self.laws[mode]):
            held[k, :order] = state[k, :order]
        return held

    def _stepped(self, state: Array, mode: int, time: float, given: list) -> Array:
        def rates(state: Array, time: float) -> Array:
            seen = dict(zip(self.states, state, strict=True))
            seen |= {name: one({"t": time}) for name, one in zip(self.inputs, given, strict=True)}
            moved = np.roll(state, -1, axis=1)
            for row, (order, law) in zip(moved, self.laws[mode], strict=True):
                row[order - 1] = law(seen)
            return moved

        dt = self.dt
        k1 = rates(state, time)
        k2 = rates(state + 0.5 * dt * k1, time + 0.5 * dt)
        k3 = rates(state + 0.5 * dt * k2, time + 0.5 * dt)
        k4 = rates(state + dt * k3, time + dt)
        return state + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)

    def _switched(self, state: Array, mode: int) -> tuple[int, Array]:
        """The mode after the edges that hold, one after the other, and the state there.

        Only the last edge resets; of a circle only the first is taken.
        """
        seen = dict(zip(self.states, state[:, 0], strict=True))
        taken: list[Edge] = []
        while edge := next((e for e in self.edges.get(mode, []) if e.condition(seen)), None):
            circle = any(edge.target == one.target for one in taken)
            taken.append(edge)
            mode = edge.target
            if circle:
                break
        else:
            circle = False
        if not taken:
            return mode, state
        last = taken[0] if circle else taken[-1]
        state = self._held(state, last.target)
        for row, place, value in last.resets:
            made = value(dict(zip(self.states, state, strict=True)))
            state[row, place] = np.ravel(made)[0]  # a name alone is the value itself
        return last.target, state


def published(folder: str | Path) -> list[Published]:
    """All descriptions with starts beneath a folder, by name."""
    found = []
    for file in sorted(Path(folder).rglob("*.json")):
        told = json.loads(file.read_text(encoding="utf-8"))
        if "automaton" in told and told.get("init_state"):
            found.append(_described(f"{file.parent.name}/{file.stem}", told))
    return found


def _described(name: str, told: dict) -> Published:
    config, automaton = _DEFAULTS | told.get("config", {}), told["automaton"]
    states, inputs = (_names(automaton.get(one, "")) for one in ("var", "input"))
    now, n_steps = 0.0, 0
    while now < config["total_time"]:  # as its generator counts, sum by sum
        now, n_steps = now + config["dt"], n_steps + 1
    laws = {mode["id"]: _laws(mode["eq"], states) for mode in automaton["mode"]}
    edges: dict[int, list[Edge]] = {}
    for edge in automaton["edge"]:
        source, target = map(int, re.findall(r"\d+", edge["direction"]))
        resets = [
            (states.index(one), place, _made(str(value)))
            for one, values in edge.get("reset", {}).items()
            for place, value in enumerate(values)
            if value != ""
        ]
        resets.sort(key=lambda one: one[:2])
        edges.setdefault(source, []).append(Edge(target, _made(edge["condition"]), resets))
    return Published(
        name, states, inputs, config["dt"], n_steps, config["order"], config["other_items"],
        config["kernel"], laws, edges, _numbers(automaton["mode"]), told["init_state"],
    )  # fmt: skip


def _numbers(modes: list[dict]) -> dict[int, int]:
    """Of the modes by their laws, however these are spaced."""
    told = {mode["id"]: "".join(mode["eq"].split()) for mode in modes}
    places = {law: place for place, law in enumerate(dict.fromkeys(told.values()))}
    return {mode: places[law] for mode, law in told.items()}


def _names(told: str | None) -> list[str]:
    return re.findall(r"\w+", told or "")


def _laws(told: str, states: list[str]) -> list[tuple[int, Callable[[dict], float]]]:
    laws = {}
    for equation in told.split(","):
        left, right = equation.split("=")
        name, order = re.findall(r"\w+", left)
        laws[name] = int(order), _made(right)
    return [laws[name] for name in states]


def _made(formula: str) -> Callable[[dict], float]:
    """A function of named values; nothing but arithmetic, comparisons and known functions runs."""
    tree = ast.parse(formula.strip(), mode="eval")
    for node in ast.walk(tree):
        unknown = isinstance(node, ast.Call) and not (
            isinstance(node.func, ast.Name) and node.func.id in _FUNCTIONS
        )
        if unknown or not isinstance(node, _ALLOWED):
            raise ValueError(f"{formula!r} is more than arithmetic: {ast.unparse(node)!r}.")
    code = compile(tree, formula, "eval")
    return lambda seen: eval(code, {"__builtins__": {}, **_FUNCTIONS}, seen)
