"""A search for effects as a picture: residuals, errors, the effect's shape, a rollout."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from swsysid._checks.arrays import table
from swsysid._checks.estimators import check_fitted
from swsysid._checks.parameters import shown, whole
from swsysid._data.records import make_records
from swsysid._displays.style import (
    PALETTE,
    Display,
    axis_label,
    frame_most,
    legend_above,
    mode_colour,
    thinned,
)
from swsysid._effect_search.contents import EffectContents, EffectData
from swsysid._effect_search.contributions import Shape
from swsysid._results import Array

_MOST_DOTS = 3000
_MOST_BARS = 24  # whose names can be read
_LONGEST_LABEL = 34  # letters on one line
_DECADES = 30.0  # errors that differ by a larger factor stand on a logarithmic axis

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# The two models that are compared: name and colour.
_MODELS = (("declared model", PALETTE[1]), ("with effects", PALETTE[0]))
_SPACES = {"columnspacing": 1.2, "handletextpad": 0.5}


@dataclass(frozen=True)
class Panels:
    """Draws parts of some data, labelled with units by the names that displays use."""

    data: EffectData
    units: Mapping[str, str] | None = None

    def residuals(self, ax: Axes, state: int) -> None:
        """Residual before and after over the time of the held-out rows."""
        x, edges, label = self._held_out_axis()
        self._before_and_after(ax, state, x, label)
        for edge in edges:
            ax.axvline(edge, color="0.75", linewidth=0.8, zorder=0)

    def against(self, ax: Axes, state: int, channel: int) -> None:
        """Residual before and after over a channel, on one scale."""
        x = self.data.records.channel(channel)[self.data.rows]
        label = axis_label(self.data.records.names[channel], self.units)
        self._before_and_after(ax, state, x, label)

    def _before_and_after(self, ax: Axes, state: int, x: Array, label: str) -> None:
        before, after = (one[:, state] for one in self.data.residuals)
        shown = np.flatnonzero(np.isfinite(x))
        shown = shown[thinned(len(shown), _MOST_DOTS)]
        for values, (name, colour) in zip((before, after), _MODELS, strict=True):
            ax.scatter(
                x[shown], values[shown], color=colour, alpha=0.7, label=name, s=7, linewidths=0
            )
        ax.axhline(0.0, color="0.2", linewidth=1.0)
        frame_most(ax, before, 0.05, whole=after)
        ax.set(xlabel=label, ylabel=_wrapped(f"residual of {self._rate(state)}"))
        legend_above(ax, 2, markerscale=2.5, **_SPACES)

    def trajectory_errors(self, ax: Axes, state: int) -> None:
        """Root mean square error of each held-out trajectory, the largest first."""
        listed = sorted(self.data.by_trajectory, key=lambda one: -one.before[state])
        left_out = len(listed) > _MOST_BARS
        listed = listed[:_MOST_BARS]
        places = np.arange(len(listed))
        sizes = np.array([[one.before[state], one.after[state]] for one in listed]).T
        for values, shift, (name, colour) in zip(sizes, (-0.2, 0.2), _MODELS, strict=True):
            ax.bar(places + shift, values, 0.4, color=colour, label=name)
        positive = sizes[sizes > 0]
        if len(positive) and sizes.max() > _DECADES * positive.min():
            ax.set_yscale("log")
        names = [one.trajectory for one in listed]
        many = len(names) > 6 or max(map(len, names)) > 8
        ax.set_xticks(places, names, rotation=60 if many else 0, ha="right" if many else "center")
        if many:
            ax.tick_params(axis="x", labelsize=10)
        ax.set(
            xlabel="trajectory" + (f" (the worst {_MOST_BARS})" if left_out else ""),
            ylabel=_wrapped(f"RMS error of {self._rate(state)}"),
        )
        room = max(0.7, 0.5 * (5 - len(listed)))
        ax.set_xlim(-room, len(listed) - 1 + room)
        legend_above(ax, 2, **_SPACES)

    def shape(self, ax: Axes, place: int) -> None:
        """Contribution of an effect along its channel, its band, and what the data ask for."""
        shape = self.data.shapes[place]
        shown = thinned(len(shape.values), _MOST_DOTS)
        values, wanted = shape.values[shown], shape.wanted[shown]
        many, label = len(values) > 1000, "wanted by the data"
        ax.scatter(
            values, wanted, color="0.6", alpha=0.5, label=label, rasterized=many, s=7, linewidths=0
        )
        modes = np.unique(shape.modes)
        for position, mode in enumerate(modes):
            name = "effect" if len(modes) == 1 else f"mode {mode}"
            band = "95 %" if position == 0 else None
            _draw_contribution(ax, shape, shape.modes == mode, mode_colour(position), name, band)
        frame_most(ax, shape.wanted, 0.08, whole=shape.contribution)
        ax.set(
            xlabel=axis_label(shape.axis, self.units),
            ylabel=_wrapped(f"share of {self._rate(shape.target)}") + _held_where(shape),
        )
        legend_above(ax, 4, markerscale=2.5, **_SPACES)

    def rollout(self, ax: Axes, number: int, state: int) -> None:
        """One measured trajectory and its two simulations."""
        rollout = self.data.rollouts[number]
        t, measured = rollout.t - rollout.t[0], rollout.measured[:, state]
        ax.plot(t, measured, color="black", linewidth=3.0, alpha=0.35, label="measured")
        lines = ((0, (4, 2)), "-")
        for run, line, (name, colour) in zip(
            (rollout.before, rollout.after), lines, _MODELS, strict=True
        ):
            values = run[:, state]
            reached = t[: len(values)]
            ax.plot(reached, values, linestyle=line, color=colour, linewidth=1.8, label=name)
            if 0 < len(values) < len(t):
                ax.plot(reached[-1], values[-1], "x", color=colour, markersize=10)
        # A simulation that runs away must not stretch the axis.
        low, high = measured.min(), measured.max()
        room = 0.75 * (high - low)
        if room > 0.0:
            bottom, top = ax.get_ylim()
            ax.set_ylim(max(bottom, low - room), min(top, high + room))
        ax.set(
            xlabel=axis_label("time", self.units),
            ylabel=axis_label(self.data.names[state], self.units),
        )
        legend_above(ax, 3, **_SPACES)

    def _rate(self, state: int) -> str:
        """Label of what an equation gives, with its unit."""
        name = self.data.names[state]
        if self.data.discrete:
            return f"next {axis_label(name, self.units)}"
        if self.data.records.static:
            return axis_label(name, self.units)
        return axis_label(f"d/dt {name}", self.units)

    def _held_out_axis(self) -> tuple[Array, list[float], str]:
        """Where each held-out row is drawn, where trajectories meet, and the label of the axis."""
        # Over time, one trajectory after the other if there are several; over row numbers where the
        # times are not known.
        data, records, n_rows = self.data, self.data.records, len(self.data.rows)
        if not data.stretches or records.t is None:
            return np.arange(n_rows, dtype=float), [], "held-out row"
        time = axis_label("time", self.units)
        if records.timed and len(records.trajectories) == 1:
            return records.t[data.rows], [], time
        x, edges, start = np.full(n_rows, np.nan), [], 0.0
        for _, part in data.stretches:
            t = records.t[data.rows[part]] if records.timed else np.arange(len(part), dtype=float)
            step = float(np.median(np.diff(t))) if len(t) > 1 else 1.0
            x[part] = start + t - t[0]
            start += float(t[-1] - t[0]) + step
            edges.append(start - 0.5 * step)
        what = time if records.timed else "held-out row"
        return x, edges[:-1], f"{what}, trajectory after trajectory"


def _draw_contribution(
    ax: Axes, shape: Shape, rows: NDArray[np.bool_], colour: str, name: str, band: str | None
) -> None:
    values, middle, half = shape.values[rows], shape.contribution[rows], shape.half_width[rows]
    if not shape.is_function:
        ax.scatter(values, middle, s=9, color=colour, linewidths=0, label=name)
        return
    # A gap wherever the contribution jumps, so that a step is not drawn as a slope.
    jumps, span = np.abs(np.diff(middle)), np.ptp(middle)
    if span:
        edges = np.flatnonzero(jumps > max(0.25 * span, 20 * np.median(jumps))) + 1
        values, middle, half = (np.insert(one, edges, np.nan) for one in (values, middle, half))
    if np.isfinite(half).any():
        low, high = middle - half, middle + half
        ax.fill_between(values, low, high, color=colour, alpha=0.3, linewidth=0, label=band)
    ax.plot(values, middle, color="white", linewidth=4.0)
    ax.plot(values, middle, color=colour, linewidth=2.2, label=name)


def _held_where(shape: Shape) -> str:
    """A line of the axis label for the value of another channel that the shape is told for."""
    return f"\nwhere {shape.where}" if shape.where else ""


def _wrapped(label: str) -> str:
    """A long axis label on two lines."""
    return label.replace(" of ", " of\n", 1) if len(label) > _LONGEST_LABEL else label


@dataclass(kw_only=True, eq=False, repr=False)
class EffectReportDisplay(Display):
    """Before and after: four panels, or as many of them as the data allow.

    Residual of the declared model and of the one with the effects over the held-out rows; their
    error on each trajectory; what an effect contributes along its channel, with its 95 %
    confidence band and what the data ask of it (the residual without the effect); and, of the
    trajectories simulated from their first states by both models, the one on which the declared
    model is worst.

    Use `from_report`, the report's own ``plot``, or `from_estimator` for other data.

    Parameters
    ----------
    data : EffectData
    state : int
        State whose velocity (or next value) is shown.
    effect : int or None
        Number of the effect whose shape is shown.
    units : mapping from names to units, default=None

    Attributes
    ----------
    ax_ : ndarray of matplotlib Axes
    figure_ : matplotlib Figure

    Examples
    --------
    >>> import matplotlib; matplotlib.use("Agg")
    >>> from swsysid import EffectSearchCV
    >>> from swsysid.datasets import make_undeclared
    >>> from swsysid.effects import CoulombFriction
    >>> from swsysid.plotting import EffectReportDisplay
    >>> data = make_undeclared("coulomb_friction", system="pendulum", random_state=0)
    >>> search = EffectSearchCV(data.estimator, effects=[CoulombFriction()])
    >>> search = search.fit(data.X, data.Xdot, t=data.t, groups=data.groups)
    >>> test = data.test
    >>> display = EffectReportDisplay.from_estimator(
    ...     search, test.X, test.Xdot, t=test.t, groups=test.groups)
    >>> display.ax_[2].get_xlabel()
    'x1'
    """

    data: EffectData
    state: int
    effect: int | None = None
    units: Mapping[str, str] | None = None

    _panel_size, _n_columns = (6.2, 4.4), 2

    @classmethod
    def from_estimator(
        cls,
        search,
        X,
        Xdot,
        *,
        t=None,
        groups=None,
        signals=None,
        equation=None,
        effect=None,
        units=None,
        ax=None,
    ):
        """Draw the declared and the final model of a search on data, best on fresh ones.

        Parameters
        ----------
        search : EffectSearchCV
        X : array-like of shape (n_samples, n_states + n_inputs)
        Xdot : array-like of shape (n_samples,) or (n_samples, n_states)
        t, groups : array-like of shape (n_samples,), default=None
        signals : array-like of shape (n_samples, n_signals), default=None
        equation : str, default=None
            The state that is shown, by name; the one in which the effect acts if None.
        effect : int, default=None
            Number of the effect whose shape is shown, from 0; the most important one if None.
        units : mapping from names to units, default=None
            A velocity has the unit of its state by that of ``"time"`` (s), unless its name
            ``"d/dt x"`` gives another one.
        ax : array of matplotlib Axes, default=None
            One for each panel; a new figure if None.

        Returns
        -------
        EffectReportDisplay
        """
        check_fitted(search, "report_")
        known = search.report_.data
        if known is None:
            raise ValueError(_NOTHING)
        targets = table("Xdot", Xdot, n_columns=known.targets.shape[1])
        records = make_records(
            table("X", X, len(targets), known.records.X.shape[1]),
            targets.shape[1],
            t=t,
            groups=groups,
            signals=signals,
            names=known.records.names[: known.records.X.shape[1]],
        )
        data = EffectData(
            records=records,
            rows=np.arange(len(records)),
            samples=np.arange(len(records)),
            targets=targets,
            models=(search.declared_estimator_, search.best_estimator_),
            final=search.best_estimator_,
            covariances=known.covariances,
            trajectory_names=None if groups is None else np.unique(groups),
        )
        return cls._of(data, equation, effect, units).plot(ax=ax)

    @classmethod
    def from_report(
        cls,
        report: EffectContents,
        *,
        equation: str | None = None,
        effect: int | None = None,
        units: Mapping[str, str] | None = None,
        ax=None,
    ) -> Self:
        """Draw what an `EffectReport` says of the held-out rows.

        Parameters
        ----------
        report : EffectReport
        equation, effect, units, ax
            As in `from_estimator`.

        Returns
        -------
        EffectReportDisplay
        """
        if not isinstance(report, EffectContents):
            raise TypeError(f"report={shown(report)} is none; give report_ of an EffectSearchCV.")
        if report.data is None:
            raise ValueError(_NOTHING)
        return cls._of(report.data, equation, effect, units).plot(ax=ax)

    @classmethod
    def _of(cls, data, equation, effect, units):
        n_effects = len(data.covariances)
        if whole("effect", effect, least=0, also=(None,)) not in (None, *range(n_effects)):
            raise ValueError(f"effect={effect} is too large; give a number below {n_effects}.")
        named = isinstance(equation, str) and equation in data.names
        if equation is not None and not named:
            raise ValueError(
                f"equation={shown(equation)} is unknown; choose among {', '.join(data.names)}."
            )
        chosen = 0 if effect is None and n_effects else effect
        if equation is not None:
            state = data.names.index(equation)
        else:
            state = data.most_changed if chosen is None else data.shapes[chosen].target
        return cls(data=data, state=state, effect=chosen, units=units)

    def _panels(self):
        panels, data, state = Panels(self.data, self.units), self.data, self.state
        drawn = [partial(panels.residuals, state=state)]
        if data.by_trajectory:
            drawn.append(partial(panels.trajectory_errors, state=state))
        if self.effect is not None:
            drawn.append(partial(panels.shape, place=self.effect))
        if data.rollouts:
            errors = [rollout.errors[0][state] for rollout in data.rollouts]
            worst = int(np.nanargmax(errors)) if np.isfinite(errors).any() else 0
            drawn.append(partial(panels.rollout, number=worst, state=state))
        return drawn


_NOTHING = "The record was too short to hold any of it out: there is nothing to draw."
