"""What a fitted model leaves over, and what the leftover depends on."""

from swsysid.diagnosis._effect_data import EffectData, TrajectoryError
from swsysid.diagnosis._effect_report import EffectReport
from swsysid.diagnosis._effect_rollouts import Rollout
from swsysid.diagnosis._effect_search import EffectSearchCV
from swsysid.diagnosis._noise_floor import NoiseFloor, noise_floor
from swsysid.diagnosis._records import Finding, Peak, Size, Whiteness
from swsysid.diagnosis._report import ReportData, ResidualReport
from swsysid.diagnosis._residuals import residual_report
from swsysid.diagnosis._whiteness import WhitenessTest, whiteness_test

__all__ = [
    "EffectData",
    "EffectReport",
    "EffectSearchCV",
    "Finding",
    "NoiseFloor",
    "Peak",
    "ReportData",
    "ResidualReport",
    "Rollout",
    "Size",
    "TrajectoryError",
    "Whiteness",
    "WhitenessTest",
    "noise_floor",
    "residual_report",
    "whiteness_test",
]
