"""Which mode was active when: one bar a trajectory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._checks.estimators import check_fitted
from swsysid._checks.parameters import shown, whole
from swsysid._data.trajectories import group_labels, increasing_times, trajectories
from swsysid._displays.style import (
    Display,
    legend_above,
    mode_colour,
    mode_names,
    named_as_predicted,
    predicted_modes,
)
from swsysid._results import Trajectory


@dataclass(kw_only=True, eq=False, repr=False)
class ModeTimelineDisplay(Display):
    """One bar a trajectory, coloured by the active mode; the true modes beneath, if known.

    Use `from_estimator`, or `from_trajectory` for what was simulated.

    Parameters
    ----------
    times : list of ndarray of shape (n_times,)
        Times in s.
    modes : list of ndarray of shape (n_times,)
        Identified modes.
    true_modes : list of ndarray of shape (n_times,), or None
    groups : list
        Names of the trajectories.
    classes : list
        Names of the modes.

    Attributes
    ----------
    ax_ : matplotlib Axes
    figure_ : matplotlib Figure

    Examples
    --------
    >>> import matplotlib; matplotlib.use("Agg")
    >>> import numpy as np
    >>> from swsysid.plotting import ModeTimelineDisplay
    >>> display = ModeTimelineDisplay(
    ...     times=[np.arange(4.0)], modes=[np.array([0, 0, 1, 1])], true_modes=None,
    ...     groups=["run"], classes=[0, 1])
    >>> [label.get_text() for label in display.plot().ax_.get_yticklabels()]
    ['run']
    """

    times: list[NDArray]
    modes: list[NDArray]
    true_modes: list[NDArray] | None
    groups: list
    classes: list

    _one_panel = True

    @classmethod
    def from_estimator(
        cls, estimator, X, t, *, groups=None, modes=None, max_trajectories=12, ax=None, **kwargs
    ):
        """Predict the modes along the trajectories and draw them.

        Parameters
        ----------
        estimator : SwitchingSystemRegressor or classifier
        X : array-like or data frame of shape (n_samples, n_features)
            Rows of one trajectory in time order.
        t : array-like of shape (n_samples,)
            Times in s.
        groups : array-like of shape (n_samples,), default=None
            The trajectory of each row; one trajectory if None.
        modes : array-like of shape (n_samples,), default=None
            True modes; relabelled to agree best with the identified ones.
        max_trajectories : int, default=12
        ax : matplotlib Axes, default=None
        **kwargs
            Passed to ``ax.broken_barh``.

        Returns
        -------
        ModeTimelineDisplay
        """
        check_fitted(estimator)
        whole("max_trajectories", max_trajectories)
        predicted = predicted_modes(estimator, X)
        groups = group_labels(groups, len(predicted))
        t, chosen = increasing_times(t, groups), trajectories(groups)[:max_trajectories]
        named = named_as_predicted(modes, predicted)
        display = cls(
            times=[t[rows] for _, rows in chosen],
            modes=[predicted[rows] for _, rows in chosen],
            true_modes=None if modes is None else [named[rows] for _, rows in chosen],
            groups=[name for name, _ in chosen],
            classes=mode_names(predicted, named),
        )
        return display.plot(ax=ax, **kwargs)

    @classmethod
    def from_trajectory(cls, trajectory, *, names=None, ax=None, **kwargs):
        """Draw the modes of simulated trajectories, with their switches where they happened.

        Parameters
        ----------
        trajectory : Trajectory or list of Trajectory
            What `simulate` of a model returned.
        names : list, default=None
            The names of the trajectories; their numbers if None.
        ax : matplotlib Axes, default=None
        **kwargs
            Passed to ``ax.broken_barh``.

        Returns
        -------
        ModeTimelineDisplay

        Raises
        ------
        TypeError
            If something else than trajectories is given.
        ValueError
            If there are not as many names, or if a trajectory has no times.

        Examples
        --------
        >>> import matplotlib; matplotlib.use("Agg")
        >>> from swsysid import HybridAutomaton
        >>> from swsysid.plotting import ModeTimelineDisplay
        >>> timer = HybridAutomaton.stated(
        ...     [{"x": "1"}, {"x": "-1"}], [(0, 1, "dwell >= 2"), (1, 0, "x <= 0")], states=["x"]
        ... )
        >>> rollout = timer.simulate([0.0], [0.0, 5.0], mode=0)
        >>> ModeTimelineDisplay.from_trajectory(rollout).modes
        [array([0, 0, 1, 1, 0, 0])]
        """
        listed = [trajectory] if isinstance(trajectory, Trajectory) else trajectory
        are_trajectories = isinstance(listed, (list, tuple)) and all(
            isinstance(one, Trajectory) for one in listed
        )
        if not are_trajectories or not listed:
            raise TypeError(
                f"trajectory={shown(trajectory)} must be a Trajectory or a list of them."
            )
        names = list(range(len(listed))) if names is None else list(names)
        if len(names) != len(listed) or not all(len(one.t) for one in listed):
            raise ValueError(
                f"names holds {len(names)} entries for {len(listed)} trajectories; give one for "
                "each, and only trajectories that have times."
            )
        stays = [_with_instants(one) for one in listed]
        display = cls(
            times=[times for times, _ in stays],
            modes=[modes for _, modes in stays],
            true_modes=None,
            groups=names,
            classes=sorted({mode for _, modes in stays for mode in modes.tolist()}),
        )
        return display.plot(ax=ax, **kwargs)

    @property
    def _panel_size(self):
        return 8.0, 1.6 + 0.45 * len(self.groups)

    def _draw(self, ax, **kwargs):
        top = 0.8 if self.true_modes is None else 0.5
        for row, (t, modes) in enumerate(zip(self.times, self.modes, strict=True)):
            self._bar(ax, t, modes, row - 0.4, top, **kwargs)
            if self.true_modes is not None:
                true = {"alpha": 0.5, **kwargs}
                self._bar(ax, t, self.true_modes[row], row + 0.15, 0.25, **true)
        ax.set_yticks(range(len(self.groups)), [str(name) for name in self.groups])
        ax.invert_yaxis()
        ax.set(xlabel="time (s)", ylabel="trajectory")
        self._legend(ax)

    def _bar(self, ax, t, modes, bottom, height, **kwargs):
        # Each sample holds from the middle of the interval before it to that after it.
        edges = np.r_[t[0], (t[1:] + t[:-1]) / 2, t[-1]]
        starts = np.flatnonzero(np.r_[True, modes[1:] != modes[:-1]])
        stops = np.r_[starts[1:], len(modes)]
        colours = [mode_colour(self.classes.index(mode)) for mode in modes[starts]]
        spans = list(zip(edges[starts], edges[stops] - edges[starts], strict=True))
        ax.broken_barh(spans, (bottom, height), facecolors=colours, linewidth=0, **kwargs)

    def _legend(self, ax):
        from matplotlib.patches import Patch

        handles = [
            Patch(color=mode_colour(position), label=f"mode {label}")
            for position, label in enumerate(self.classes)
        ]
        if self.true_modes is not None:
            handles.append(Patch(color="0.6", label="thin bar: true modes"))
        legend_above(ax, len(handles), handles=handles)


def _with_instants(trajectory: Trajectory) -> tuple[NDArray, NDArray]:
    """Times and modes of a trajectory, with each instant of a switch before and after it."""
    # a slide keeps the mode that it came from
    switches = [one for one in trajectory.events if one.kind != "sliding"]
    switches = [one for one in switches if one.time <= trajectory.t[-1]]
    instants = [one.time for one in switches for _ in range(2)]
    sides = [mode for one in switches for mode in (one.before, one.after)]
    rows = ~np.isin(trajectory.t, instants)
    times = np.concatenate([trajectory.t[rows], instants])
    order = np.argsort(times, kind="stable")
    return times[order], np.concatenate([trajectory.modes[rows], sides])[order].astype(np.intp)
