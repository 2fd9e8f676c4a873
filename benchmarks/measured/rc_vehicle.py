"""Model vehicle: a linear law, its authors' power law of the throttle, dry friction, and both.

Dry friction is two modes, one for each direction, that share all other numbers; at the surface
between them the vehicle sticks. The throttle acts .031 s late, as its authors found.
"""

from __future__ import annotations

import numpy as np

from benchmarks.measured.choice import free_run
from benchmarks.measured.rows import FreeRun, Run
from swsysid.datasets import fetch_rc_vehicle
from swsysid.refinement import ParametricLibrary, StatedModel, StatedSurface, refine

COLUMNS = ["v", "throttle"]
DELAY = 0.031  # s
RATES = {"damping": 1.5, "gain": 6.0}  # 1/s, m/s^2
POWER, FRICTION = {"power": 1.2}, {"friction": 0.3}  # and m/s^2: where their refinement begins


def rows() -> list[FreeRun]:
    """Free run of the speed on the last two fifths of the record, in m/s."""
    data = fetch_rc_vehicle()
    train, test = _late(data.train), _late(data.test)
    linear, *others = (
        _free_run(_model(power, friction), train, test)
        for power, friction in ((False, False), (True, False), (False, True), (True, True))
    )
    # what the vehicle's authors use, with the numbers that these data ask for
    published = {"readable": (others[0].error(),)}
    changes = {
        "its authors' power law of the throttle": {},
        "dry friction": published,
        "power law and dry friction": published,
    }
    return [
        FreeRun.of_runs("vehicle, speed, m/s", change, [linear], [run], **known)
        for (change, known), run in zip(changes.items(), others, strict=True)
    ]


def _late(record) -> dict:
    """The record with the throttle of a delay ago, which is held between its samples."""
    sent = np.searchsorted(record.t, record.t - DELAY + 1e-9, side="right") - 1
    throttle = record.inputs[np.maximum(sent, 0), :1]
    return {"t": record.t - record.t[0], "x": record.x, "inputs": throttle}


def _model(power: bool, friction: bool) -> StatedModel:
    """Only named parameters are free: those of both directions are the same."""
    terms, parameters = {"law": _linear}, RATES
    if power:
        terms, parameters = {"law": _with_power}, parameters | POWER
    coef, surface = [[[1.0]]], None
    if friction:
        terms, parameters = terms | {"dry": _dry}, parameters | FRICTION
        coef = [[[1.0, 1.0]], [[1.0, -1.0]]]
        surface = StatedSurface([[0.0, 1.0, 0.0]])  # mode 0 where v < 0
    return StatedModel(
        ParametricLibrary(terms, COLUMNS, parameters),
        coef,
        states=COLUMNS[:1],
        inputs=COLUMNS[1:],
        surface=surface,
        free=np.zeros(np.shape(coef), dtype=bool),
    )


def _linear(v, throttle, damping, gain):
    return gain * throttle - damping * v


def _with_power(v, throttle, damping, gain, power):
    return gain * np.sign(throttle) * np.abs(throttle) ** power - damping * v


def _dry(v, friction):
    return np.full_like(v, friction)


def _free_run(model: StatedModel, train: dict, test: dict) -> Run:
    result = refine(model, train)
    return Run(free_run(result, test["x"][0], test), test["x"])
