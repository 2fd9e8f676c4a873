"""Recordings as a README of the measured sets declares them, one call each, nothing chosen.

Sets of SWSYSID_DATA that a README describes by a law of rates or of a force: which states and
inputs, what the law lacks, and how sure that is. The first effect that is found is compared with
what is lacking; every further one that has a name must be lacking as well. Errors are those of free
rollouts of the first state on what the search holds out, or of the force.
"""

from __future__ import annotations

from collections.abc import Callable
from time import process_time

import numpy as np
import pandas as pd
from sklearn.preprocessing import FunctionTransformer

from benchmarks.measured import modes_by_default
from benchmarks.measured.rows import ByDefault, read
from swsysid import EffectSearchCV, SwitchingSystemRegressor
from swsysid.datasets import fetch_emps, fetch_silverbox
from swsysid.differentiation import differentiate

FRICTION = ("coulomb_friction", "asymmetric_friction", "stribeck_friction")
MEMORY = ("lag", "delay", "transport_delay")
LEVELS = ("overflow", "saturation")
HYSTERESIS = ("hysteresis", "dahl_friction", "bouc_wen", "lugre_friction", "backlash")


def rows() -> list[ByDefault]:
    """One row a set."""
    return [*map(searched, CASES), *modes_by_default.rows()]


def searched(name: str) -> ByDefault:
    """The row of one set."""
    lacks, right, hand, data = CASES[name]
    X, options, *library = data()
    estimator = SwitchingSystemRegressor(
        1, feature_library=library[0] if library else 1, random_state=0
    )
    started = process_time()
    search = EffectSearchCV(estimator).fit(X, **options)
    seconds = process_time() - started
    errors = [model["held_out"][0] for model in search.report_["errors"]]
    # what is called nearest names nothing; a first one is compared all the same
    named = [effect for k, effect in enumerate(search.effects_) if not (k and effect.doubts)]
    verdict = verdict_of([effect.kind for effect in named], right)
    if named and named[0].doubts:
        verdict = f"{verdict}, unsure"
    found = ", ".join(
        f"{'no name, nearest ' if effect.doubts else ''}{effect.kind} of {effect.place}"
        for effect in search.effects_
    )
    error = float(errors[0]), float(errors[-1])
    return ByDefault(name, lacks, "search", found or "nothing", verdict, *error, hand, seconds)


def verdict_of(kinds: list[str], right: tuple[str, ...]) -> str:
    """By which of the effects that were found are lacking indeed."""
    lacking = [kind in right for kind in kinds]
    if not lacking:
        return "nothing"
    if not lacking[0]:
        return "wrong"
    return "right" if all(lacking) else "partly"


def _pendulum():
    table = read("simple_pendulum/constant_torque_decay.csv")
    table = table[(table.t_s >= 12.55) & (table.t_s < 22.0)]
    library = FunctionTransformer(
        lambda X: np.column_stack([np.ones(len(X)), X[:, 1], np.sin(X[:, 0])])
    )
    return table[["q_rad", "dq_rad_per_s"]], {"t": table.t_s.to_numpy()}, library


def _motor():
    table = read("dc_motor_deadzone/staircase.csv")
    return table[["speed_rpm"]], {"t": table.t_s.to_numpy(), "inputs": table[["voltage_V"]]}


def _cart():
    table = read("cart_friction/cart_relay.csv")
    table = table[table.run > 1]  # the first is the second again
    return table[["v_m_per_s"]], _runs(table, inputs=table[["current_A"]])


def _damper():
    table = read("friction_damper/damper.csv")
    return table[["x_in", "v_in_per_s"]], _runs(table, y=table.F_kip.to_numpy())


def _throttle():
    table = read("throttle_valve_friction/throttle.csv")
    return table[["theta_rad"]], _runs(table, inputs=table[["u_V"]])


def _pneumatic():
    table = read("pneumatic_seal_friction/pneumatic.csv")
    options = _runs(table, y=table.force_N.to_numpy(), signals=table[["x_mm"]])
    return table[["pressure_bar"]], options


def _pipe():
    table = read("pipe_delay/pipe_delay.csv")
    options = _runs(table, inputs=table[["Tin_C"]], signals=table[["flow_kg_s"]])
    return table[["Tout_C"]], options


def _heaters(runs: list[str]):
    table = read("tclab_lag/tclab_lag.csv")
    table = table[table.run.isin(runs)]
    signals = ["T2_C"] if runs == ["A1", "A2"] else ["T2_C", "Q2_pct"]
    return table[["T1_C"]], _runs(table, inputs=table[["Q1_pct"]], signals=table[signals])


def _axis(of_force: bool):
    train = fetch_emps().train
    q = differentiate(train.x, train.t, inputs=train.inputs, order=2, decimate=10)
    table = pd.DataFrame(q.X, columns=["q", "v", "force"]).assign(acceleration=q.Xdot[:, 1])
    if of_force:
        return table[["v", "acceleration"]], {"y": table.force.to_numpy(), "t": q.t}
    return table[["q", "v"]], {"t": q.t, "inputs": table[["force"]]}


def _silverbox():
    train = fetch_silverbox().train
    x, t, inputs = (part[:8000] for part in (train.x, train.t, train.inputs))  # of 65,061
    q = differentiate(x, t, inputs=inputs, order=2)
    table = pd.DataFrame(q.X, columns=["y", "v", "u"])
    return table[["y", "v"]], {"t": q.t, "inputs": table[["u"]]}


def _tanks():
    table = read("cascaded_tanks/cascaded_tanks.csv")
    return table[["y_est_V"]], {"t": table.t_s.to_numpy(), "inputs": table[["u_est_V"]]}


def _hysteresis():
    table = read("mr_damper/mr_damper.csv")
    return table[["force_N"]], {"t": table.t_s.to_numpy(), "inputs": table[["v_m_per_s"]]}


def _vehicle():
    table = read("rc_vehicle/rc_vehicle_50Hz.csv")
    inputs, signals = table[["throttle"]], table[["steering"]]
    return table[["speed_m_per_s"]], {
        "t": table.t_s.to_numpy(),
        "inputs": inputs,
        "signals": signals,
    }


def _drives():
    table = read("ced_prbs/ced_prbs.csv")
    parts = [
        table[["t_s", f"u{k}_V", f"z{k}"]].set_axis(["t_s", "u_V", "z"], axis=1) for k in (1, 2, 3)
    ]
    table = pd.concat(parts, keys=[1, 2, 3], names=["run"]).reset_index("run")
    return table[["z"]], _runs(table, inputs=table[["u_V"]])


def _box():
    table = read("incubator/thermostat_2023-05-01.csv")
    inputs = table[["heater_on", "T_room_degC"]]
    return table[["T_box_degC"]], {"t": table.t_s.to_numpy(), "inputs": inputs}


def _runs(table: pd.DataFrame, **options) -> dict:
    return {"t": table.t_s.to_numpy(), "groups": table.run.to_numpy(), **options}


# name: what the law lacks, kinds that say so, by hand, the data
CASES: dict[str, tuple[str, tuple[str, ...], str, Callable]] = {
    "pendulum": ("dry friction", FRICTION, ".119 → .028 rad", _pendulum),
    "motor": ("dead zone", ("dead_zone",), "26.6 → 4.9 rpm", _motor),
    "cart": ("dry friction, delay (weak)", (*FRICTION, *MEMORY), "hardly", _cart),
    "damper": ("backlash of x", ("backlash",), "1.80 → .69 kip", _damper),
    "throttle": (
        "stick, dry friction, end stop",
        ("stick", "end_stop", *FRICTION),
        ".0756 → .0368 rad",
        _throttle,
    ),
    "pneumatic seal": (
        "friction by direction, more of it under pressure",
        # dry friction, which a force may show to build up over a distance
        (*FRICTION, "dahl_friction", "load_friction"),
        "6.31 → 1.25 N",
        _pneumatic,
    ),
    "pipe": ("delay = mass / flow", MEMORY, "1.57 → .29 K", _pipe),
    "heater, A": ("lag", MEMORY, "2.20 → .54 K", lambda: _heaters(["A1", "A2"])),
    "heater, B": (
        "lag, coupling",
        (*MEMORY, "input_coupling"),
        ".88 → .60 K",
        lambda: _heaters(["B"]),
    ),
    "axis, motion": ("dry friction by direction", FRICTION, "13.6 → 5.1 mm", lambda: _axis(False)),
    "axis, force": ("dry friction by direction", FRICTION, "17 → 5.4 %", lambda: _axis(True)),
    "silverbox": ("cubic spring, no switch", ("polynomial",), "6.97 → 1.05 mV", _silverbox),
    "tanks": ("the upper tank, overflow", (*MEMORY, *LEVELS), ".617 → .268 V", _tanks),
    "MR damper": ("hysteresis", HYSTERESIS, "28 → 10 N", _hysteresis),
    "vehicle": ("dry friction or power law", (*FRICTION, "power_law"), ".178 → .096 m/s", _vehicle),
    "drives": ("absolute value of the sensor", (), "none", _drives),
    "incubator": ("lag of the heater", MEMORY, ".94 → .38 K", _box),
}
