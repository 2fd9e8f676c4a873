"""What a fitted model leaves over, and what the leftover depends on."""

from swsysid._effect_search.contents import EffectData, TrajectoryError
from swsysid._effect_search.report import EffectReport
from swsysid._effect_search.rollouts import Rollout
from swsysid._effect_search.search import EffectSearchCV
from swsysid._residual_report.contents import ReportData
from swsysid._residual_report.findings import Finding, Peak
from swsysid._residual_report.noise_floor import NoiseFloor, Size, noise_floor
from swsysid._residual_report.report import ResidualReport, residual_report
from swsysid._residual_report.whiteness import Whiteness, WhitenessTest, whiteness_test
from swsysid._verdict.rows import switching_verdict

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
    "switching_verdict",
    "whiteness_test",
]
