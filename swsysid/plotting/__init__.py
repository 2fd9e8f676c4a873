"""Displays in scikit-learn's manner: ``from_estimator`` computes, ``plot`` draws."""

from swsysid.plotting._convergence import ConvergenceDisplay
from swsysid.plotting._diagnosis import ResidualReportDisplay
from swsysid.plotting._effects import EffectReportDisplay
from swsysid.plotting._residual import ResidualDisplay
from swsysid.plotting._rollout import RolloutDisplay
from swsysid.plotting._style import PALETTE, STYLE
from swsysid.plotting._surface import SwitchingSurfaceDisplay
from swsysid.plotting._timeline import ModeTimelineDisplay

__all__ = [
    "PALETTE",
    "STYLE",
    "ConvergenceDisplay",
    "EffectReportDisplay",
    "ModeTimelineDisplay",
    "ResidualDisplay",
    "ResidualReportDisplay",
    "RolloutDisplay",
    "SwitchingSurfaceDisplay",
]
