"""Laws integrated along given states: the motion as a model draws it between the samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swsysid._data.records import Records
from swsysid._effect_model.joint_fit import JointFit
from swsysid._results import Array


def drawn(fit: JointFit, records: Records, modes: NDArray[np.intp], beside: Array) -> Array:
    """Integrals of the laws from the begin of each trajectory, (n_samples, n_states).

    What the effects add, (n_modes, n_samples, n_states), is `beside` the laws.

    Between two samples the states are the cubic through their values and velocities, inputs and
    what is beside the laws are linear, and the law is that of the mode at the end.
    """
    n_states, X, t = records.n_states, records.X, records.t
    assert t is not None
    first = np.concatenate([rows[:-1] for rows in records.trajectories])
    last = np.concatenate([rows[1:] for rows in records.trajectories])
    acting, step = modes[last], (t[last] - t[first])[:, None]
    at_samples, every = fit.declared_velocities(X) + beside, np.arange(len(acting))
    begin, end = at_samples[acting, first], at_samples[acting, last]
    middle = 0.5 * (X[first] + X[last])
    middle[:, :n_states] += 0.125 * step * (begin - end)
    inside = fit.declared_velocities(middle)[acting, every]
    inside += 0.5 * (beside[acting, first] + beside[acting, last])
    steps = step / 6.0 * (begin + 4.0 * inside + end)
    answer, done = np.zeros((len(records), n_states)), 0
    for rows in records.trajectories:
        own = steps[done : done + len(rows) - 1]
        answer[rows[1:]], done = np.cumsum(own, axis=0), done + len(own)
    return answer
