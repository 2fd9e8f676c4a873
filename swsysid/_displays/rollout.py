"""Rollouts of the identified system beside the measured trajectories, and their error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from swsysid._checks.estimators import check_fitted
from swsysid._checks.parameters import shown, whole
from swsysid._data.trajectories import group_labels, increasing_times, trajectories
from swsysid._displays.style import (
    PALETTE,
    Display,
    axis_label,
    legend_above,
    read,
    resolve_column,
)


@dataclass(kw_only=True, eq=False, repr=False)
class RolloutDisplay(Display):
    """Two panels: trajectories, identified and measured; and the error over time.

    Use `from_estimator`. With two features the trajectories are drawn in their plane, from the
    dot on, with one over time. The error is the Euclidean norm of the difference of the states.

    Parameters
    ----------
    times : list of ndarray of shape (n_times,)
        Times since the start of each trajectory.
    measured, simulated : list of ndarray of shape (n_times, n_states)
        A rollout that stopped early is shorter than its measured trajectory.
    columns : sequence of 1 or 2 int
        The states that are drawn.
    labels : sequence of str
        Their axis labels.
    time_label : str, default="time (s)"

    Attributes
    ----------
    ax_ : ndarray of 2 matplotlib Axes
    figure_ : matplotlib Figure

    Examples
    --------
    >>> import matplotlib; matplotlib.use("Agg")
    >>> import numpy as np
    >>> from swsysid.plotting import RolloutDisplay
    >>> t = np.linspace(0, 6, 50)
    >>> x = np.column_stack([np.cos(t), -np.sin(t)])
    >>> display = RolloutDisplay(times=[t], measured=[x], simulated=[x + 0.01 * t[:, None]],
    ...                          columns=(0, 1), labels=("x", "v"))
    >>> display.plot().ax_[1].get_ylabel()
    'error norm'
    """

    times: list[NDArray]
    measured: list[NDArray]
    simulated: list[NDArray]
    columns: Sequence[int]
    labels: Sequence[str]
    time_label: str = "time (s)"

    @classmethod
    def from_estimator(
        cls,
        estimator,
        X,
        t,
        *,
        groups=None,
        features=None,
        max_rollouts=5,
        input_hold="zero",
        names=None,
        units=None,
        ax=None,
        **kwargs,
    ):
        """Simulate from the first state of every trajectory and draw.

        Parameters
        ----------
        estimator : SwitchingSystemRegressor
        X : array-like or data frame of shape (n_samples, n_states + n_inputs)
            Measured states, then inputs, rows of one trajectory in time order.
        t : array-like of shape (n_samples,)
            Times, in s unless `units` say otherwise.
        groups : array-like of shape (n_samples,), default=None
            The trajectory of each row; one trajectory if None.
        features : sequence of 1 or 2 int or str, default=None
            The states that are drawn; the first two, or the only one, if None.
        max_rollouts : int, default=5
            Simulate and draw the first so many trajectories; more of them hide one another.
        input_hold : {"zero", "linear"}, default="zero"
        names : sequence of str, default=None
            Names of the columns of `X`.
        units : mapping from names to units, default=None
            That of the times is named ``"time"``.
        ax : array of 2 matplotlib Axes, default=None
        **kwargs
            Passed to ``ax.plot`` for the identified trajectories.

        Returns
        -------
        RolloutDisplay
        """
        check_fitted(estimator, "coef_")
        whole("max_rollouts", max_rollouts)
        X, names = read(estimator, X, names)
        groups = group_labels(groups, len(X))
        t, n_states = increasing_times(t, groups), estimator.coef_.shape[1]
        features = range(min(n_states, 2)) if features is None else features
        if isinstance(features, str) or not np.iterable(features):
            raise TypeError(f"features={shown(features)} must be a list of one or two states.")
        columns = [resolve_column(feature, names) for feature in features]
        if len(columns) not in (1, 2) or max(columns) >= n_states:
            raise ValueError(
                f"features={features}; name one or two of the states {', '.join(names[:n_states])}."
            )
        times, measured, simulated = [], [], []
        for _, rows in trajectories(groups)[:max_rollouts]:
            states, inputs = X[rows, :n_states], X[rows, n_states:]
            driven = {"inputs": inputs if inputs.shape[1] else None, "input_hold": input_hold}
            rollout = estimator.simulate(states[0], t[rows], **driven)
            times.append(t[rows] - t[rows[0]])
            measured.append(states)
            simulated.append(rollout.x)
        display = cls(
            times=times,
            measured=measured,
            simulated=simulated,
            columns=columns,
            labels=[axis_label(names[column], units) for column in columns],
            time_label=axis_label("time", {"time": "s", **(units or {})}),
        )
        return display.plot(ax=ax, **kwargs)

    @property
    def errors(self):
        """Norm of the error over time, a list of ndarray of shape (n_times,)."""
        return [
            np.linalg.norm(simulated - measured[: len(simulated)], axis=1)
            for simulated, measured in zip(self.simulated, self.measured, strict=True)
        ]

    def _panels(self, **kwargs):
        return [partial(self._draw_trajectories, **kwargs), self._draw_errors]

    def _draw_trajectories(self, ax, **kwargs):
        style = {"color": PALETTE[0], "linewidth": 1.6, **kwargs}
        # a broad pale line beneath the thin dark one: both are seen where they agree
        broad = {"color": "0.75", "linewidth": 5.0, "solid_capstyle": "round", "zorder": 1}
        hidden = ""  # the legend leaves out what begins with an underscore
        for t, measured, simulated in zip(self.times, self.measured, self.simulated, strict=True):
            ax.plot(*self._path(t, simulated), label=f"{hidden}identified", **style)
            ax.plot(*self._path(t, measured), label=f"{hidden}measured", **broad)
            hidden = "_"
            if len(self.columns) == 2:
                ax.plot(*measured[0, self.columns], "o", color="black", markersize=5)
        xlabel = self.time_label if len(self.columns) == 1 else self.labels[0]
        ax.set(xlabel=xlabel, ylabel=self.labels[-1])
        legend_above(ax, 2)

    def _path(self, t, x):
        path = [x[:, column] for column in self.columns]
        return path if len(path) == 2 else [t[: len(x)], *path]

    def _draw_errors(self, ax):
        for t, error in zip(self.times, self.errors, strict=True):
            # the first state is given: its error is zero and has no place on a log axis
            ax.plot(t[1 : len(error)], error[1:], color=PALETTE[1], alpha=0.6, linewidth=1.4)
        ax.set(xlabel=self.time_label, ylabel="error norm")
        if any((error[1:] > 0).any() for error in self.errors):
            ax.set_yscale("log")
