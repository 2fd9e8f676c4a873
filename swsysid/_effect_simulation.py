"""Rollouts of a switching model with effects beside it."""

from __future__ import annotations

from swsysid._search.joint_fit import JointFit, switching_step

__all__ = ["simulate_with_effects"]


def simulate_with_effects(fit: JointFit, x0, t, inputs=None, *, signals=None, **options):
    """Roll the system out from a state."""
    return switching_step(fit.estimator)[1].simulate(x0, t, inputs, **options)
