"""Makers of the kinds of effects that a search looks for where they are asked for."""

from __future__ import annotations

import numpy as np

from swsysid.datasets._undeclared.mechanisms import Quantiser
from swsysid.datasets._undeclared.sizing import Planted, Sizing


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


SPECIAL_TERMS = {
    "load_friction": _load_friction,
    "input_gain": _input_gain,
    "soft_saturation": _soft_saturation,
    "hill": _hill,
    "ripple": _ripple,
}
SPECIAL_SENSORS = {"quantisation": _quantisation}
