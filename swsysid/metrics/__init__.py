"""How good is an identified switching system: modes, velocities, rollouts, surfaces, scorers."""

from swsysid.metrics._errors import RolloutErrors, rollout_errors, surface_distance, velocity_rmse
from swsysid.metrics._modes import (
    ModeReliability,
    balanced_mode_accuracy,
    match_modes,
    mode_accuracy,
    mode_iou,
    mode_reliability,
)
from swsysid.metrics._scorers import mode_accuracy_scorer, mode_consistency_scorer

__all__ = [
    "ModeReliability",
    "RolloutErrors",
    "balanced_mode_accuracy",
    "match_modes",
    "mode_accuracy",
    "mode_accuracy_scorer",
    "mode_consistency_scorer",
    "mode_iou",
    "mode_reliability",
    "rollout_errors",
    "surface_distance",
    "velocity_rmse",
]
