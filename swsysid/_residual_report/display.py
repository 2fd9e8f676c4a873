"""A residual report as a picture: its most telling channels, its memory, its spectrum."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Self

import numpy as np

from swsysid._checks.parameters import shown, whole
from swsysid._displays.style import (
    PALETTE,
    Display,
    axis_label,
    bins_along,
    frame_most,
    thinned,
)
from swsysid._rendering.series import STYLE
from swsysid._residual_report.contents import ResidualContents
from swsysid._residual_report.findings import Finding
from swsysid._results import Array

_POINTS, _MIDDLE, _WARNING = "0.55", PALETTE[0], PALETTE[1]
# Half width of the band in which 99 of 100 autocorrelations of white noise lie, times sqrt(n).
_QUANTILE = 2.576
_FEW_VALUES = 4


@dataclass(frozen=True)
class _Panel:
    """One channel, or two together: names, values and what was found."""

    names: tuple[str, ...]
    values: tuple[Array, ...]
    found: str


@dataclass(kw_only=True, eq=False, repr=False)
class ResidualReportDisplay(Display):
    """The residual of one equation against what tells most about it.

    Use `from_report`, or the report's own ``plot``. Dots are samples, the line is the mean of the
    residual in bins of equally many samples and the band one standard deviation about it; below
    or beside them the autocorrelation with the band of white noise, and the spectrum.

    Parameters
    ----------
    equation : str
    residual : ndarray of shape (n_samples,)
    panels : list
        Channels to draw.
    autocorrelation : ndarray of shape (n_lags,) or None
    band : ndarray of shape (n_lags,) or None
        Half width of the band of white noise.
    frequency, periodogram : ndarray of shape (n_frequencies,) or None
    peak : float or None
        Frequency of the peak, if it is significant.
    verdict : str
    labels : tuple of two str, default=("residual", "frequency (Hz)")

    Attributes
    ----------
    ax_ : ndarray of matplotlib Axes
    figure_ : matplotlib Figure

    Examples
    --------
    >>> import matplotlib; matplotlib.use("Agg")
    >>> import numpy as np
    >>> from sklearn.linear_model import LinearRegression
    >>> from swsysid.diagnosis import residual_report
    >>> X = np.linspace(-1, 1, 200)[:, None]
    >>> Xdot = -X + 0.2 * np.sign(X)
    >>> report = residual_report(LinearRegression().fit(X, Xdot), X, Xdot, random_state=0)
    >>> display = report.plot()
    >>> display.ax_[0].get_xlabel()
    'x0'
    """

    equation: str
    residual: Array
    panels: list[_Panel]
    autocorrelation: Array | None
    band: Array | None
    frequency: Array | None
    periodogram: Array | None
    peak: float | None
    verdict: str
    labels: tuple[str, str] = ("residual", "frequency (Hz)")

    _panel_size = (4.6, 4.2)

    @classmethod
    def from_report(
        cls,
        report: ResidualContents,
        *,
        equation: str | None = None,
        n_channels: int = 2,
        units: Mapping[str, str] | None = None,
        ax=None,
    ) -> Self:
        """Choose what to draw of a `ResidualReport`, and draw it.

        Parameters
        ----------
        report : ResidualReport
        equation : str, default=None
            The state whose residual is drawn; the one furthest above its noise if None.
        n_channels : int, default=2
            How many channels, the most telling ones.
        units : mapping from names to units, default=None
            A velocity has the unit of its state by that of ``"time"`` (s), unless its name
            ``"d/dt x"`` gives another one.
        ax : array of matplotlib Axes, default=None
            One for each panel; a new figure if None.

        Returns
        -------
        ResidualReportDisplay
        """
        whole("n_channels", n_channels)
        if not isinstance(report, ResidualContents):
            raise TypeError(f"report={shown(report)} is none; give what residual_report returns.")
        equation = _worst(report) if equation is None else equation
        if not isinstance(equation, str) or equation not in report.equations:
            raise ValueError(
                f"{shown(equation)} is none of the equations {', '.join(report.equations)}; "
                "choose one of them."
            )
        data, column = report.data, report.equations.index(equation)
        white = [test for test in report.whiteness if test.equation == equation]
        peaks = [peak for peak in report.spectrum if peak.equation == equation]
        panels = _chosen(report, equation, n_channels, units)
        if not panels:
            raise ValueError(f"nothing of {equation} was tested: there is nothing to draw.")
        display = cls(
            equation=equation,
            residual=data.residual[:, column],
            panels=panels,
            autocorrelation=np.array(white[0].autocorrelation) if white else None,
            band=_QUANTILE / np.sqrt(white[0].n_pairs) if white else None,
            frequency=data.frequency,
            periodogram=data.periodogram.get(equation),
            peak=peaks[0].frequency if peaks and peaks[0].significant else None,
            verdict=report.verdicts[equation],
            labels=(
                f"residual of {axis_label(('' if data.static else 'd/dt ') + equation, units)}",
                f"frequency ({_inverse((units or {}).get('time', 's'))})",
            ),
        )
        return display.plot(ax=ax)

    def plot(self, ax=None, max_points: int = 3000) -> Self:  # type: ignore[override]
        """Draw.

        Parameters
        ----------
        ax : array of matplotlib Axes, default=None
            One for each panel; a new figure if None.
        max_points : int, default=3000
            Draw at most so many samples of a channel, evenly spaced in their order.

        Returns
        -------
        ResidualReportDisplay
        """
        super().plot(ax, max_points=max_points)
        if ax is None:
            width = int(24 * self.figure_.get_figwidth() / 2.6)
            text = "\n".join(textwrap.wrap(f"{self.equation}: {self.verdict}", width))
            self.figure_.suptitle(text, fontsize=STYLE["font.size"], x=0.01, ha="left")
        return self

    def _panels(self, max_points):
        draw = {1: self._draw_channel, 2: self._draw_pair}
        options = {"max_points": max_points}
        panels = [partial(draw[len(one.names)], panel=one, **options) for one in self.panels]
        if self.autocorrelation is not None:
            panels.append(self._draw_autocorrelation)
        if self.periodogram is not None:
            panels.append(self._draw_spectrum)
        return panels

    def _draw_channel(self, ax, panel, max_points):
        (values,) = panel.values
        known = np.flatnonzero(np.isfinite(values))
        shown = known[thinned(len(known), max_points)]
        look = {"s": 8, "color": _POINTS, "alpha": 0.35, "linewidths": 0}
        ax.scatter(values[shown], self.residual[shown], rasterized=len(shown) > 1000, **look)
        ax.axhline(0.0, color="0.2", linewidth=1.0)
        middle, mean, deviation = _binned(values[known], self.residual[known])
        if len(middle) <= _FEW_VALUES:  # a channel of few values: nothing lies between them
            ax.errorbar(middle, mean, deviation, fmt="o", color=_MIDDLE, capsize=6)
            ax.set_xticks(middle)
            ax.margins(x=0.25)
        else:
            band = middle, mean - deviation, mean + deviation
            ax.fill_between(*band, color=_MIDDLE, alpha=0.2, linewidth=0)
            ax.plot(middle, mean, color="white", linewidth=4.5)
            ax.plot(middle, mean, color=_MIDDLE, linewidth=2.4, marker="o", markersize=4)
        frame_most(ax, self.residual, 0.08)
        ax.set(xlabel=panel.names[0], ylabel=self.labels[0], title=panel.found)

    def _draw_pair(self, ax, panel, max_points):
        shown = thinned(len(self.residual), max_points)
        limit = np.quantile(np.abs(self.residual), 0.98)
        colours = {"c": self.residual[shown], "cmap": "RdBu_r", "vmin": -limit, "vmax": limit}
        places = [values[shown] for values in panel.values]
        points = ax.scatter(*places, s=14, linewidths=0, rasterized=True, **colours)
        ax.figure.colorbar(points, ax=ax, label=self.labels[0])
        ax.set(xlabel=panel.names[0], ylabel=panel.names[1], title=panel.found)

    def _draw_autocorrelation(self, ax):
        lags = np.arange(1, len(self.autocorrelation) + 1)
        outside = np.abs(self.autocorrelation) > self.band
        ends = np.arange(len(lags) + 1) + 0.5
        ax.stairs(self.band, ends, baseline=-self.band, color="0.85", fill=True, zorder=0)
        ax.axhline(0.0, color="0.2", linewidth=1.0)
        for rows, colour in ((outside, _WARNING), (~outside, _MIDDLE)):
            ax.vlines(lags[rows], 0.0, self.autocorrelation[rows], color=colour, linewidth=3.0)
            ax.plot(lags[rows], self.autocorrelation[rows], "o", color=colour, markersize=6)
        largest = min(max(1.3 * np.abs(self.autocorrelation).max(), 2.0 * self.band.max()), 1.05)
        ax.set(xlabel="lag (rows)", ylabel="autocorrelation", title="memory")
        ax.set_ylim(-largest, largest)
        ax.xaxis.get_major_locator().set_params(integer=True)

    def _draw_spectrum(self, ax):
        ax.plot(self.frequency, self.periodogram, color=_MIDDLE, linewidth=1.2)
        title = "spectrum"
        if self.peak is not None:
            ax.axvline(self.peak, color=_WARNING, linewidth=1.5, linestyle="--", zorder=0)
            title = f"spectrum, peak at {self.peak:.3g}"
        ax.set(xlabel=self.labels[1], ylabel="share of variance", title=title)
        ax.set_xlim(0.0, self.frequency[-1])
        ax.set_ylim(bottom=0.0)


def _inverse(unit: str) -> str:
    """Unit of a frequency for that of time."""
    return "Hz" if unit == "s" else f"1/{unit}"


def _worst(report: ResidualContents) -> str:
    """The equation furthest above its noise, among those in which something was found."""
    sizes = [size for size in report.size if size.mode is None]
    found = {finding.equation for finding in report.findings}
    return max(
        sizes, key=lambda size: (size.equation in found, size.ratio or 0.0, size.size)
    ).equation


def _chosen(
    report: ResidualContents, equation: str, n_channels: int, units: Mapping[str, str] | None
) -> list[_Panel]:
    """Channels of the findings first, then those of the largest shares."""
    channels = report.data.channels
    panels: dict[str, _Panel] = {}
    for test in report.against_channels(equation):
        if test.channel not in panels:
            parts = report.data.pairs.get(test.channel, (test.channel,))
            named = ("time",) if test.kind == "time" else parts
            # of a lag only what is new beyond the channel now is drawn, as it was tested
            ending = ", new part" if test.kind == "lag" else ""
            panels[test.channel] = _Panel(
                tuple(axis_label(name, units) + ending for name in named),
                tuple(channels[part] for part in parts),
                _label(test),
            )
        if len(panels) == n_channels:
            break
    return list(panels.values())


def _label(test: Finding) -> str:
    """What a test says of its channel; a picture that shows more is not contradicted."""
    what = f"{'' if test.aspect == 'mean' else 'spread: '}{test.share:.0%}, p<={test.p_value:.2g}"
    if test.direct:
        return what
    return f"{what}, told by others" if test.significant else f"not significant: {what}"


def _binned(coordinate: Array, residual: Array) -> tuple[Array, Array, Array]:
    """Middles, means and deviations in bins; a channel of few values has a bin for each."""
    bins, distinct = bins_along(coordinate, fewest=2, most=25), np.unique(coordinate)
    if len(distinct) <= len(bins):
        bins = [np.flatnonzero(coordinate == value) for value in distinct]
    middle, mean = (np.array([one[rows].mean() for rows in bins]) for one in (coordinate, residual))
    return middle, mean, np.array([residual[rows].std() for rows in bins])
