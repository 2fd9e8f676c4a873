"""What a simulation is asked for, checked, and inputs as functions of time, piece by piece."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields
from functools import partial
from typing import Any

import numpy as np
from scipy.integrate import DOP853, RK45, Radau

from swsysid._checks.arrays import column, state, table
from swsysid._checks.parameters import one_of, real, whole
from swsysid._results import Array
from swsysid._simulation.system import SwitchingSystem

__all__ = [
    "METHODS",
    "Options",
    "Signal",
    "Stretch",
    "check_sizes",
    "checked_inputs",
    "checked_options",
    "checked_times",
    "probe",
    "stretches",
]

Signal = Callable[[float], Array]
Stretch = tuple[float, Signal]

METHODS = {"DOP853": DOP853, "RK45": RK45, "Radau": Radau}
_CHECKS: dict[str, Callable[[str, Any], Any]] = {
    "max_switches": partial(whole, least=0),
    "max_steps": whole,
    "state_bound": partial(real, above=0),
    "rtol": partial(real, least=0, below=1),
    "atol": partial(real, least=0),
    "method": partial(one_of, choices=("auto", *METHODS)),
}


@dataclass(frozen=True)
class Options:
    """Limits and tolerances of a simulation, as `simulate` describes them."""

    max_switches: int = 10000
    max_steps: int = 200000
    state_bound: float = 1e9
    rtol: float = 1e-8
    atol: float = 1e-10
    method: str = "auto"


def checked_options(options: Mapping[str, Any]) -> Options:
    """Options of a simulation; one that there is not is refused."""
    names = [field.name for field in fields(Options)]
    for name in options:
        if name not in names:
            raise TypeError(f"simulate has no option {name!r}; choose among {', '.join(names)}.")
    return Options(**{name: _CHECKS[name](name, value) for name, value in options.items()})


def checked_times(x0, t) -> tuple[Array, Array]:
    """First state and requested times."""
    x0, t = state("x0", x0).copy(), column("t", t).copy()
    if (np.diff(t) <= 0).any():
        raise ValueError("t must be a 1-d array of finite, strictly increasing times.")
    return x0, t


def checked_inputs(inputs, t: Array, name: str = "inputs") -> Array:
    """Samples of the inputs at the first of the times, shape (n_samples, n_inputs)."""
    inputs = table(name, inputs, empty=True).copy()
    if not 0 < len(inputs) <= len(t):
        raise ValueError(
            f"{name} has shape {inputs.shape} for {len(t)} times; give one row for each time."
        )
    return inputs


def check_sizes(system: SwitchingSystem, n_states: int, n_inputs: int) -> None:
    """Refuse other numbers of states and inputs than the system has, if it tells."""
    wanted = (
        n_states if system.n_states is None else system.n_states,
        n_inputs if system.n_inputs is None else system.n_inputs,
    )
    if (n_states, n_inputs) != wanted:
        raise ValueError(
            f"x0 holds {n_states} states and inputs hold {n_inputs} columns; give {wanted[0]} and "
            f"{wanted[1]}."
        )


def probe(system: SwitchingSystem, x0: Array, u: Array) -> None:
    """Let errors of the system itself, such as a wrong number of inputs, speak at the start."""
    velocity = np.asarray(system.velocity(x0, u, int(system.mode(x0, u))))
    if velocity.shape != x0.shape:
        raise ValueError(
            f"the system's velocity has shape {velocity.shape} for a state of shape {x0.shape}; "
            "x0 must hold one value for each state."
        )


def stretches(t: Array, inputs: Array | None, hold: str) -> Iterator[Stretch]:
    """End and input signal of each stretch of time over which the inputs are smooth.

    The last stretch has length zero: it tells the inputs at the last time.
    """
    if inputs is None:
        yield t[-1], partial(_line, 0.0, np.empty(0), np.empty(0))
        return
    for row, (start, u) in enumerate(zip(t, inputs, strict=False)):
        end = t[min(row + 1, len(inputs) - 1)]
        slope = 0.0 * u
        if hold == "linear" and end > start:
            slope = (inputs[row + 1] - u) / (end - start)
        yield end, partial(_line, start, u, slope)


def _line(start, value, slope, time):
    return value + slope * (time - start)
