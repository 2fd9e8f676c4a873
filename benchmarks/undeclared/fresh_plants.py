"""Plants on which no constant of the library was set, with parameters drawn by chance.

Each is a function from a source of chance and a factor on the sampling rate to a plant; physical
parameters are drawn within a third of their usual values. A drive is the same in time at all rates.
A mode changes what its guard's own state does not feel at once, or only how fast it moves: at no
sample do both laws push a state back to its guard. A heater may still come back to it within a few
samples, again and again, and such records are counted apart (`fresh.py`).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from swsysid.datasets._undeclared.records import Drive, Equation, Plant, Region

__all__ = ["FRESH_PLANTS"]

Draw = Callable[..., np.ndarray]
LEVELS = ("bias", "periodic_forcing", "drift", "polynomial")
ACTUATOR = ("saturation", "backlash", "delay", "lag")
SENSOR = ("sensor_offset", "clock_lag")
FRICTION = ("coulomb_friction", "stribeck_friction", "quadratic_drag", "asymmetric_friction")
MECHANICAL = (*LEVELS, *ACTUATOR, *SENSOR, *FRICTION, "dead_zone", "power_law", "trigonometric")


def _about(rng: np.random.RandomState, *values: float) -> list[float]:
    """Values within a third of the usual ones."""
    factors = np.exp(rng.uniform(-np.log(4 / 3), np.log(4 / 3), len(values)))
    return [float(value * factor) for value, factor in zip(values, factors, strict=True)]


def _of_the_input(target: int) -> dict[str, int]:
    """Effects of an actuator are in the equation that the input drives."""
    return dict.fromkeys((*ACTUATOR, "dead_zone", "power_law"), target)


def _drive(rate: float, size: float, limits: tuple[float, float], **others) -> Drive:
    """A drive whose periods and steps last as long at every rate."""
    low, high = others.pop("periods", (30, 200))
    hold = others.pop("hold", 40)
    periods = (rate * low, rate * high)
    return Drive(size, limits, periods=periods, hold=rate * hold, **others)


def _beam(rng: np.random.RandomState, rate: float) -> Plant:
    stiffness, cubic, damping = _about(rng, 2.0, 1.5, 0.6)
    return Plant(
        name="beam",
        description="A clamped beam with a stiffening deflection x in mm, v = x' in mm/s.",
        states=("x", "v"),
        functions={
            "{0}": lambda x, v, u: x,
            "{0}^3": lambda x, v, u: x**3,
            "{1}": lambda x, v, u: v,
            "{2}": lambda x, v, u: u,
        },
        coef=np.array([[[0, 0, 1.0, 0], [-stiffness, -cubic, -damping, 1]]]),
        start=(1.0, 1.5),
        drive=_drive(rate, 2.5, (-6.0, 6.0)),
        time_step=0.05 / rate,
        powers=((2, 0), (2, 1)),
        region=Region(lambda x: x[..., 0], target=1, feature=2, share=0.25),
        kinds=(*MECHANICAL, "extra_mode"),
    )


def _motor(rng: np.random.RandomState, rate: float) -> Plant:
    resistance, back, torque, bearing, saturated, limit = _about(rng, 2.5, 1.2, 2.0, 0.7, 0.8, 0.6)
    laws = [
        [[-resistance, -back, 1.0], [per_ampere, -bearing, 0.0]]
        for per_ampere in (torque, saturated)
    ]
    return Plant(
        name="motor",
        description="Current i in A, speed w in rad/s; the iron saturates above a current.",
        states=("i", "w"),
        coef=np.array(laws),
        guard=lambda x: x[..., 0] - limit,
        start=(1.0, 1.5),
        drive=_drive(rate, 4.0, (-10.0, 10.0)),
        time_step=0.04 / rate,
        equations={1: Equation(1, 1)},
        natural={"sensor_offset": 1, "clock_lag": 1} | _of_the_input(0),
        powers=((3, 0),),
        region=Region(lambda x: -x[..., 1], target=1, feature=1),
        kinds=("bias", "periodic_forcing", "drift", "polynomial", *SENSOR[:1], *FRICTION, *ACTUATOR)
        + ("dead_zone", "extra_mode", "guard_hysteresis"),
    )


def _heater(rng: np.random.RandomState, rate: float) -> Plant:
    passed, back, loss, power, low, limit = _about(rng, 0.06, 0.1, 0.03, 0.5, 0.25, 16.0)
    laws = [[[-passed - loss, passed, 0.0], [back, -back, fed]] for fed in (power, low)]
    return Plant(
        name="heater",
        description="A box and its heater, T and H in K above the room; less power when warm.",
        states=("T", "H"),
        coef=np.array(laws),
        guard=lambda x: x[..., 0] - limit,
        start=(5.0, 5.0),
        rest=(12.0, 20.0),
        drive=_drive(rate, 1.5, (0.3, 6.0), centre=2.6, periods=(15, 80), hold=12),
        time_step=4.0 / rate,
        equations={0: Equation(0, 0), 1: Equation(1, 1)},
        target=0,
        natural={"clock_lag": 0, "sensor_offset": 1} | _of_the_input(1),
        powers=((2, 0),),
        region=Region(lambda x: -x[..., 0], target=0, feature=1),
        kinds=(*LEVELS, "saturation", "delay", "lag", *SENSOR, "extra_mode", "guard_hysteresis"),
        sign=1.0,
    )


def _hare(rng: np.random.RandomState, rate: float) -> Plant:
    growth, crowding, hunting, gain, death, second, limit = _about(
        rng, 0.9, 0.12, 0.35, 0.25, 0.7, 0.4, 2.6
    )
    laws = [
        [[growth, 0, -crowding, -hunting, 1.0], [0, -lost, 0, gain, 0]] for lost in (death, second)
    ]
    return Plant(
        name="hare",
        description="Prey h and predators l in thousands, prey released; few leave plenty.",
        states=("h", "l"),
        functions={
            "{0}": lambda h, w, u: h,
            "{1}": lambda h, w, u: w,
            "{0}^2": lambda h, w, u: h**2,
            "{0} {1}": lambda h, w, u: h * w,
            "{2}": lambda h, w, u: u,
        },
        coef=np.array(laws),
        guard=lambda x: x[..., 0] - limit,
        start=(1.0, 0.8),
        rest=(2.5, 1.8),
        drive=_drive(rate, 0.35, (0.05, 1.6), centre=0.6),
        time_step=0.1 / rate,
        equations={0: Equation(0, 0), 1: Equation(1, 1)},
        target=0,
        powers=((3, 0),),
        region=Region(lambda x: -x[..., 1], target=0, feature=0),
        kinds=(*LEVELS, "saturation", "delay", "lag", "guard_hysteresis"),
        sign=1.0,
    )


def _circuit(rng: np.random.RandomState, rate: float) -> Plant:
    resistance, inductance, saturated, capacitance, leak, limit = _about(
        rng, 0.5, 1.0, 0.45, 0.4, 0.2, 1.0
    )
    laws = [
        [
            [-resistance / henry, -1 / henry, 1 / henry],
            [1 / capacitance, -leak / capacitance, 0.0],
        ]
        for henry in (inductance, saturated)
    ]
    return Plant(
        name="circuit",
        description="A choke that saturates above a current i in A, a capacitor at v in V.",
        states=("i", "v"),
        coef=np.array(laws),
        guard=lambda x: x[..., 0] - limit,
        start=(1.0, 1.0),
        drive=_drive(rate, 2.5, (-6.0, 6.0)),
        time_step=0.05 / rate,
        equations={0: Equation(1, 0)},
        target=0,
        natural={"sensor_offset": 1, "clock_lag": 1, "extra_mode": 0},
        region=Region(lambda x: -x[..., 1], target=0, feature=0),
        kinds=(*MECHANICAL, "extra_mode", "guard_hysteresis"),
    )


def _sampled(rng: np.random.RandomState, rate: float) -> Plant:
    kept, passed, pull, second, limit = _about(rng, 0.8, 0.3, 0.25, 0.55, 0.4)
    laws = [
        [[kept, passed, 0.0], [-force, memory, 0.6]]
        for force, memory in ((pull, second), (2.2 * pull, 0.3 * second))
    ]
    return Plant(
        name="sampled",
        description="A sampled positioner: position p and rate r, stiffer beyond a line.",
        states=("p", "r"),
        coef=np.array(laws),
        guard=lambda x: x[..., 0] - 0.4 * x[..., 1] - limit,
        start=(1.0, 1.0),
        drive=_drive(rate, 1.4, (-4.0, 4.0), periods=(12, 90), hold=18),
        time_step=1.0,
        region=Region(lambda x: -x[..., 0], target=1, feature=0),
        kinds=(*MECHANICAL, "extra_mode", "guard_hysteresis"),
        discrete=True,
    )


FRESH_PLANTS = {
    "beam": _beam,
    "motor": _motor,
    "heater": _heater,
    "hare": _hare,
    "circuit": _circuit,
    "sampled": _sampled,
}
