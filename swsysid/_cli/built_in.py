"""The recordings that the command line simulates when no file is given."""

from __future__ import annotations

import numpy as np

from swsysid._cli.measurement import Measurement
from swsysid._tables.table import Table
from swsysid.datasets import make_damped_oscillator, make_undeclared

SENSOR_NOISE = 0.01  # in m and m/s


def oscillator(random_state: int) -> tuple[Table, Measurement]:
    """A damped oscillator, measured along trajectories with sensor noise."""
    data = make_damped_oscillator(None, n_trajectories=8, time_step=0.02, random_state=random_state)
    noise = np.random.default_rng(random_state).standard_normal(data.X.shape)
    x, v = (data.X + SENSOR_NOISE * noise).T
    columns = {"x": x, "v": v, "t": data.t, "trajectory": data.groups}
    table = Table("the built-in oscillator", columns, {"x": "m", "v": "m/s", "t": "s"})
    return table, Measurement(states=("x", "v"), time="t", groups="trajectory")


def oscillator_with_friction(random_state: int) -> tuple[Table, Measurement]:
    """A driven oscillator with two dampings and dry friction, which no linear law has."""
    data = make_undeclared("coulomb_friction", random_state=random_state)
    (x, v, u), (dx, dv) = data.X.T, data.Xdot.T
    columns = {"x": x, "v": v, "u": u, "dx": dx, "dv": dv, "t": data.t, "run": data.groups}
    units = {"x": "m", "v": "m/s", "u": "m/s^2", "dx": "m/s", "dv": "m/s^2", "t": "s"}
    table = Table("the built-in oscillator with dry friction", columns, units)
    measurement = Measurement(
        states=("x", "v"), inputs=("u",), derivatives=("dx", "dv"), time="t", groups="run"
    )
    return table, measurement
