"""What a simulation is asked for, checked, and inputs as functions of time, piece by piece.

What a rollout with effects knows beforehand are the *given channels*, as functions of time: inputs,
the time itself, logged signals, and the columns of effects that remember an input. Between
neighbouring times of the grid each is a quadratic.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.integrate import DOP853, RK45, Radau

from swsysid._checks.arrays import column, state, table
from swsysid._checks.parameters import one_of, real, whole
from swsysid._data.coordinates import Extent
from swsysid._data.recordings import a_row_sooner
from swsysid._data.records import Records
from swsysid._results import Array
from swsysid._simulation.bands import check_no_band
from swsysid._simulation.system import Scales, SwitchingSystem
from swsysid.effects import PlacedEffect

# Given channels jump at the ends of an interval: columns are asked a millionth of it further in.
_INSIDE = 1e-6
_SAME_TIME = 1e-9  # share of a step within which two times are the same to roundoff

Signal = Callable[[float], Array]
Stretch = tuple[float, Signal]
METHODS = {"DOP853": DOP853, "RK45": RK45, "Radau": Radau}
# the dense output of a step is a polynomial in time of this degree
DENSE_DEGREES = {"DOP853": 7, "RK45": 4, "Radau": 3}


@dataclass(frozen=True)
class Options:
    """Limits and tolerances of a simulation, the options of `simulate`."""

    # The trajectory ends with SWITCH_LIMIT after so many events, or when 64 of them follow each
    # other within 1e-9 of the requested time (not in discrete time),
    max_switches: int = 10000
    # with STEP_FAILURE after so many integration steps,
    max_steps: int = 200000
    # and with STATE_LIMIT before a state exceeds this in magnitude. None is 1e9 of the size of each
    # state: its spread in the data of the fit, or its value at the start of a stated model.
    state_bound: float | None = None
    rtol: float = 1e-8
    # None is 1e-10 of the size of each state.
    atol: float | None = None
    # "Radau" is for stiff systems; "auto" is "RK45" with inputs, whose samples cut the time into
    # short steps, and "DOP853" without.
    method: str = "auto"

    def scales(self, extent: Extent | None, x0: Array) -> Scales:
        """In what states count that start at `x0`, of a model fitted to data of some extent."""
        return Scales.of(extent, x0, self.atol, self.state_bound)


def checked_options(options: Mapping[str, object]) -> Options:
    """Options of a simulation; one that there is not is refused."""
    check_no_band(options)
    usual = vars(Options())
    for name in options:
        if name not in usual:
            known = ", ".join(usual)
            raise TypeError(f"simulate has no option {name!r}; choose among {known}.")
    asked = {**usual, **options}
    return Options(
        max_switches=whole("max_switches", asked["max_switches"], least=0),
        max_steps=whole("max_steps", asked["max_steps"]),
        state_bound=real("state_bound", asked["state_bound"], above=0, also=(None,)),
        rtol=real("rtol", asked["rtol"], least=0, below=1),
        atol=real("atol", asked["atol"], least=0, also=(None,)),
        method=one_of("method", asked["method"], ("auto", *METHODS)),
    )


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


def checked_request(
    x0, t, inputs, input_hold: str, widths: tuple[int | None, int | None]
) -> tuple[Array, Array, Array | None]:
    """First state, requested times and samples of the inputs, None where there are none.

    `widths` are the numbers of states and of inputs that are wanted, None for any.
    """
    start, times = checked_times(x0, t)
    one_of("input_hold", input_hold, ("zero", "linear", "next"))
    samples = None if inputs is None else checked_inputs(inputs, times)
    given = len(start), 0 if samples is None else samples.shape[1]
    wanted = tuple(has if asks is None else asks for asks, has in zip(widths, given, strict=True))
    if given != wanted:
        raise ValueError(
            f"x0 holds {given[0]} states and inputs hold {given[1]} columns; give {wanted[0]} and "
            f"{wanted[1]}."
        )
    return start, times, samples


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
        yield t[-1], partial(parabola, 0.0, np.empty(0), np.empty(0), 0.0)
        return
    if hold == "next":
        inputs = a_row_sooner(inputs, np.ones(inputs.shape[1], dtype=bool))
    for row, (start, u) in enumerate(zip(t, inputs, strict=False)):
        end = t[min(row + 1, len(inputs) - 1)]
        slope = 0.0 * u
        if hold == "linear" and end > start:
            slope = (inputs[row + 1] - u) / (end - start)
        yield end, partial(parabola, start, u, slope, 0.0)


def parabola(begin: float, value: Array, slope: Array, bend: Array | float, time: float) -> Array:
    """Value at a time of what has a value, a slope and half a curvature at the begin."""
    since = time - begin
    return value + since * (slope + since * bend)


def trajectory_records(X: Array, n_states: int, t: Array, signals: Array) -> Records:
    """Records of one trajectory."""
    n_channels = X.shape[1] + signals.shape[1]
    names = tuple(f"channel{number}" for number in range(n_channels))
    return Records(X, n_states, t, np.zeros(len(t), np.intp), signals, names, True)


def refined_grid(t: Array, instants: Array) -> Array:
    """The requested times and the instants between them that are not the same to roundoff."""
    if len(t) < 2:
        return t
    near = _SAME_TIME * np.diff(t).min()
    inside = np.unique(instants[(instants > t[0]) & (instants < t[-1])])
    after = np.searchsorted(t, inside)
    distinct = np.minimum(inside - t[after - 1], t[after] - inside) > near
    inside = inside[distinct]
    inside = inside[np.diff(inside, prepend=-np.inf) > near]
    return np.union1d(t, inside)


@dataclass(frozen=True)
class Given:
    """Inputs and signals at the samples, and the effects that remember them."""

    n_states: int
    t: Array  # times of the samples, (n_known,)
    inputs: Array  # (n_known, n_inputs)
    signals: Array  # (n_known, n_signals)
    linear: bool  # linear between the samples, else constant until the next one
    terms: Sequence[PlacedEffect]  # effects that remember an input or a signal

    def at(self, times: Array) -> tuple[Array, Array]:
        """Inputs and signals at some times."""
        if self.linear:
            both = np.empty((2, len(times), 0)), (self.inputs, self.signals)
            inputs, signals = (
                np.column_stack([none, *(np.interp(times, self.t, column) for column in values.T)])
                for none, values in zip(*both, strict=True)
            )
            return inputs, signals
        rows = np.clip(np.searchsorted(self.t, times, side="right") - 1, 0, None)
        return self.inputs[rows], self.signals[rows]

    def columns(self, times: Array) -> Array:
        """Columns of the effects that remember, shape (n_times, n_columns)."""
        inputs, signals = self.at(times)
        X = np.column_stack([np.zeros((len(times), self.n_states)), inputs])
        records = trajectory_records(X, self.n_states, times, signals)
        parts = [term.columns(records) for term in self.terms]
        return np.column_stack([np.empty((len(times), 0)), *parts])

    def sampled(self, times: Array) -> Array:
        """All given channels at the times of samples, (n_times, n_channels)."""
        inputs, signals = self.at(times)
        return np.column_stack([inputs, times, signals, self.columns(times)])

    def stretches(self, grid: Array) -> list[Stretch]:
        """End and signal of each interval of the grid, and of the last time by itself."""
        grid = grid[grid <= self.t[-1]]
        inputs, signals = self.at(grid)
        held = np.column_stack([inputs, grid, signals])
        slope = np.diff(held, axis=0) / np.diff(grid)[:, None]
        going_on = np.zeros(held.shape[1])
        going_on[inputs.shape[1]] = 1.0  # time
        if not self.linear:
            slope = np.tile(going_on, (len(slope), 1))
        # coefficients of the parabola through three values of a column in each interval:
        # values = V (c0, c1 h, c2 h^2) with the Vandermonde matrix V of the places
        h = np.diff(grid)[:, None]
        places = np.array([_INSIDE, 0.5, 1.0 - _INSIDE])
        times = (grid[:-1, None] + h * places).ravel()
        values = self.columns(np.concatenate([grid[:1], times, grid[-1:]]))
        inside = values[1:-1].reshape(len(h), 3, values.shape[1])
        solved = np.linalg.inv(np.vander(places, increasing=True)) @ inside
        tabulated = solved[:, 0], solved[:, 1] / h, solved[:, 2] / h**2
        quadratics = [
            np.column_stack([held[:-1], tabulated[0]]),
            np.column_stack([slope, tabulated[1]]),
            np.column_stack([np.zeros_like(slope), tabulated[2]]),
        ]
        listed: list[Stretch] = [
            (float(end), partial(parabola, begin, *coefficients))
            for begin, end, *coefficients in zip(grid[:-1], grid[1:], *quadratics, strict=True)
        ]
        ends = values[-1]
        last, rest = np.concatenate([held[-1], ends]), np.append(going_on, np.zeros(len(ends)))
        return [*listed, (float(grid[-1]), partial(parabola, grid[-1], last, rest, 0.0))]
