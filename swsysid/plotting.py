"""Displays in scikit-learn's manner: ``from_estimator`` computes, ``plot`` draws."""

from swsysid._displays.automaton_graph import AutomatonGraphDisplay
from swsysid._displays.convergence import ConvergenceDisplay
from swsysid._displays.residual import ResidualDisplay
from swsysid._displays.rollout import RolloutDisplay
from swsysid._displays.surface import SwitchingSurfaceDisplay
from swsysid._displays.timeline import ModeTimelineDisplay
from swsysid._effect_search.display import EffectReportDisplay
from swsysid._rendering.series import PALETTE, STYLE
from swsysid._residual_report.display import ResidualReportDisplay

__all__ = [
    "PALETTE",
    "STYLE",
    "AutomatonGraphDisplay",
    "ConvergenceDisplay",
    "EffectReportDisplay",
    "ModeTimelineDisplay",
    "ResidualDisplay",
    "ResidualReportDisplay",
    "RolloutDisplay",
    "SwitchingSurfaceDisplay",
]
