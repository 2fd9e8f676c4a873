"""Recordings as a README of the measured sets declares them, one call each, nothing chosen.

Sets of SWSYSID_DATA that a README describes by a law of rates or of a force: which states and
inputs, what the law lacks, and how sure that is. The first effect that is named is compared with
what is lacking; every further one must be lacking as well. Errors are those of free rollouts of the
first state on what the search holds out, or of the force.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from time import process_time

import numpy as np
import pandas as pd
from sklearn.preprocessing import FunctionTransformer

from benchmarks.measured.rows import ByDefault
from swsysid import EffectSearchCV, SwitchingSystemRegressor

FRICTION = ("coulomb_friction", "asymmetric_friction", "stribeck_friction")
MEMORY = ("lag", "delay")


def rows() -> list[ByDefault]:
    """One row a set."""
    return [searched(name) for name in CASES]


def searched(name: str) -> ByDefault:
    """The row of one set."""
    lacks, right, data = CASES[name]
    X, options, *library = data()
    estimator = SwitchingSystemRegressor(
        1, feature_library=library[0] if library else 1, random_state=0
    )
    started = process_time()
    search = EffectSearchCV(estimator).fit(X, **options)
    seconds = process_time() - started
    errors = [model["held_out"][0] for model in search.report_["errors"]]
    kinds = [effect.kind for effect in search.effects_]
    found = ", ".join(f"{effect.kind} of {effect.place}" for effect in search.effects_)
    verdict = _verdict([kind in right for kind in kinds])
    return ByDefault(
        name, lacks, found or "nothing", verdict, float(errors[0]), float(errors[-1]), seconds
    )


def _verdict(lacking: list[bool]) -> str:
    """By which of the effects that were found are lacking indeed."""
    if not lacking:
        return "nothing"
    if not lacking[0]:
        return "wrong"
    return "right" if all(lacking) else "partly"


def _table(path: str) -> pd.DataFrame:
    return pd.read_csv(Path(os.environ["SWSYSID_DATA"]) / path)


def _pendulum():
    table = _table("simple_pendulum/constant_torque_decay.csv")
    table = table[(table.t_s >= 12.55) & (table.t_s < 22.0)]
    library = FunctionTransformer(
        lambda X: np.column_stack([np.ones(len(X)), X[:, 1], np.sin(X[:, 0])])
    )
    return table[["q_rad", "dq_rad_per_s"]], {"t": table.t_s.to_numpy()}, library


def _motor():
    table = _table("dc_motor_deadzone/staircase.csv")
    return table[["speed_rpm"]], {"t": table.t_s.to_numpy(), "inputs": table[["voltage_V"]]}


def _cart():
    table = _table("cart_friction/cart_relay.csv")
    table = table[table.run > 1]  # the first is the second again
    return table[["v_m_per_s"]], _runs(table, inputs=table[["current_A"]])


def _damper():
    table = _table("friction_damper/damper.csv")
    return table[["x_in", "v_in_per_s"]], _runs(table, y=table.F_kip.to_numpy())


def _throttle():
    table = _table("throttle_valve_friction/throttle.csv")
    return table[["theta_rad"]], _runs(table, inputs=table[["u_V"]])


def _pneumatic():
    table = _table("pneumatic_seal_friction/pneumatic.csv")
    options = _runs(table, y=table.force_N.to_numpy(), signals=table[["x_mm"]])
    return table[["pressure_bar"]], options


def _pipe():
    table = _table("pipe_delay/pipe_delay.csv")
    options = _runs(table, inputs=table[["Tin_C"]], signals=table[["flow_kg_s"]])
    return table[["Tout_C"]], options


def _heaters(runs: list[str]):
    table = _table("tclab_lag/tclab_lag.csv")
    table = table[table.run.isin(runs)]
    signals = ["T2_C"] if runs == ["A1", "A2"] else ["T2_C", "Q2_pct"]
    return table[["T1_C"]], _runs(table, inputs=table[["Q1_pct"]], signals=table[signals])


def _runs(table: pd.DataFrame, **options) -> dict:
    return {"t": table.t_s.to_numpy(), "groups": table.run.to_numpy(), **options}


# name: what the law lacks, kinds that say so, the data
CASES: dict[str, tuple[str, tuple[str, ...], Callable]] = {
    "pendulum": ("dry friction", FRICTION, _pendulum),
    "motor": ("dead zone", ("dead_zone",), _motor),
    "cart": ("dry friction, delay (weak)", (*FRICTION, *MEMORY), _cart),
    "damper": ("backlash of x, dry friction", ("backlash", *FRICTION), _damper),
    "throttle": ("stick, dry friction", FRICTION, _throttle),
    "pneumatic seal": (
        "friction by direction, more of it under pressure",
        (*FRICTION, "load_friction"),
        _pneumatic,
    ),
    "pipe": ("delay = mass / flow", MEMORY, _pipe),
    "heater, A": ("lag", MEMORY, lambda: _heaters(["A1", "A2"])),
    "heater, B": ("lag, coupling", (*MEMORY, "input_coupling"), lambda: _heaters(["B"])),
}
