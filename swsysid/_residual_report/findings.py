"""Every equation of a model, in all rows and in those of each mode, put to the tests."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import combinations, islice

import numpy as np
from numpy.typing import NDArray

from swsysid._residual_report.channels import Channel, lagged, make_channel, make_pair
from swsysid._residual_report.dependence import Rounds, Test, examine
from swsysid._residual_report.rearrangement import max_statistic
from swsysid._residual_report.samples import ResidualSamples
from swsysid._residual_report.settings import Settings
from swsysid._residual_report.shapes import describe
from swsysid._residual_report.spectrum import Clock, Oscillation
from swsysid._results import Array

__all__ = ["Case", "Finding", "Peak", "examine_all", "findings_of"]


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


@dataclass(frozen=True)
class Case:
    """One equation in all rows, or in those of one mode: its tests, and its spectrum if asked."""

    equation: str
    mode: object
    tests: list[Test]
    periodogram: Array | None


def examine_all(
    samples: ResidualSamples,
    equations: list[int],
    clock: Clock | None,
    n_lags: int,
    n_permutations: int,
    significance: float,
    rng: np.random.RandomState,
    settings: Settings,
) -> list[Case]:
    """Examine some equations, each in all rows first and then in those of each mode."""
    whole = _rounds(samples, clock, n_lags, settings)
    base = _linear_in_each_mode(samples)
    everything = np.arange(len(samples.residual))
    parts: list[tuple[object, NDArray[np.intp], Rounds]] = [(None, everything, whole)]
    for mode, rows in samples.rows_of_modes(settings):
        others = [channel.on(rows) for channel in whole.channels if channel.kind != "mode"]
        parts.append((mode, rows, Rounds(others)))
    cases = []
    for i in equations:
        for mode, rows, rounds in parts:
            residual = samples.residual[rows, i]
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
                settings=settings,
            )
            cases.append(Case(samples.equations[i], mode, tests, periodogram))
    return cases


def _rounds(
    samples: ResidualSamples, clock: Clock | None, n_lags: int, settings: Settings
) -> Rounds:
    """Everything that the residual in all rows may depend on."""
    records, make = samples.records, partial(make_channel, settings=settings)

    def column(number: int, kind: str) -> Channel:
        return make(records.names[number], records.channel(number), kind)

    columns = [column(number, "state") for number in records.states]
    columns += [column(number, "input") for number in records.inputs]
    signals = [column(number, "signal") for number in records.signal_channels]
    t = records.t if records.timed else None
    time = [] if t is None else [make("t", t, "time")]
    channels, spread = columns + time + signals, []
    if samples.modes is not None:
        numbers = np.unique(samples.modes, return_inverse=True)[1]
        channels.append(make("mode", numbers.astype(float), "mode"))
    if samples.nearness is not None:
        quantiles = np.array(settings.near_surface)
        spread = [make("the switching surface", samples.nearness, "surface", quantiles)]

    pairs = [make_pair(*both) for both in islice(combinations(columns, 2), settings.most_pairs)]
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
        return pairs + [make(*one) for one in past + own]

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


def findings_of(
    cases: list[Case], significance: float, settings: Settings
) -> tuple[list[Finding], list[Peak]]:
    """All tests of all cases, their p-values corrected together, and those of the spectrum."""
    pairs = [(case, test) for case in cases for test in case.tests]
    p_values = max_statistic(np.array([test.statistics for _, test in pairs]))
    p_values = np.minimum(1.0, p_values / settings.weight_of_rearrangements)
    findings, peaks = [], []
    for (case, test), p_value in zip(pairs, p_values.tolist(), strict=True):
        significant, source = p_value <= significance, test.source
        findings.append(
            Finding(
                equation=case.equation,
                mode=case.mode,
                channel=source.name,
                kind=source.kind,
                aspect=test.aspect,
                share=test.share,
                p_value=p_value,
                significant=significant,
                direct=significant and test.direct,
                shape=_shape(test, settings) if significant else "",
            )
        )
        if isinstance(source, Oscillation):
            peak = Peak(case.equation, source.frequency, test.share, p_value, significant)
            peaks.append(peak)
    return findings, peaks


def _shape(test: Test, settings: Settings) -> str:
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
    return describe(name, source.values, test.values, share, settings)
