"""What a plant of `make_undeclared` is, and what is said about an effect planted in it.

The places at which an effect can enter a plant are one small record each. A `Mechanism` answers a
few questions with "nothing changes"; each subclass answers one of them otherwise. The simulation
asks every mechanism every question, so effects combine freely.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from swsysid._data.features import FunctionLibrary
from swsysid._results import Array

Modes = NDArray[np.intp]


@dataclass(frozen=True)
class PlantedEffect:
    """One effect that the plant has and the declared model lacks, with its true values.

    Attributes
    ----------
    kind : str
    target : int
        State equation it acts in; for `sensor_offset` and `clock_lag` the state that is
        recorded wrongly, for `reset` the state that jumps, for `guard_hysteresis` the equation
        in which the modes differ most.
    mode : int or None
        Mode in which it acts; None is all of them.
    channel : int or None
        Column of X that it is a function of, or of `signals` for `input_coupling`.
    parameters : dict
        True values by their physical names.
    """

    kind: str
    target: int
    mode: int | None
    channel: int | None
    parameters: Mapping[str, object]


@dataclass(frozen=True)
class Equation:
    """Columns of X that an effect in one state equation is a function of."""

    position: int
    rate: int


@dataclass(frozen=True)
class Drive:
    """Input: a multisine and random steps around a centre, within limits."""

    size: float
    limits: tuple[float, float]
    centre: float = 0.0
    periods: tuple[float, float] = (30, 200)  # of the multisine, in samples
    hold: float = 40  # mean length of a step, in samples


@dataclass(frozen=True)
class Region:
    """Where an extra mode rules: the outermost part of `score` inside the mode `base`.

    Its law is that of `base` with a smaller coefficient of `feature` in `target`.
    """

    score: Callable[[Array], Array]
    target: int
    feature: int
    base: int = 0
    share: float = 0.2  # of all samples


@dataclass(frozen=True, eq=False)
class Plant:
    """A switching system with one input: the declared law, and what an effect has to know.

    A plant is equal to itself only, so that its reference run can be kept. The declared law is
    ``coef[mode] @ features(x, u)``, in mode 1 where `guard` is positive.
    """

    name: str
    description: str
    states: tuple[str, ...]
    coef: Array  # (n_modes, n_states, n_features)
    start: tuple[float, ...]  # initial states are uniform in [-start, start] around `rest`
    drive: Drive
    time_step: float
    region: Region
    kinds: tuple[str, ...]
    guard: Callable[[Array], Array] | None = None
    functions: Mapping[str, Callable] | None = None  # name to function of all columns, or those
    rest: tuple[float, ...] | float = 0.0
    discrete: bool = False
    equations: Mapping[int, Equation] = field(default_factory=lambda: {1: Equation(0, 1)})
    target: int = 1
    # targets of some kinds that are not `target`
    natural: Mapping[str, int] = field(default_factory=lambda: {"sensor_offset": 0})
    # of position and rate, one is drawn for `polynomial`
    powers: tuple[tuple[int, int], ...] = ((3, 0), (2, 1))
    sign: float = 0.0  # of level-like effects; 0: either
    jump: float = 1.0  # direction of the crossing at which `reset` acts

    @property
    def n_states(self) -> int:
        return len(self.states)

    @property
    def n_modes(self) -> int:
        """Number of declared modes."""
        return len(self.coef)

    @property
    def substeps(self) -> int:
        """Steps of the integration between two samples."""
        return 1 if self.discrete else 4

    @property
    def columns(self) -> list[str]:
        """Names of the columns of X."""
        return [*self.states, "u"]

    @property
    def library(self) -> FunctionLibrary | None:
        """The declared feature library, as the estimator takes it."""
        if self.functions is None:
            return None
        return FunctionLibrary(list(self.functions.values()), list(self.functions))

    @property
    def driven(self) -> tuple[int, ...]:
        """Equations in which the input acts, by its feature, the last one."""
        return tuple(np.flatnonzero(np.abs(self.coef[:, :, -1]).max(axis=0)))

    def target_of(self, kind: str) -> int:
        """The equation, or the state, in which a kind of effect is most natural."""
        return self.natural.get(kind, self.target)

    def features(self, x: Array, u: Array) -> list[Array]:
        """Columns of the declared features at states (..., n_states) and inputs (...)."""
        columns = [*np.moveaxis(x, -1, 0), u]
        if self.functions is None:
            return columns
        return [function(*columns) for function in self.functions.values()]

    def modes(self, x: Array, before: Modes | None = None, half_width: float = 0.0) -> Modes:
        """Mode at every state; with memory if the guard has a width and `before` is given."""
        if self.guard is None:
            return np.zeros(x.shape[:-1], dtype=np.intp)
        # a mode 1 that was is kept down to -half_width, a mode 0 up to +half_width
        level = 0.0 if before is None else np.where(before == 1, -half_width, half_width)
        return (self.guard(x) > level).astype(np.intp)

    def velocities(self, x: Array, u: Array, modes: Modes) -> Array:
        """Declared velocities, shape (..., n_states)."""
        features = np.stack(self.features(x, u), axis=-1)
        return np.einsum("...sf,...f->...s", self.coef[modes], features)


@dataclass(frozen=True, kw_only=True)
class Mechanism:
    """No effect, but for the width of the guard's hysteresis."""

    mode: int | None = None  # in which it acts; None is all
    half_width: float = 0.0  # of the guard's hysteresis
    functions: tuple[Callable[..., Array], ...] = ()  # further features f(x, u, t, signals)

    def extend(self, coef: Array, first: int) -> Array:
        """Coefficients with those of the own features, from `first` on, and of own modes."""
        return coef

    def actuate(self, u: Array, step: float) -> Array:
        """What the plant receives of an input history, shape (n_times, n_trajectories)."""
        return u

    def overrule(self, modes: Modes, x: Array, extra: int) -> Modes:
        """Modes after the mechanism had its say; `extra` is the label of a mode of its own."""
        return modes

    def land(self, x: Array, before: Modes, after: Modes) -> Array:
        """State after a change of modes."""
        return x

    def record(self, x: Array, step: float) -> Array:
        """What the sensors say of a history, shape (n_times, n_trajectories, n_states)."""
        return x


@dataclass(frozen=True, kw_only=True)
class Terms(Mechanism):
    """Further terms in one equation: coefficients times the functions."""

    target: int
    coefficients: tuple[float, ...]

    def extend(self, coef, first):
        rows = slice(None) if self.mode is None else self.mode
        coef[rows, self.target, first : first + len(self.functions)] = self.coefficients
        return coef


@dataclass(frozen=True, kw_only=True)
class Actuator(Mechanism):
    """The plant receives an operator ``operator(u, step)`` of the input's history."""

    operator: Callable[[Array, float], Array]

    def actuate(self, u, step):
        return self.operator(u, step)


@dataclass(frozen=True, kw_only=True)
class ExtraMode(Mechanism):
    """One more region, with the law of one mode but for one coefficient; the last of the modes."""

    region: Region
    threshold: float
    change: float

    def extend(self, coef, first):
        law = coef[self.region.base].copy()
        law[self.region.target, self.region.feature] += self.change
        return np.concatenate([coef, law[np.newaxis]])

    def overrule(self, modes, x, extra):
        inside = (modes == self.region.base) & (self.region.score(x) > self.threshold)
        return np.where(inside, extra, modes)


@dataclass(frozen=True, kw_only=True)
class Reset(Mechanism):
    """A state is multiplied by a factor as the guard is crossed in one direction."""

    state: int
    factor: float
    direction: float

    def land(self, x, before, after):
        crossed = (after - before) * self.direction > 0
        x = x.copy()
        x[..., self.state] *= np.where(crossed, self.factor, 1.0)
        return x


@dataclass(frozen=True, kw_only=True)
class Sensor(Mechanism):
    """A state is recorded with an offset, or late."""

    state: int
    offset: float = 0.0
    delay: float = 0.0

    def record(self, x, step):
        x = x.copy()
        x[..., self.state] = late(x[..., self.state], self.delay, step) + self.offset
        return x


@dataclass(frozen=True, kw_only=True)
class Quantiser(Mechanism):
    """A state is recorded in steps."""

    state: int
    step: float

    def record(self, x, step):
        x = x.copy()
        x[..., self.state] = self.step * np.round(x[..., self.state] / self.step)
        return x


def late(values: Array, delay: float, step: float) -> Array:
    """A history (n_times, ...) as it was `delay` ago: linear between rows, constant before."""
    places = np.maximum(np.arange(len(values)) - delay / step, 0.0)
    whole = np.floor(places).astype(np.intp)
    part = (places - whole).reshape(-1, *[1] * (values.ndim - 1))
    after = np.minimum(whole + 1, len(values) - 1)
    return (1 - part) * values[whole] + part * values[after]
