"""Measured recordings that switch where no logged state tells, by default settings, one call each.

A gear that a driver chose, a step of a battery cycler, a thermostat in another room, a cell that
has used up its sugar. What counts is the law of each mode, and when it was active; that nothing
logged tells the switches is part of the right answer. Errors are what the laws leave where they are
told the modes, of one law and of those that were found.
"""

from __future__ import annotations

from collections.abc import Callable
from time import process_time

import numpy as np
import pandas as pd

from benchmarks.measured.rows import ByDefault, read
from swsysid import HybridAutomatonRegressor, SwitchingSystemRegressor

Answer = tuple[str, bool, bool, float, float]  # what was found, modes and laws right, errors


def rows() -> list[ByDefault]:
    """One row a set."""
    return [identified(name) for name in CASES]


def identified(name: str) -> ByDefault:
    """The row of one set."""
    lacks, estimator, hand, run = CASES[name]
    started = process_time()
    found, told, close, before, after = run()
    seconds = process_time() - started
    verdict = "right" if told and close else "partly" if told or close else "wrong"
    return ByDefault(name, lacks, estimator, found, verdict, before, after, hand, seconds)


def _heat_pump() -> Answer:
    log = read("ashp_two_stage/ashp_two_stage.csv")
    model, one = _automata(
        log[["T_supply_C"]], log.t_min, groups=log.run, inputs=log[["T_return_C"]]
    )
    rates = -model.coef_[:, 0, 1]  # per minute
    on = model.modes_ == int(np.argmax(rates))
    compressor = log.true_compressor.to_numpy(dtype=bool)
    shifted = [np.roll(compressor, steps) for steps in (-1, 0, 1)]
    agreed = float(np.mean(np.any([on == one for one in shifted], axis=0)))
    found = f"{model.n_modes_} modes, {agreed:.0%} of the minutes those of the compressor"
    told = model.n_modes_ == 2 and agreed >= 0.95
    return found, told, bool(np.ptp(np.log(np.abs(rates))) > np.log(5.0)), *_left(one, model)


def _cycler() -> Answer:
    log = read("battery_cccv/battery_cccv.csv")
    log = log[log.split != "test_fast"]
    model, one = _automata(
        log[["i_mA"]], log.t_s.astype(float), groups=log.split, inputs=log[["v_V"]]
    )
    decays = -model.coef_[:, 0, 1]
    own = int(np.argmax(decays))
    agreed = float(np.mean((model.modes_ == own) == (log.true_mode == "charge_cv")))
    close = bool(abs(decays[own] * 2242.0 - 1.0) < 0.1)  # of the time that the hand fit found
    found = f"{model.n_modes_} modes, one decays in {1.0 / decays[own]:.0f} s"
    return found, model.n_modes_ == 2 and agreed > 0.99, close, *_left(one, model)


def _two_sugars() -> Answer:
    log = read("ecoli_diauxie/ecoli_diauxie.csv")
    model, one = _automata(log[["od650"]], log.t_h, groups=log.vessel, feature_library=None)
    rates = model.coef_[:, 0, 0]
    order = np.argsort(-rates)
    phases = ["preshift_exponential", "postshift_exponential", "stall"]
    known = log.true_phase.isin(phases)
    names = np.array([*phases, *["another"] * len(rates)])[np.argsort(order)]
    agreed = float(np.mean(names[model.modes_][known] == log.true_phase[known]))
    found = f"{len(rates)} modes, growth {', '.join(f'{rate:.2f}' for rate in rates[order])} per h"
    close = len(rates) == 3 and bool(np.abs(rates[order] - [0.92, 0.39, 0.0]).max() < 0.1)
    return found, len(rates) == 3 and agreed > 0.9, close, *_left(one, model)


def _gears() -> Answer:
    log = read("obd_car_gears/gears.csv")
    X, y = log[["speed_kmh"]], log.engine_rpm
    model, one = (SwitchingSystemRegressor(n, random_state=0).fit(X, y) for n in ("auto", 1))
    slopes = model.coef_[:, 0, 0]
    lines = np.array([129.67, 70.4, 45.19, 32.24, 24.32])
    nearest = [int(np.abs(np.log(np.abs(slopes) / line)).argmin()) for line in lines]
    close = bool(np.abs(slopes[nearest] / lines - 1.0).max() < 0.03)
    gear = log.gear_from_ratio.to_numpy()
    driven = gear > 0
    told = model.modes_[driven] == np.array(nearest)[gear[driven] - 1]
    found = f"{len(slopes)} modes, {', '.join(f'{slopes[k]:.1f}' for k in nearest)} rpm per km/h"
    errors = [
        float(np.sqrt(np.mean((y - velocities)[driven] ** 2)))
        for velocities in (one.predict(X), slopes[model.modes_] * X.speed_kmh)
    ]
    return found, bool(np.mean(told) > 0.95), close, *errors


def _automata(
    x: pd.DataFrame, t: pd.Series, groups: pd.Series, feature_library=1, **options
) -> list[HybridAutomatonRegressor]:
    """By default, and with one law."""
    return [
        HybridAutomatonRegressor(n, feature_library=feature_library, random_state=0).fit(
            x, t.to_numpy(), groups=groups.to_numpy(), **options
        )
        for n in ("auto", 1)
    ]


def _left(*models: HybridAutomatonRegressor) -> tuple[float, ...]:
    return tuple(float(model.noise_[0]) for model in models)


# name: what one law lacks, the estimator, by hand, the run
CASES: dict[str, tuple[str, str, str, Callable[[], Answer]]] = {
    "heat pump": ("a law for on, one for off", "automaton", "2.2 → 1.1 K", _heat_pump),
    "battery": ("a third step of the cycler", "automaton", "195 → 1.2 mA", _cycler),
    "E. coli": ("growth, stall, growth", "automaton", ".210 → .047 log OD", _two_sugars),
    "gears": ("five gears", "regressor", "243 → 23 rpm", _gears),
}
