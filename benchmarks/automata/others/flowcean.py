"""Hybrid systems in the gallery of Flowcean, and recordings that SciPy makes of them.

The gallery (Apache 2.0, `examples/hybrid_systems/benchmarks` of flowcean/flowcean) is Python: a
``registry()`` of specs with a factory, a span of times and perhaps an input. It is imported, so
give only a folder that you trust, with Flowcean installed beside this package. Its systems have
event surfaces: a transition is taken where one passes zero in its direction, not wherever it is
beyond. Starts are drawn around the one of the gallery, none of them beyond a surface.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Protocol

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.automata.others.dainarx import Recorded
from benchmarks.automata.plant import Array

__all__ = ["GallerySystem", "gallery"]

N_UNSEEN, _N_STARTS, _DT = 6, 15, 0.01
_MOST_SWITCHES = 256  # as in Flowcean itself
_AROUND = 0.3  # of the largest value of a state in the gallery's own trace; of one that is 0, one
_TOLERANCES = {"rtol": 1e-10, "atol": 1e-12}

Input = Callable[[float], Array]


def _setpoint(told: dict[str, float]) -> Input:
    """The setpoint of a controller and its rate: what an engineer logs, and laws depend on."""
    size, pace = told["setpoint_amp"], told["setpoint_freq"]
    return lambda t: np.array([size * np.sin(pace * t), size * pace * np.cos(pace * t)])


# What is known of a system beside its recordings: inputs, and functions that its laws need.
_LOGGED = {"Flowcean/PID-Controlled Plant": _setpoint}
_FEATURES = {"Flowcean/Tank Valves": "sqrt(x0 - x1)"}


class System(Protocol):
    """What is asked of a ``HybridSystem``."""

    locations: tuple
    initial_location: object
    initial_state: Array
    parameters: dict
    transitions_from: Callable[[object], list]


@dataclass(frozen=True)
class GallerySystem:
    """A system of the gallery, as `scoring.score` takes it.

    Attributes
    ----------
    name : str
    system : HybridSystem
    span : tuple of float
        Times of a recording.
    given : callable or None
        Its input as the gallery says it.
    """

    name: str
    system: System
    span: tuple[float, float]
    given: Input | None

    order, kernel, is_flow = 1, "linear", True

    @property
    def features(self) -> str:
        """Terms of the laws beside states and inputs."""
        return _FEATURES.get(self.name, "")

    @property
    def numbers(self) -> dict[int, int]:
        """Those of the locations: each has laws of its own."""
        return {number: number for number in range(len(self.system.locations))}

    def training(self) -> list[Recorded]:
        """Recordings for a fit."""
        return self._recorded[N_UNSEEN:]

    def unseen(self) -> list[Recorded]:
        """Recordings for the figures."""
        return self._recorded[:N_UNSEEN]

    @cached_property
    def _recorded(self) -> list[Recorded]:
        begin, rng = np.asarray(self.system.initial_state, dtype=float), np.random.default_rng(0)
        own = self.recorded(begin)
        sizes = np.abs(own.x).max(axis=0)
        sizes = _AROUND * np.where(sizes > 0.0, sizes, 1.0)
        drawn: list[Recorded] = []
        while len(drawn) < _N_STARTS - 1:
            start = begin + sizes * rng.uniform(-1.0, 1.0, len(begin))
            if not self._is_beyond(start):
                drawn.append(self.recorded(start))
        return [*drawn, own]

    def recorded(self, start: Array) -> Recorded:
        """What the system does from a start."""
        time, last = self.span
        t = time + _DT * np.arange(round((last - time) / _DT) + 1)
        location, state = self.system.initial_location, start
        numbers = {id(one): number for number, one in enumerate(self.system.locations)}
        x, modes = np.empty((len(t), len(start))), np.empty(len(t), dtype=np.intp)
        for _ in range(_MOST_SWITCHES):
            ways, told = self.system.transitions_from(location), self._told(location)
            flow = location.dynamics.flow
            done = solve_ivp(
                lambda at, now, flow=flow, told=told: flow(at, now, told, self.given),
                (time, last), state, events=[_event(one, told, self.given) for one in ways],
                dense_output=True, **_TOLERANCES,
            )  # fmt: skip
            here = (t >= time) & (t <= done.t[-1] + np.spacing(last))
            x[here], modes[here] = done.sol(t[here]).T, numbers[id(location)]
            if done.status == 0:
                break
            taken = next(one for one, times in zip(ways, done.t_events, strict=True) if len(times))
            time, state = done.t[-1], done.y[:, -1]
            if taken.reset is not None:
                state = np.asarray(taken.reset.fn(time, state, told, self.given), dtype=float)
            location = taken.target
        else:
            raise ValueError(f"{self.name} switches more than {_MOST_SWITCHES} times.")
        return Recorded(t, x, self._logged(t), modes)

    def _told(self, location) -> dict:
        return {**self.system.parameters, **location.parameters}

    def _logged(self, t: Array) -> Array:
        """Inputs at some times, (n_times, n_inputs)."""
        own = _LOGGED.get(self.name)
        signal = self.given if own is None else own(self.system.parameters)
        return np.empty((len(t), 0)) if signal is None else np.vstack([signal(at) for at in t])

    def _is_beyond(self, start: Array) -> bool:
        """Whether a surface out of the first location has been passed in its direction there."""
        first = self.system.initial_location
        events = [
            _event(one, self._told(first), self.given)
            for one in self.system.transitions_from(first)
        ]
        return any(one.direction * one(self.span[0], start) > 0.0 for one in events)


def _event(way, told: dict, given: Input | None) -> Callable[[float, Array], float]:
    """The event surface of a transition as SciPy takes it."""

    def event(time: float, state: Array) -> float:
        return float(way.event.fn(time, state, told, given))

    event.terminal, event.direction = True, int(way.event.direction)
    return event


def gallery(folder: str | Path) -> list[GallerySystem]:
    """The systems of a gallery: a package, ``folder``, with a ``registry()``.

    Raises
    ------
    ValueError
        If the folder is no such package.
    """
    file = Path(folder) / "__init__.py"
    spec = spec_from_file_location("flowcean_gallery", file)
    if not file.is_file() or spec is None or spec.loader is None:
        raise ValueError(f"{folder} is no package; give hybrid_systems/benchmarks of Flowcean.")
    module = module_from_spec(spec)
    sys.modules[spec.name] = module  # for its imports of its own modules
    spec.loader.exec_module(module)
    if not hasattr(module, "registry"):
        raise ValueError(f"{folder} has no registry(); give hybrid_systems/benchmarks of Flowcean.")
    return [
        GallerySystem(f"Flowcean/{name}", one.factory(), one.t_span, one.input_stream)
        for name, one in module.registry().items()
    ]
