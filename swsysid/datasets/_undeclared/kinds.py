"""The kinds of effects: each a function from `Sizing` to a mechanism and its true values.

At the end are those that a search looks for only where they are asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from swsysid._results import Array
from swsysid.datasets._undeclared.records import (
    Actuator,
    ExtraMode,
    Mechanism,
    Plant,
    Quantiser,
    Reset,
    Sensor,
    late,
)
from swsysid.datasets._undeclared.simulation import Planted, Sizing


def _load_friction(size: Sizing) -> Planted:
    rate = size.equation.rate
    functions = [lambda x, u, t, s: np.abs(u) * np.sign(x[..., rate])]
    mechanism, strength = size.terms(functions, [-1.0])
    return Planted(mechanism, rate, {"friction": strength, "load": "u"})


def _input_gain(size: Sizing) -> Planted:
    rate = size.equation.rate
    mechanism, strength = size.terms([lambda x, u, t, s: np.abs(u) * x[..., rate]], [-1.0])
    return Planted(mechanism, rate, {"change": -strength})


def _soft_saturation(size: Sizing) -> Planted:
    position = size.equation.position
    scale = size.rng.uniform(0.2, 0.4) * size.spread(position)
    functions = [lambda x, u, t, s: x[..., position] / (1.0 + np.abs(x[..., position]) / scale)]
    mechanism, strength = size.terms(functions, [-1.0])
    return Planted(mechanism, position, {"gain": -strength, "scale": scale})


def _hill(size: Sizing) -> Planted:
    position = size.equation.position
    scale = size.rng.uniform(0.4, 0.8) * size.spread(position)
    functions = [lambda x, u, t, s: x[..., position] ** 2 / (scale**2 + x[..., position] ** 2)]
    mechanism, _ = size.terms(functions, [size.sign()])
    return Planted(mechanism, position, {"gain": mechanism.coefficients[0], "scale": scale})


def _ripple(size: Sizing) -> Planted:
    position = size.equation.position
    # ten to twenty periods in four standard deviations
    period = 4.0 * size.spread(position) / size.rng.uniform(10.0, 20.0)
    functions = [lambda x, u, t, s: np.sin(2.0 * np.pi / period * x[..., position])]
    mechanism, _ = size.terms(functions, [size.sign()])
    values = {"amplitude": mechanism.coefficients[0], "period": period}
    return Planted(mechanism, position, values)


def _quantisation(size: Sizing) -> Planted:
    def make(step: float) -> Planted:
        mechanism = Quantiser(state=size.target, step=step)
        return Planted(mechanism, size.target, {"step": step})

    # coarse enough to be seen, and some ten steps in the range of the state
    return make(size.solved(make, 0.4 * size.magnitude * size.spread(size.target)))


_SPECIAL_TERMS = {
    "load_friction": _load_friction,
    "input_gain": _input_gain,
    "soft_saturation": _soft_saturation,
    "hill": _hill,
    "ripple": _ripple,
}
_SPECIAL_SENSORS = {"quantisation": _quantisation}


@dataclass(frozen=True)
class Kind:
    """How a kind is made, which targets it can have, and whether it can act in one mode."""

    make: Callable[[Sizing], Planted]
    targets: Callable[[Plant], tuple[int, ...]]
    in_one_mode: bool = False


# -- further terms of the law ------------------------------------------------------------------


def _bias(size: Sizing) -> Planted:
    mechanism, _ = size.terms([lambda x, u, t, s: np.ones_like(u)], [size.sign()])
    return Planted(mechanism, None, {"offset": mechanism.coefficients[0]})


def _resistance(name: str, law: Callable[[Array], Array], size: Sizing) -> Planted:
    """A force against the rate, with one parameter of that name."""
    rate = size.equation.rate
    mechanism, strength = size.terms([lambda x, u, t, s: law(x[..., rate])], [-1.0])
    return Planted(mechanism, rate, {name: strength})


def _stribeck_friction(size: Sizing) -> Planted:
    rate = size.equation.rate
    slow = size.rng.uniform(0.25, 0.4) * size.spread(rate)
    excess = size.rng.uniform(1.0, 1.5)  # static over Coulomb friction, less one
    functions = [
        lambda x, u, t, s: np.sign(x[..., rate]),
        lambda x, u, t, s: np.sign(x[..., rate]) * np.exp(-((x[..., rate] / slow) ** 2)),
    ]
    mechanism, force = size.terms(functions, [-1.0, -excess])
    values = {"coulomb": force, "static": force * (1 + excess), "velocity": slow}
    return Planted(mechanism, rate, values)


def _asymmetric_friction(size: Sizing) -> Planted:
    rate = size.equation.rate
    functions = [
        lambda x, u, t, s: np.sign(np.maximum(x[..., rate], 0.0)),
        lambda x, u, t, s: np.sign(np.minimum(x[..., rate], 0.0)),
        lambda x, u, t, s: np.maximum(x[..., rate], 0.0),
        lambda x, u, t, s: np.minimum(x[..., rate], 0.0),
    ]
    forward, backward = size.rng.uniform([0.8, 0.2], [1.2, 0.4])
    if size.rng.uniform() < 0.5:
        forward, backward = backward, forward
    viscous = 0.3 / size.spread(rate)
    weights = [-forward, -backward, -viscous * forward, -viscous * backward]
    mechanism, _ = size.terms(functions, weights)
    names = ("coulomb_positive", "coulomb_negative", "viscous_positive", "viscous_negative")
    values = dict(zip(names, -np.array(mechanism.coefficients), strict=True))
    return Planted(mechanism, rate, {name: float(value) for name, value in values.items()})


def _polynomial(size: Sizing) -> Planted:
    choices, equation = size.plant.powers, size.equation
    powers = np.zeros(size.plant.n_states + 1, dtype=int)
    # added, because the two columns are one on a plant of the first order
    np.add.at(powers, [equation.position, equation.rate], choices[size.rng.randint(len(choices))])
    used = powers[:-1]
    mechanism, _ = size.terms([lambda x, u, t, s: np.prod(x**used, axis=-1)], [-1.0])
    values = {"powers": tuple(powers.tolist()), "coefficient": mechanism.coefficients[0]}
    return Planted(mechanism, equation.position, values)


def _trigonometric(size: Sizing) -> Planted:
    position = size.equation.position
    # +- two standard deviations are then more than a whole period
    number = size.rng.uniform(1.8, 2.4) / size.spread(position)
    mechanism, _ = size.terms([lambda x, u, t, s: np.sin(number * x[..., position])], [size.sign()])
    values = {"amplitude": mechanism.coefficients[0], "wavenumber": number}
    return Planted(mechanism, position, values)


def _periodic_forcing(size: Sizing) -> Planted:
    period = size.rng.uniform(17, 40) * size.plant.time_step
    frequency, phase = 2 * np.pi / period, size.rng.uniform(0, 2 * np.pi)
    functions = [
        lambda x, u, t, s: np.sin(frequency * t),
        lambda x, u, t, s: np.cos(frequency * t),
    ]
    mechanism, amplitude = size.terms(functions, [np.cos(phase), np.sin(phase)])
    values = {"amplitude": amplitude, "frequency": 1 / period, "phase": phase}
    return Planted(mechanism, None, values)


def _drift(size: Sizing) -> Planted:
    position, sign = size.equation.position, size.sign()
    if size.rng.uniform() < 0.5:
        mechanism, _ = size.terms([lambda x, u, t, s: t], [sign])
        return Planted(mechanism, None, {"of": "level", "rate": mechanism.coefficients[0]})
    # a spring may only stiffen: one that softens could lose its rest
    mechanism, _ = size.terms([lambda x, u, t, s: t * x[..., position]], [-1.0])
    return Planted(mechanism, position, {"of": "stiffness", "rate": mechanism.coefficients[0]})


def _input_coupling(size: Sizing) -> Planted:
    channel = int(size.rng.randint(size.reference.signals.shape[-1]))
    weight = float(size.rng.choice([-1.0, 1.0]))
    mechanism, _ = size.terms([lambda x, u, t, s: s[..., channel]], [weight])
    return Planted(mechanism, channel, {"gain": mechanism.coefficients[0]})


def _overflow(size: Sizing) -> Planted:
    position = size.equation.position
    level = float(np.quantile(size.reference.x[..., position], size.rng.uniform(0.6, 0.75)))
    mechanism, rate = size.terms(
        [lambda x, u, t, s: np.maximum(x[..., position] - level, 0.0)], [-1.0]
    )
    return Planted(mechanism, position, {"level": level, "rate": rate})


_COLUMNS: dict[str, Callable[[Sizing], Planted]] = {
    "bias": _bias,
    "coulomb_friction": partial(_resistance, "coulomb", np.sign),
    "stribeck_friction": _stribeck_friction,
    "quadratic_drag": partial(_resistance, "drag", lambda rate: rate * np.abs(rate)),
    "polynomial": _polynomial,
    "trigonometric": _trigonometric,
    "periodic_forcing": _periodic_forcing,
    "drift": _drift,
    "input_coupling": _input_coupling,
    "asymmetric_friction": _asymmetric_friction,
    "overflow": _overflow,
}


# -- actuators: operators on the history of the input --------------------------------------------
#
# All of them are computed from the samples of the input alone: it is linear between samples,
# constant before the first one, and filter and play start in equilibrium there.


def _backlash(u: Array, step: float, *, width: float) -> Array:
    """Play of total width: the output moves only when pushed by one end of the gap."""
    output = u.copy()
    for row in range(1, len(u)):
        output[row] = np.clip(output[row - 1], u[row] - width / 2, u[row] + width / 2)
    return output


def _lag(u: Array, step: float, *, time_constant: float) -> Array:
    """Exact solution of ``time_constant * y' = u - y`` for an input linear between rows."""
    kept = np.exp(-step / time_constant)
    behind = np.diff(u, axis=0) * time_constant / step  # of a ramp, in the long run
    output = u.copy()
    for row in range(1, len(u)):
        lead = output[row - 1] - u[row - 1] + behind[row - 1]
        output[row] = u[row] - behind[row - 1] + kept * lead
    return output


def _power_law(size: Sizing) -> Planted:
    direction, u = size.rng.choice([-1.0, 1.0]), size.reference.u

    def parameters(excess: float) -> Mapping[str, float]:
        exponent = float((1.0 + excess) ** direction)
        # the same power as the input: the effect is the bend alone, not another gain
        gain = float(np.sqrt(np.mean(u**2) / np.mean(np.abs(u) ** (2 * exponent))))
        return {"exponent": exponent, "gain": gain}

    def bent(u: Array, step: float, exponent: float, gain: float) -> Array:
        return gain * np.sign(u) * np.abs(u) ** exponent

    return _actuator(size, bent, parameters, 2.0)


def _actuator(
    size: Sizing,
    operator: Callable[..., Array],
    parameters: Callable[[float], Mapping[str, float]],
    upper: float | None = None,
    whole: bool = False,
) -> Planted:
    def mechanism(**chosen: float) -> Actuator:
        return Actuator(mode=size.mode, operator=partial(operator, **chosen))

    return _solved(size, mechanism, parameters, size.plant.n_states, upper, whole)


def _solved(
    size: Sizing,
    mechanism: Callable[..., Mechanism],
    parameters: Callable[[float], Mapping[str, float]],
    channel: int | None,
    upper: float | None = None,
    whole: bool = False,
) -> Planted:
    """A mechanism of the right size; its parameters are functions of a number up to `upper`.

    Without `upper` the number is a time, of `whole` samples where time is discrete.
    """

    def make(number: float) -> Planted:
        chosen = parameters(number)
        return Planted(mechanism(**chosen), channel, chosen)

    if upper is not None:
        return make(size.solved(make, upper))
    return make(size.solved_time(make, whole and size.plant.discrete))


_ACTUATORS: dict[str, Callable[[Sizing], Planted]] = {
    "dead_zone": lambda size: _actuator(
        size,
        lambda u, step, threshold: np.sign(u) * np.maximum(np.abs(u) - threshold, 0.0),
        lambda threshold: {"threshold": threshold},
        0.6 * size.largest_input,
    ),
    "saturation": lambda size: _actuator(
        size,
        lambda u, step, threshold: np.clip(u, -threshold, threshold),
        lambda excess: {"threshold": size.largest_input - excess},
        0.9 * size.largest_input,
    ),
    "backlash": lambda size: _actuator(
        size, _backlash, lambda width: {"width": width}, 1.2 * size.largest_input
    ),
    "delay": lambda size: _actuator(
        size,
        lambda u, step, delay: late(u, delay, step),
        lambda delay: {"delay": delay},
        whole=True,
    ),
    "power_law": _power_law,
    "lag": lambda size: _actuator(size, _lag, lambda constant: {"time_constant": constant}),
}


# -- the guard and the sensors -------------------------------------------------------------------


def _extra_mode(size: Sizing) -> Planted:
    region, done = size.plant.region, size.reference
    score = np.where(done.modes == region.base, region.score(done.x), -np.inf)
    threshold = float(np.quantile(score, 1 - region.share))
    feature = size.plant.features(done.x, done.u)[region.feature]
    contribution = np.sqrt(np.mean(np.where(score > threshold, feature, 0.0) ** 2))
    change = -float(size.share * size.scale[region.target] / contribution)
    mechanism = ExtraMode(region=region, threshold=threshold, change=change)
    values = {"base": region.base, "feature": region.feature, "change": change}
    return Planted(mechanism, None, {**values, "threshold": threshold})


def _guard_hysteresis(size: Sizing) -> Planted:
    guard = size.plant.guard
    assert guard is not None  # the plants that have none do not name this kind
    upper = 0.8 * float(guard(size.reference.x).std())
    return _solved(size, Mechanism, lambda half_width: {"half_width": half_width}, None, upper)


def _reset(size: Sizing) -> Planted:
    factor = max(0.0, 1.0 - size.magnitude * size.rng.uniform(0.3, 0.5))
    rate, direction = size.equation.rate, size.plant.jump
    mechanism = Reset(state=rate, factor=factor, direction=direction)
    return Planted(mechanism, rate, {"factor": factor, "direction": int(direction)})


def _sensor_offset(size: Sizing) -> Planted:
    sign, sensor = size.sign(), partial(Sensor, state=size.target)
    upper = 2 * size.spread(size.target)
    return _solved(size, sensor, lambda distance: {"offset": sign * distance}, size.target, upper)


def _clock_lag(size: Sizing) -> Planted:
    sensor = partial(Sensor, state=size.target)
    return _solved(size, sensor, lambda delay: {"delay": delay}, size.target, whole=True)


def _mechanical(plant: Plant):
    return tuple(plant.equations)


def _states(plant: Plant):
    return tuple(range(plant.n_states))


KINDS = {
    **{
        name: Kind(make, _mechanical, in_one_mode=True)
        for name, make in (_COLUMNS | _SPECIAL_TERMS).items()
    },
    **{
        name: Kind(make, lambda plant: plant.driven, in_one_mode=True)
        for name, make in _ACTUATORS.items()
    },
    "extra_mode": Kind(_extra_mode, lambda plant: (plant.region.target,)),
    "guard_hysteresis": Kind(_guard_hysteresis, lambda p: (p.target_of("guard_hysteresis"),)),
    "reset": Kind(_reset, lambda plant: (plant.target_of("reset"),)),
    "sensor_offset": Kind(_sensor_offset, _states),
    "clock_lag": Kind(_clock_lag, _states),
    **{name: Kind(make, _states) for name, make in _SPECIAL_SENSORS.items()},
}
