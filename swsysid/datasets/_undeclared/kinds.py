"""The kinds of effects: each a function from `Sizing` to a mechanism and its true values."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from swsysid.datasets._undeclared.actuators import ACTUATORS
from swsysid.datasets._undeclared.mechanisms import ExtraMode, Hysteresis, Reset, Sensor
from swsysid.datasets._undeclared.records import Plant
from swsysid.datasets._undeclared.sizing import Planted, Sizing

__all__ = ["KINDS", "Kind"]


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


def _coulomb_friction(size: Sizing) -> Planted:
    rate = size.equation.rate
    mechanism, force = size.terms([lambda x, u, t, s: np.sign(x[..., rate])], [-1.0])
    return Planted(mechanism, rate, {"coulomb": force})


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


def _quadratic_drag(size: Sizing) -> Planted:
    rate = size.equation.rate
    mechanism, drag = size.terms([lambda x, u, t, s: x[..., rate] * np.abs(x[..., rate])], [-1.0])
    return Planted(mechanism, rate, {"drag": drag})


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


# -- the guard ---------------------------------------------------------------------------------


def _extra_mode(size: Sizing) -> Planted:
    region, reference = size.plant.region, size.reference
    score = np.where(reference.modes == region.base, region.score(reference.x), -np.inf)
    threshold = float(np.quantile(score, 1 - region.share))
    feature = size.plant.features(reference.x, reference.u)[region.feature]
    contribution = np.sqrt(np.mean(np.where(score > threshold, feature, 0.0) ** 2))
    change = float(region.sign * size.share * reference.scale[region.target] / contribution)
    mechanism = ExtraMode(
        score=region.score,
        threshold=threshold,
        base=region.base,
        target=region.target,
        feature=region.feature,
        change=change,
    )
    values = {"base": region.base, "feature": region.feature, "change": change}
    return Planted(mechanism, None, {**values, "threshold": threshold})


def _guard_hysteresis(size: Sizing) -> Planted:
    guard = size.plant.guard
    assert guard is not None  # the plants that have none do not name this kind

    def make(half_width):
        return Planted(Hysteresis(half_width=half_width), None, {"half_width": half_width})

    return make(size.solve(make, 0.8 * float(guard(size.reference.x).std())))


def _reset(size: Sizing) -> Planted:
    factor = max(0.0, 1.0 - size.magnitude * size.rng.uniform(0.3, 0.5))
    rate, direction = size.equation.rate, size.plant.jump
    mechanism = Reset(state=rate, factor=factor, direction=direction)
    return Planted(mechanism, rate, {"factor": factor, "direction": int(direction)})


# -- measurement -------------------------------------------------------------------------------


def _sensor_offset(size: Sizing) -> Planted:
    sign = size.sign()

    def make(distance):
        offset = sign * distance
        return Planted(Sensor(state=size.target, offset=offset), size.target, {"offset": offset})

    return make(size.solve(make, 2 * size.spread(size.target)))


def _clock_lag(size: Sizing) -> Planted:
    def make(delay):
        return Planted(Sensor(state=size.target, delay=delay), size.target, {"delay": delay})

    return make(size.solve_time(make, whole=size.plant.discrete))


def _mechanical(plant: Plant):
    return tuple(plant.equations)


def _states(plant: Plant):
    return tuple(range(plant.n_states))


def _only(kind: str, plant: Plant):
    return (plant.natural.get(kind, plant.target),)


_COLUMNS = {
    "bias": _bias,
    "coulomb_friction": _coulomb_friction,
    "stribeck_friction": _stribeck_friction,
    "quadratic_drag": _quadratic_drag,
    "polynomial": _polynomial,
    "trigonometric": _trigonometric,
    "periodic_forcing": _periodic_forcing,
    "drift": _drift,
    "input_coupling": _input_coupling,
    "asymmetric_friction": _asymmetric_friction,
    "overflow": _overflow,
}

KINDS = {
    **{name: Kind(make, _mechanical, in_one_mode=True) for name, make in _COLUMNS.items()},
    **{
        name: Kind(make, lambda plant: plant.driven, in_one_mode=True)
        for name, make in ACTUATORS.items()
    },
    "extra_mode": Kind(_extra_mode, lambda plant: (plant.region.target,)),
    "guard_hysteresis": Kind(_guard_hysteresis, partial(_only, "guard_hysteresis")),
    "reset": Kind(_reset, partial(_only, "reset")),
    "sensor_offset": Kind(_sensor_offset, _states),
    "clock_lag": Kind(_clock_lag, _states),
}
