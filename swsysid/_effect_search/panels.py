"""Panels that show what an effect changes, each drawn on axes of its own."""

from __future__ import annotations

from typing import Any

import numpy as np

from swsysid._displays.style import PALETTE, axis_label, mode_colour

__all__ = [
    "draw_rollout",
    "draw_shape",
    "draw_residuals",
    "draw_trajectory_errors",
    "rate_label",
]

BEFORE, AFTER = PALETTE[1], PALETTE[0]
_MOST_BARS = 24
_MOST_DOTS = 3000
_LONG = 34
_DECADES = 30.0  # errors that differ by more than this factor stand on a logarithmic axis


def rate_label(data: Any, state: int, units=None) -> str:
    """Axis label of a velocity, or of a next state, with its unit."""
    name = data.names[state]
    if data.discrete:
        unit = (units or {}).get(name)
        return f"next {name} ({unit})" if unit else f"next {name}"
    return axis_label(f"d/dt {name}", units)


def draw_residuals(ax, data: Any, state: int, units=None) -> None:
    """Residual before and after over the time of the held-out rows."""
    before, after = (one[:, state] for one in data.residuals)
    x, edges, label = _held_out_axis(data, units)
    shown = np.flatnonzero(np.isfinite(x))
    shown = shown[:: max(1, len(shown) // _MOST_DOTS)]
    for values, colour, name in (
        (before, BEFORE, "declared model"),
        (after, AFTER, "with effects"),
    ):
        ax.scatter(x[shown], values[shown], s=7, color=colour, linewidths=0, alpha=0.7, label=name)
    ax.axhline(0.0, color="0.2", linewidth=1.0)
    for edge in edges:
        ax.axvline(edge, color="0.75", linewidth=0.8, zorder=0)
    low, high = np.quantile(before, [0.002, 0.998])
    low, high = min(low, after.min()), max(high, after.max())
    room = 0.05 * (high - low)
    if room > 0.0:
        ax.set_ylim(low - room, high + room)
    ax.set(xlabel=label, ylabel=_wrapped(f"residual of {rate_label(data, state, units)}"))
    _legend_above(ax, 2, markerscale=2.5)


def _held_out_axis(data: Any, units) -> tuple[np.ndarray, list[float], str]:
    """Where each held-out row is drawn, where trajectories meet, and the label of the axis.

    Over time, one trajectory after the other if there are several; over row numbers where the
    times are not known.
    """
    records, n_rows = data.records, len(data.rows)
    if not data.stretches:
        return np.arange(n_rows, dtype=float), [], "held-out row"
    time = axis_label("time", units)
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


def draw_trajectory_errors(ax, data: Any, state: int, units=None) -> None:
    """Root mean square error of each held-out trajectory, the largest first."""
    listed = sorted(data.by_trajectory, key=lambda one: -one.before[state])
    left_out = len(listed) - _MOST_BARS
    listed = listed[:_MOST_BARS]
    places = np.arange(len(listed))
    bars = (
        ([one.before[state] for one in listed], -0.2, BEFORE, "declared model"),
        ([one.after[state] for one in listed], 0.2, AFTER, "with effects"),
    )
    for values, shift, colour, label in bars:
        ax.bar(places + shift, values, 0.4, color=colour, label=label)
    sizes = np.concatenate([bars[0][0], bars[1][0]])
    positive = sizes[sizes > 0]
    if len(positive) and sizes.max() > _DECADES * positive.min():
        ax.set_yscale("log")
    names = [one.trajectory for one in listed]
    many = len(names) > 6 or max(map(len, names)) > 8
    ax.set_xticks(places, names, rotation=60 if many else 0, ha="right" if many else "center")
    if many:
        ax.tick_params(axis="x", labelsize=10)
    ax.set(
        xlabel="trajectory" + (f" (the worst {_MOST_BARS})" if left_out > 0 else ""),
        ylabel=_wrapped(f"RMS error of {rate_label(data, state, units)}"),
    )
    room = max(0.7, 0.5 * (5 - len(listed)))
    ax.set_xlim(-room, len(listed) - 1 + room)
    _legend_above(ax, 2)


def draw_shape(ax, data: Any, place: int, units=None, title: str = "") -> None:
    """Contribution of an effect along its channel, its band, and what the data ask for."""
    shape = data.shapes[place]
    shown = np.arange(0, len(shape.values), max(1, len(shape.values) // _MOST_DOTS))
    ax.scatter(
        shape.values[shown],
        shape.wanted[shown],
        s=7,
        color="0.6",
        alpha=0.5,
        linewidths=0,
        label="wanted by the data",
        rasterized=len(shown) > 1000,
    )
    modes = np.unique(shape.modes)
    for position, mode in enumerate(modes):
        name = "effect" if len(modes) == 1 else f"mode {mode}"
        band = "95 %" if position == 0 else None
        _draw_contribution(ax, shape, shape.modes == mode, mode_colour(position), name, band)
    low, high = np.quantile(shape.wanted, [0.002, 0.998])
    low = min(low, np.min(shape.contribution))
    high = max(high, np.max(shape.contribution))
    room = 0.08 * (high - low)
    if room > 0.0:
        ax.set_ylim(low - room, high + room)
    ax.set(
        xlabel=axis_label(shape.axis, units),
        ylabel=_wrapped(f"share of {rate_label(data, shape.target, units)}"),
    )
    _legend_above(ax, 4, title=title, markerscale=2.5)


def _draw_contribution(ax, shape, rows, colour, name, band) -> None:
    values, middle, half = shape.values[rows], shape.contribution[rows], shape.half_width[rows]
    if not shape.is_function:
        ax.scatter(values, middle, s=9, color=colour, linewidths=0, label=name)
        return
    values, middle, half = _with_gaps(values, middle, half)
    if np.isfinite(half).any():
        ax.fill_between(
            values, middle - half, middle + half, color=colour, alpha=0.3, linewidth=0, label=band
        )
    ax.plot(values, middle, color="white", linewidth=4.0)
    ax.plot(values, middle, color=colour, linewidth=2.2, label=name)


def _with_gaps(values, middle, half):
    """A NaN wherever the contribution jumps, so that a step is not drawn as a slope."""
    jumps = np.abs(np.diff(middle))
    span = np.ptp(middle)
    edges = np.flatnonzero(jumps > max(0.25 * span, 20 * np.median(jumps))) + 1 if span else []
    return tuple(np.insert(one, edges, np.nan) for one in (values, middle, half))


def draw_rollout(ax, data: Any, number: int, state: int, units=None) -> None:
    """One measured trajectory and its two simulations."""
    rollout = data.rollouts[number]
    t = rollout.t - rollout.t[0]
    ax.plot(
        t, rollout.measured[:, state], color="black", linewidth=3.0, alpha=0.35, label="measured"
    )
    runs = (
        (rollout.before, (0, (4, 2)), BEFORE, "declared model"),
        (rollout.after, "-", AFTER, "with effects"),
    )
    for values, line, colour, label in runs:
        ax.plot(
            t[: len(values)],
            values[:, state],
            linestyle=line,
            color=colour,
            linewidth=1.8,
            label=label,
        )
        if len(values) and len(values) < len(t):
            ax.plot(t[len(values) - 1], values[-1, state], "x", color=colour, markersize=10)
    _frame_measured(ax, rollout.measured[:, state])
    ax.set(
        xlabel="time" if not units else axis_label("time", units),
        ylabel=axis_label(data.names[state], units),
    )
    _legend_above(ax, 3)


def _frame_measured(ax, measured) -> None:
    """Limits that a simulation which runs away cannot stretch."""
    low, high = measured.min(), measured.max()
    room = 0.75 * (high - low)
    if room > 0.0:
        bottom, top = ax.get_ylim()
        ax.set_ylim(max(bottom, low - room), min(top, high + room))


def _wrapped(label: str) -> str:
    """A long axis label on two lines."""
    return label.replace(" of ", " of\n", 1) if len(label) > _LONG else label


def _legend_above(ax, n_columns: int, title: str = "", markerscale=None) -> None:
    ax.legend(
        loc="lower center",
        bbox_to_anchor=(0.5, 1.0),
        ncols=n_columns,
        frameon=False,
        title=title or None,
        markerscale=markerscale,
        columnspacing=1.2,
        handletextpad=0.5,
    )
