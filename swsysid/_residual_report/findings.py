"""Every equation of a model, in all rows and in those of each mode, put to the tests."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, islice

import numpy as np
from numpy.typing import NDArray

from swsysid._residual_report.channels import (
    Channel,
    best_step,
    lagged,
    make_channel,
    make_pair,
    without,
)
from swsysid._residual_report.dependence import (
    Clock,
    Oscillation,
    Rounds,
    Test,
    examine,
    max_statistic,
)
from swsysid._residual_report.samples import ResidualSamples
from swsysid._results import Array

# Of the significance. Rearrangements share one correction (Westfall and Young); the two tests whose
# distribution is known have Holm's (`whiteness`).
WEIGHT_OF_REARRANGEMENTS = 0.8

_MOST_PAIRS = 45  # all pairs of ten columns

# Quantiles of the distance from the surface: bins are narrow where it is small.
_NEAR_SURFACE = (0.02, 0.05, 0.1, 0.2, 0.4, 0.6, 0.8)
_NAMED_SHAPE = 0.8  # a shape is named if it holds this share of what the bins hold
_MOST_DIGITS = 6  # numbers with more before or behind the point have an exponent


@dataclass(frozen=True)
class Finding:
    """One test of whether the residual of an equation depends on something.

    Attributes
    ----------
    equation : str
    mode : int or None
        Mode whose rows were tested, None for all.
    channel : str
        What it may depend on; ``"time"`` for a peak of the spectrum, ``"nothing"`` for a bias.
    kind : str
        ``"state"``, ``"input"``, ``"time"``, ``"signal"``, ``"mode"``, ``"pair"``, ``"lag"``,
        ``"residual lag"``, ``"surface"``, ``"periodic"`` or ``"bias"``.
    aspect : str
        ``"mean"`` or ``"spread"`` (the size of what is left when all means are taken away).
    share : float
        Share of the variance of the residual (of its size, for the spread) that it explains,
        beyond what chance does.
    p_value : float
        Corrected for all tests of the report.
    significant : bool
    direct : bool
        Significant, and not explained by stronger ones.
    shape : str
        A few words, empty if it is not significant.
    """

    equation: str
    mode: object
    channel: str
    kind: str
    aspect: str
    share: float
    p_value: float
    significant: bool = False
    direct: bool = False
    shape: str = ""


@dataclass(frozen=True)
class Peak:
    """Strongest peak of the spectrum of one equation.

    Attributes
    ----------
    equation : str
    frequency : float
        In Hz if the times are in s.
    share : float
        Share of the residual's variance in it.
    p_value : float
        Probability that noise has a peak as strong anywhere, corrected for all tests.
    significant : bool
    """

    equation: str
    frequency: float
    share: float
    p_value: float
    significant: bool


# A test of one equation, in all rows (mode None) or in those of one mode.
Case = tuple[str, object, Test]


def examine_all(
    samples: ResidualSamples,
    equations: list[int],
    clock: Clock | None,
    n_lags: int,
    n_permutations: int,
    significance: float,
    rng: np.random.RandomState,
) -> tuple[list[Case], dict[str, Array]]:
    """Tests of some equations, in all rows first and then in those of each mode; their spectra."""
    whole = _rounds(samples, clock, n_lags)
    base = _linear_in_each_mode(samples)
    (_, everything), *modes = samples.parts()
    parts: list[tuple[object, NDArray[np.intp], Rounds]] = [(None, everything, whole)]
    for mode, rows in modes:
        others = [channel.on(rows) for channel in whole.channels if channel.kind != "mode"]
        parts.append((mode, rows, Rounds(others)))
    cases: list[Case] = []
    spectra = {}
    for i in equations:
        for mode, rows, rounds in parts:
            equation, residual = samples.equations[i], samples.residual[rows, i]
            if mode is not None and np.ptp(residual) == 0.0:
                continue
            tests, periodogram = examine(
                residual,
                samples.codes[rows],
                rounds,
                base[rows],
                ordered=samples.records.ordered,
                n_permutations=n_permutations,
                significance=significance,
                rng=rng,
            )
            cases += [(equation, mode, test) for test in tests]
            if periodogram is not None:
                spectra[equation] = periodogram
    return cases, spectra


def _rounds(samples: ResidualSamples, clock: Clock | None, n_lags: int) -> Rounds:
    """Everything that the residual in all rows may depend on."""
    records = samples.records

    def made(numbers: range, kind: str) -> list[Channel]:
        return [make_channel(records.names[k], records.channel(k), kind) for k in numbers]

    columns = made(records.states, "state") + made(records.inputs, "input")
    channels, spread = list(columns), []
    if records.t is not None and records.timed:
        channels.append(make_channel("t", records.t, "time"))
    channels += made(records.signal_channels, "signal")
    if samples.modes is not None:
        numbers = np.unique(samples.modes, return_inverse=True)[1]
        channels.append(make_channel("mode", numbers.astype(float), "mode"))
    if samples.nearness is not None:
        quantiles = np.array(_NEAR_SURFACE)
        spread = [make_channel("the switching surface", samples.nearness, "surface", quantiles)]

    pairs = [make_pair(*both) for both in islice(combinations(columns, 2), _MOST_PAIRS)]
    codes, longest = samples.codes, int(np.bincount(samples.codes).max())
    lags = range(1, min(n_lags, longest // 4) + 1) if records.ordered else range(0)

    def later(left: Array) -> list[Channel]:
        """Pairs of columns, and what came before: the columns, and what is left."""
        past = [
            (f"{column.name} {_ago(lag)}", lagged(column.values, codes, lag), "lag")
            for column in columns
            for lag in lags
        ]
        own = [
            (f"the residual {_ago(lag)}", lagged(left, codes, lag, beyond=False), "residual lag")
            for lag in lags
        ]
        return pairs + [make_channel(*one) for one in past + own]

    return Rounds(channels, clock, later, channels + spread)


def _ago(lag: int) -> str:
    return f"{lag} row{'s' if lag > 1 else ''} before"


def _linear_in_each_mode(samples: ResidualSamples) -> Array:
    """Columns [1, X] for every mode: what nearly every model can use."""
    X, modes = samples.records.X, samples.modes
    linear = np.column_stack([np.ones(len(X)), X])
    if modes is None:
        return linear
    return np.hstack([linear * (modes == mode)[:, None] for mode in np.unique(modes)])


def findings_of(cases: list[Case], significance: float) -> tuple[list[Finding], list[Peak]]:
    """All tests of all cases, their p-values corrected together, and those of the spectrum."""
    p_values = max_statistic(np.array([test.statistics for _, _, test in cases]))
    p_values = np.minimum(1.0, p_values / WEIGHT_OF_REARRANGEMENTS)
    findings, peaks = [], []
    for (equation, mode, test), p_value in zip(cases, p_values.tolist(), strict=True):
        significant, source = p_value <= significance, test.source
        findings.append(
            Finding(
                equation=equation,
                mode=mode,
                channel=source.name,
                kind=source.kind,
                aspect=test.aspect,
                share=test.share,
                p_value=p_value,
                significant=significant,
                direct=significant and test.direct,
                shape=_shape(test) if significant else "",
            )
        )
        if isinstance(source, Oscillation):
            peaks.append(Peak(equation, source.frequency, test.share, p_value, significant))
    return findings, peaks


def _shape(test: Test) -> str:
    source = test.source
    if isinstance(source, Oscillation):
        return f"{source.frequency:.3g} Hz"
    if source.kind in ("mode", "pair"):
        return ""
    if source.kind == "surface":
        near = test.values[source.bins <= 1].mean()
        far = test.values[source.bins == source.n_bins - 1].mean()
        return "larger near it" if near > far else "smaller near it"
    # The share is of the whole residual; what was tested may be what others left of it.
    tested = float(test.values.var()) if test.aspect == "mean" else 1.0
    name = "it" if source.kind in ("lag", "residual lag") else source.name
    share = test.share / max(tested, 1e-12)
    return describe(name, source.values, test.values, share)


def describe(name: str, coordinate: Array, values: Array, share: float) -> str:
    """A few words on how `values` depend on a coordinate, empty if no simple shape fits.

    `share` is the share of the variance of `values` that any function of the coordinate explains;
    a line, a step and a parabola are measured against it.
    """
    known = np.isfinite(coordinate)
    order = np.argsort(coordinate[known], kind="stable")
    x, y = coordinate[known][order], values[known][order] - values[known].mean()
    total = float(y @ y)
    if total == 0.0 or x[0] == x[-1] or share <= 0.0:
        return ""
    z = (x - x.mean()) / x.std()
    line = float(z @ y) / len(z)
    step, place = best_step(x, y)
    kink, other = best_step(x, y - line * z, z)
    simple = {"line": len(z) * line**2 / total, "step": step / total}
    parabola = np.square(y - without(np.polynomial.polynomial.polyvander(z, 2), y)).sum()
    both = {"step and line": simple["line"] + kink / total, "parabola": parabola / total}
    direction = "rising" if line > 0 else "falling"
    words = {
        "line": f"{direction} in a line",
        "step": f"a step at {name}={rounded(place, x)}",
        "step and line": f"a step at {name}={rounded(other, x)} and a line",
        "parabola": "a parabola",
    }
    for shapes in (simple, both):
        best = max(shapes, key=lambda shape: shapes[shape])
        if shapes[best] >= _NAMED_SHAPE * share:
            return words[best]
    return "a curve"


def rounded(place: float, x: Array) -> str:
    """A threshold with the digits that its neighbours deserve."""
    low, high = np.quantile(x, [0.05, 0.95])
    if low == high:  # nearly all rows have one value, as of a switch that is hardly ever on
        low, high = x[0], x[-1]
    digits = int(np.ceil(-np.log10((high - low) / 20.0)))
    rounded = round(place, digits) + 0.0
    if digits > _MOST_DIGITS or abs(rounded) >= 10.0**_MOST_DIGITS:
        return f"{rounded:.3g}"
    return f"{rounded:.{max(digits, 0)}f}"
