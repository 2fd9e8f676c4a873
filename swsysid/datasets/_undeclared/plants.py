"""The six plants of `make_undeclared`, and what may act in them that no library has a name for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import reduce
from operator import mul

import numpy as np

from swsysid._results import Array
from swsysid.datasets._undeclared.records import Drive, Equation, Plant, Region, Terms
from swsysid.datasets._undeclared.simulation import Sizing

# Samples after which the memory of an unlisted disturbance has fallen to a third.
_MEMORY = (15.0, 50.0)


@dataclass(frozen=True)
class Unlisted:
    """A function of channels, each from its usual value in units of its spread, and its sign."""

    of: tuple[str, ...]  # "position", "rate", "other" (a state beside the position), "input"
    law: Callable[..., Array]
    sign: float = 0.0  # 0: either, as the plant allows


@dataclass(frozen=True)
class UnlistedEffect:
    """What was planted of an unlisted shape or disturbance, and what it does on the rows.

    Attributes
    ----------
    kind : str
        Name of the shape, of `unlisted_kinds`.
    target : int
        State equation it acts in.
    mode : int or None
        Mode in which it acts; None is all of them.
    channels : tuple of int
        Columns of X that it is a function of; none of a disturbance.
    values : ndarray of shape (n_samples,)
        What it contributes to the velocity on every row.
    """

    kind: str
    target: int
    mode: int | None
    channels: tuple[int, ...]
    values: Array

    @property
    def is_disturbance(self) -> bool:
        """True if it is no function of what was recorded."""
        return not self.channels


def _sigmoid(z: Array) -> Array:
    return 0.5 * (1.0 + np.tanh(0.5 * z))


SHAPES: Mapping[str, Unlisted] = {
    "rational": Unlisted(("position",), lambda z: z**2 / (1.0 + z**2)),
    "steep_tanh": Unlisted(("rate",), lambda z: np.tanh(3.0 * z), -1.0),
    "exponential": Unlisted(("position",), lambda z: np.exp(1.5 * np.minimum(z, 2.5)), -1.0),
    "bump": Unlisted(("position",), lambda z: np.exp(-(((z - 0.5) / 0.4) ** 2))),
    "odd_step": Unlisted(("position",), lambda z: _sigmoid((z - 0.7) / 0.1)),
    "half_power": Unlisted(("rate",), lambda z: np.sign(z) * np.abs(z) ** 1.5, -1.0),
    "hump": Unlisted(("rate",), lambda z: 2.0 * z * np.exp(-np.abs(2.0 * z)), -1.0),
    "soft_input": Unlisted(("input",), lambda z: z / (1.0 + z**2)),
    "sine_of_product": Unlisted(("position", "other"), lambda z, w: np.sin(2.0 * z * w)),
    "soft_product": Unlisted(("position", "other"), lambda z, w: np.tanh(2 * z) * np.tanh(2 * w)),
    "gated_damping": Unlisted(("position", "other"), lambda z, w: w * _sigmoid(4.0 * z), -1.0),
}
DISTURBANCES = ("random_disturbance", "intermittent_disturbance")
UNLISTED = (*SHAPES, *DISTURBANCES)


def channels_of(plant: Plant, kind: str, target: int) -> tuple[int, ...]:
    """Columns of X that a kind is a function of; none of a disturbance."""
    if kind in DISTURBANCES:
        return ()
    equation = plant.equations[target]
    return tuple(_channel(plant, equation, name) for name in SHAPES[kind].of)


def strange(size: Sizing, kind: str) -> Terms:
    """The mechanism of a kind, of the right size."""
    if kind in DISTURBANCES:
        return size.terms([_course(size, kind)], [1.0])[0]
    shape = SHAPES[kind]
    channels = channels_of(size.plant, kind, size.target)
    history = np.concatenate([size.reference.x, size.reference.u[..., np.newaxis]], axis=-1)
    centres, spreads = (
        [float(of(history[..., channel])) for channel in channels] for of in (np.mean, np.std)
    )
    if not size.plant.sign:  # a force that is to be odd or even has to know where zero is
        centres = [0.0] * len(channels)

    def function(x: Array, u: Array, t: Array, signals: Array) -> Array:
        columns = [*np.moveaxis(x, -1, 0), u]
        scaled = [
            (columns[channel] - centre) / spread
            for channel, centre, spread in zip(channels, centres, spreads, strict=True)
        ]
        return shape.law(*scaled)

    return size.terms([function], [shape.sign or size.sign()])[0]


def _channel(plant: Plant, equation: Equation, name: str) -> int:
    if name == "input":
        return plant.n_states
    if name == "position":
        return equation.position
    if name == "rate" or equation.rate != equation.position:
        return equation.rate
    return 1 - equation.position  # a plant of the first order: the other level


def _course(size: Sizing, kind: str) -> Callable[..., Array]:
    """A function of time, drawn once for all the record."""
    rng, step = size.rng, size.plant.time_step
    grid = step * np.arange(-1, round(size.duration / step) + 2)
    memory = rng.uniform(*_MEMORY)
    if kind == "random_disturbance":
        kept = np.exp(-1.0 / memory)
        shocks = np.sqrt(1.0 - kept**2) * rng.standard_normal(len(grid))
        values = np.empty(len(grid))
        values[0] = rng.standard_normal()
        for row in range(1, len(grid)):
            values[row] = kept * values[row - 1] + shocks[row]
    else:
        changes = np.cumsum(rng.uniform(size=len(grid)) < 1.0 / memory)
        levels = rng.uniform(-1.0, 1.0, changes[-1] + 1) * (rng.uniform(size=changes[-1] + 1) < 0.4)
        values = levels[changes]
    return lambda x, u, t, signals: np.asarray(np.interp(t, grid, values))


_LEVELS = ("bias", "periodic_forcing", "drift", "input_coupling", "polynomial")
_ACTUATOR = ("dead_zone", "saturation", "backlash", "delay", "power_law", "lag")
_SENSOR = ("sensor_offset", "clock_lag")
_FRICTION = ("coulomb_friction", "stribeck_friction", "quadratic_drag", "asymmetric_friction")
_GUARD = ("guard_hysteresis", "reset")
# that a search looks for where they are asked for
_SPECIAL = ("load_friction", "input_gain", "soft_saturation", "hill", "ripple", "quantisation")
_SMOOTH = (*_LEVELS, *_ACTUATOR, *_SENSOR, "extra_mode")
_MECHANICAL = (*_SMOOTH, *_FRICTION, "trigonometric", *_SPECIAL)
# the cubic damping of the quartic oscillator imitates a quadratic one
_CUBIC = tuple(kind for kind in _MECHANICAL if kind != "quadratic_drag")
# of a pump that never runs backwards nor stops, a dead zone would be a bias
_ONE_SIDED = tuple(kind for kind in _SMOOTH if kind != "dead_zone")


# -- features of the laws: functions of both states and the input, which can be pickled ----------


@dataclass(frozen=True)
class _Product:
    """A monomial with the given powers of the three columns."""

    powers: tuple[int, int, int]

    def __call__(self, first: Array, second: Array, u: Array) -> Array:
        columns = zip((first, second, u), self.powers, strict=True)
        return reduce(mul, (column for column, power in columns for _ in range(power)))


_SECOND, _INPUT = _Product((0, 1, 0)), _Product((0, 0, 1))


def _sine(theta, omega, u):
    return np.sin(theta)


def _root_upper(x1, x2, u):
    return np.sqrt(np.maximum(x1, 0.0))


def _root_lower(x1, x2, u):
    return np.sqrt(np.maximum(x2, 0.0))


def _carriages(coupling: float, damper: float) -> list[list[float]]:
    """Law of two carriages; the columns are x1, x2, v1, v2, u."""
    return [
        [0.0, 0.0, 1.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 1.0, 0.0],
        [-3.0 - coupling, coupling, -0.4 - damper, damper, 1.0],
        [coupling, -3.0 - coupling, damper, -0.4 - damper, 0.0],
    ]


# -- the plants ----------------------------------------------------------------------------------

_ALL = [
    Plant(
        name="oscillator",
        description=(
            "A mass of 1 kg on a spring, x in m and v in m/s, pushed by a force u in N: "
            "v' = -k x - c v + u with k = 4 N/m and c = 0.5 N s/m where x <= 0.2 m (mode 0), and "
            "k = 7 N/m and c = 2 N s/m where x > 0.2 m (mode 1)."
        ),
        states=("x", "v"),
        coef=np.array([[[0.0, 1, 0], [-4, -0.5, 1]], [[0, 1, 0], [-7, -2, 1]]]),
        guard=lambda x: x[..., 0] - 0.2,
        start=(1.5, 2.0),
        drive=Drive(3.5, (-8.0, 8.0)),
        time_step=0.05,
        region=Region(lambda x: -x[..., 0], target=1, feature=0),
        kinds=(*_MECHANICAL, *_GUARD),
    ),
    Plant(
        name="quartic",
        description=(
            "A mass of 1 kg in a quartic potential with cubic damping, x in m and y = x' in m/s, "
            "pushed by a force u in N: y' = -x - 0.3 x^3 - 0.1 y^3 + h(x, y) + u, with "
            "h = 0.2 x^2 + 0.3 x y inside the circle x^2 + y^2 = 3 (mode 0) and "
            "h = -0.3 x^2 - 0.6 y outside (mode 1)."
        ),
        states=("x", "y"),
        functions={
            "{0}": _Product((1, 0, 0)),
            "{1}": _SECOND,
            "{0}^2": _Product((2, 0, 0)),
            "{0} {1}": _Product((1, 1, 0)),
            "{0}^3": _Product((3, 0, 0)),
            "{1}^3": _Product((0, 3, 0)),
            "{2}": _INPUT,
        },
        coef=np.array(
            [
                [[0.0, 1, 0, 0, 0, 0, 0], [-1, 0, 0.2, 0.3, -0.3, -0.1, 1]],
                [[0.0, 1, 0, 0, 0, 0, 0], [-1, -0.6, -0.3, 0, -0.3, -0.1, 1]],
            ]
        ),
        guard=lambda x: x[..., 0] ** 2 + x[..., 1] ** 2 - 3.0,
        start=(2.0, 2.0),
        drive=Drive(1.6, (-4.0, 4.0)),
        time_step=0.08,
        powers=((2, 1), (1, 2)),
        region=Region(lambda x: x[..., 0] ** 2 + x[..., 1] ** 2, target=1, feature=1, base=1),
        kinds=(*_CUBIC, *_GUARD),
        jump=-1.0,  # on the way in: a smaller speed leads further in
    ),
    Plant(
        name="two_mass",
        description=(
            "Two carriages of 1 kg, each on a spring of 3 N/m and a damper of 0.4 N s/m, coupled "
            "by 2 N/m and 0.1 N s/m; positions x1, x2 in m, velocities v1, v2 in m/s, a force u in "
            "N on the first (mode 0). Where x1 - x2 exceeds 0.1 m a preloaded buffer closes "
            "between them and the coupling is 8 N/m and 1 N s/m (mode 1)."
        ),
        states=("x1", "x2", "v1", "v2"),
        coef=np.array([_carriages(2.0, 0.1), _carriages(8.0, 1.0)]),
        guard=lambda x: x[..., 0] - x[..., 1] - 0.1,
        start=(1.0, 1.0, 1.0, 1.0),
        drive=Drive(3.5, (-8.0, 8.0)),
        time_step=0.05,
        equations={2: Equation(position=0, rate=2), 3: Equation(position=1, rate=3)},
        target=2,
        region=Region(lambda x: x[..., 1] - x[..., 0], target=2, feature=0),
        kinds=(*_MECHANICAL, *_GUARD),
    ),
    Plant(
        name="pendulum",
        description=(
            "A pendulum of length 1 m and moment of inertia 1 kg m^2, angle theta in rad from "
            "hanging, omega = theta' in rad/s, driven by a torque u in N m: "
            "omega' = -9.81 sin(theta) - 0.8 omega + u, one mode."
        ),
        states=("theta", "omega"),
        functions={"{1}": _SECOND, "sin({0})": _sine, "{2}": _INPUT},
        coef=np.array([[[1.0, 0.0, 0.0], [-0.8, -9.81, 1.0]]]),
        start=(1.2, 1.5),
        drive=Drive(3.0, (-5.5, 5.5)),
        time_step=0.04,
        region=Region(lambda x: x[..., 0], target=1, feature=0, share=0.3),
        kinds=_MECHANICAL,
    ),
    Plant(
        name="tanks",
        description=(
            "Two tanks in series, levels x1 and x2 in cm, the upper one filled by a pump at u in "
            "V: x1' = -0.4 sqrt(x1) + b u and x2' = 0.4 sqrt(x1) - 0.36 sqrt(x2), in cm/s, with "
            "b = 0.64 cm/(s V) where x2 <= 12 cm (mode 0); above, a level switch in the lower "
            "tank throttles the feed to b = 0.36 cm/(s V) (mode 1)."
        ),
        states=("x1", "x2"),
        functions={"sqrt({0})": _root_upper, "sqrt({1})": _root_lower, "{2}": _INPUT},
        coef=np.array([[[-0.4, 0, feed], [0.4, -0.36, 0]] for feed in (0.64, 0.36)]),
        guard=lambda x: x[..., 1] - 12.0,
        start=(5.0, 5.0),
        rest=(10.0, 12.0),
        drive=Drive(1.6, (0.6, 6.0), centre=2.8, periods=(12, 60), hold=8),
        time_step=1.0,
        equations={0: Equation(position=0, rate=0), 1: Equation(position=1, rate=1)},
        target=0,
        natural={"overflow": 1, "clock_lag": 1},
        powers=((2, 0),),
        region=Region(lambda x: -x[..., 1], target=0, feature=2),
        kinds=(*_ONE_SIDED, "overflow", "guard_hysteresis"),
        sign=1.0,  # a feed that nobody metered; a constant loss could empty a tank
    ),
    Plant(
        name="discrete",
        description=(
            "A sampled servo, one step a second: position x1 in mm, rate x2 in mm per step, "
            "command u in V. x1+ = 0.9 x1 + 0.4 x2; x2+ = -0.3 x1 + 0.6 x2 + 0.5 u where "
            "x1 + 0.5 x2 <= 0.3 mm (mode 0), x2+ = -0.7 x1 + 0.2 x2 + 0.5 u above (mode 1)."
        ),
        states=("x1", "x2"),
        coef=np.array([[[0.9, 0.4, 0], [-0.3, 0.6, 0.5]], [[0.9, 0.4, 0], [-0.7, 0.2, 0.5]]]),
        guard=lambda x: x[..., 0] + 0.5 * x[..., 1] - 0.3,
        start=(1.0, 1.0),
        drive=Drive(1.6, (-4.0, 4.0), periods=(10, 80), hold=15),
        time_step=1.0,
        natural={"sensor_offset": 0, "clock_lag": 0},
        region=Region(lambda x: -x[..., 0], target=1, feature=0),
        kinds=(*_MECHANICAL, "guard_hysteresis"),
        discrete=True,
    ),
]

PLANTS = {plant.name: plant for plant in _ALL}
