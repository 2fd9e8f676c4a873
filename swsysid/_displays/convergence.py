"""How the alternation converged: objective, modes and tightness by iteration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from swsysid._checks.arrays import labels
from swsysid._checks.estimators import check_fitted
from swsysid._displays.style import Display
from swsysid.metrics import mode_accuracy

# A quantity that falls by more than this factor is drawn on a logarithmic axis.
_LOG_RANGE = 100.0
# What falls below this share of its first value is as good as zero; its size is rounding.
_ZERO = 1e-6


@dataclass(kw_only=True, eq=False, repr=False)
class ConvergenceDisplay(Display):
    """Three panels over the iterations: objective, mode changes, tightness ratio.

    Use `from_estimator`; call `plot` of a second display with ``ax=first.ax_`` to compare two
    relaxations in the same panels.

    Parameters
    ----------
    iterations : ndarray of shape (n_iterations,)
    objective : ndarray of shape (n_iterations,)
        The joint objective J.
    mode_changes : ndarray of shape (n_iterations,)
        Samples whose label differs from the previous iteration's, or from the truth.
    tightness : ndarray of shape (n_iterations,)
        Fraction of samples at which the relaxation itself was one-hot.
    mode_label : str, default="mode changes"
        What `mode_changes` counts.

    Attributes
    ----------
    ax_ : ndarray of 3 matplotlib Axes
    figure_ : matplotlib Figure

    Examples
    --------
    >>> import matplotlib; matplotlib.use("Agg")
    >>> from swsysid.plotting import ConvergenceDisplay
    >>> display = ConvergenceDisplay(
    ...     iterations=[1, 2, 3], objective=[9.0, 1.0, 1e-6], mode_changes=[70, 5, 0],
    ...     tightness=[0.6, 0.95, 1.0])
    >>> display.plot().ax_[0].get_yscale()
    'log'
    """

    iterations: Sequence[int]
    objective: Sequence[float]
    mode_changes: Sequence[int]
    tightness: Sequence[float]
    mode_label: str = "mode changes"

    _panel_size = (4.3, 3.6)

    @classmethod
    def from_estimator(cls, estimator, *, modes=None, ax=None, **kwargs):
        """Read ``history_`` of a fitted estimator and draw it.

        Parameters
        ----------
        estimator : SwitchingSystemRegressor
        modes : array-like of shape (n_samples,), default=None
            True modes of the training samples: the second panel then counts the samples in the
            wrong mode (matched to the identified ones as well as possible) after each iteration.
        ax : array of 3 matplotlib Axes, default=None
        **kwargs
            Passed to ``ax.plot``; ``label`` names the curve in the legend.

        Returns
        -------
        ConvergenceDisplay
        """
        check_fitted(estimator, "history_")
        history = estimator.history_
        label, changes = "mode changes", [record.mode_changes for record in history]
        if modes is not None:
            modes = labels("modes", modes, len(estimator.modes_))
            label = "mode mismatch"
            changes = [
                round(len(modes) * (1.0 - mode_accuracy(modes, record.modes))) for record in history
            ]
        return cls(
            iterations=np.array([record.iteration for record in history]),
            objective=np.array([record.objective for record in history]),
            mode_changes=np.array(changes),
            tightness=np.array([record.tightness for record in history]),
            mode_label=label,
        ).plot(ax=ax, **kwargs)

    def _panels(self, **kwargs):
        panels = (
            ("objective", self.objective, self._frame_objective),
            (self.mode_label, self.mode_changes, _frame_changes),
            ("tightness ratio", self.tightness, lambda ax: ax.set_ylim(-0.03, 1.05)),
        )
        return [partial(self._draw_curve, *panel, **kwargs) for panel in panels]

    def _draw_curve(self, name, values, frame, ax, **style):
        ax.plot(self.iterations, values, **{"marker": "o", "markersize": 5, **style})
        ax.set(xlabel="iteration", ylabel=name)
        ax.xaxis.get_major_locator().set_params(integer=True)
        frame(ax)
        if name == "objective" and "label" in style:
            ax.legend()

    def _frame_objective(self, ax):
        values = np.asarray(self.objective, dtype=float)
        zero = _ZERO * values.max()
        if values.max() <= _LOG_RANGE * max(values.min(), zero):
            return
        ax.set_yscale("log")
        if values.min() < zero:
            ax.set_ylim(bottom=zero)
            place = {"xycoords": "axes fraction", "textcoords": "offset points", "xytext": (-4, 4)}
            look = {"ha": "right", "color": "0.4", "fontsize": 10}
            ax.annotate("below: rounding only", (1.0, 0.0), **place, **look)


def _frame_changes(ax):
    # of all curves in the panel, those of an earlier display included
    most = max(np.max(line.get_ydata()) for line in ax.get_lines())
    ax.set_ylim(0.0, 1.05 * max(most, 1.0))
