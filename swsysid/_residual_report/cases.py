"""Every equation of a model, in all rows and in those of each mode, put to the tests."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from swsysid._residual_report.channels import Channel, lagged, make_channel, make_pair
from swsysid._residual_report.dependence import Clock, Examination, Test, examine
from swsysid._residual_report.rearrangement import max_statistic
from swsysid._residual_report.records import Finding, Peak
from swsysid._residual_report.samples import ResidualSamples, rows_of_modes
from swsysid._residual_report.shapes import describe
from swsysid._results import Array

__all__ = ["Case", "examine_all", "findings_of", "peaks_of"]

# Pairs of columns that are tested, enough for ten columns.
_MOST_PAIRS = 45
# Quantiles of the distance from the switching surface: bins are narrow where it is small.
_NEAR = np.array([0.02, 0.05, 0.1, 0.2, 0.4, 0.6, 0.8])


@dataclass(frozen=True)
class Case:
    """One equation, in all rows or those of one mode, and its examination."""

    equation: int
    mode: object
    examination: Examination


def _channels(samples: ResidualSamples) -> list[Channel]:
    n_states = len(samples.equations)
    channels = [
        make_channel(name, samples.X[:, i], "state" if i < n_states else "input")
        for i, name in enumerate(samples.names)
    ]
    if samples.t is not None:
        channels.append(make_channel("t", samples.t, "time"))
    channels += [
        make_channel(name, samples.signals[:, i], "signal")
        for i, name in enumerate(samples.signal_names)
    ]
    return channels


def _later(samples: ResidualSamples, n_lags: int) -> Callable[[Array], list[Channel]]:
    """Makes pairs of columns and lagged channels, given what is left of the residual."""
    codes = samples.codes
    longest = int(np.bincount(codes).max())
    lags = range(1, min(n_lags, longest // 4) + 1) if samples.ordered else range(0)
    columns = _channels(samples)[: len(samples.names)]
    pairs = [make_pair(*both) for both in list(combinations(columns, 2))[:_MOST_PAIRS]]

    def make(left: Array) -> list[Channel]:
        past = [
            make_channel(f"{name} {_ago(lag)}", lagged(samples.X[:, i], codes, lag), "lag")
            for i, name in enumerate(samples.names)
            for lag in lags
        ]
        own = [
            make_channel(
                f"the residual {_ago(lag)}", lagged(left, codes, lag, beyond=False), "residual lag"
            )
            for lag in lags
        ]
        return pairs + past + own

    return make


def _ago(lag: int) -> str:
    return f"{lag} row{'s' if lag > 1 else ''} before"


def examine_all(
    samples: ResidualSamples,
    equations: list[int],
    clock: Clock | None,
    *,
    n_lags: int,
    **options: Any,
) -> list[Case]:
    """Examine some equations; `options` are those of `examine`."""
    channels, modes, surface = _channels(samples), _mode_channel(samples), _surface(samples)
    base = _linear_in_each_mode(samples)
    options["ordered"] = samples.ordered
    cases = []
    for i in equations:
        residual = samples.residual[:, i]
        examination = examine(
            residual,
            samples.codes,
            channels + modes,
            later=_later(samples, n_lags),
            spread_channels=channels + modes + surface,
            clock=clock,
            base=base,
            **options,
        )
        cases.append(Case(i, None, examination))
        for mode, rows in rows_of_modes(samples):
            if np.ptp(residual[rows]) == 0.0:
                continue
            within = [channel.on(rows) for channel in channels]
            examination = examine(
                residual[rows],
                samples.codes[rows],
                within,
                later=lambda left: [],
                base=base[rows],
                **options,
            )
            cases.append(Case(i, mode, examination))
    return cases


def _mode_channel(samples: ResidualSamples) -> list[Channel]:
    if samples.modes is None:
        return []
    labels = np.unique(samples.modes, return_inverse=True)[1]
    return [make_channel("mode", labels.astype(float), "mode")]


def _surface(samples: ResidualSamples) -> list[Channel]:
    if samples.nearness is None:
        return []
    return [make_channel("the switching surface", samples.nearness, "surface", _NEAR)]


def _linear_in_each_mode(samples: ResidualSamples) -> Array:
    """Columns [1, X] for every mode: what nearly every model can use."""
    linear = np.column_stack([np.ones(len(samples.X)), samples.X])
    if samples.modes is None:
        return linear
    return np.hstack([linear * (samples.modes == m)[:, None] for m in np.unique(samples.modes)])


def findings_of(
    samples: ResidualSamples, cases: list[Case], significance: float, weight: float
) -> list[Finding]:
    """All tests of all cases, their p-values corrected together and divided by a weight."""
    tests = [(case, test) for case in cases for test in case.examination.tests]
    if not tests:
        return []
    p_values = max_statistic(np.array([test.statistics for _, test in tests])) / weight
    return [
        _finding(samples.equations[case.equation], case, test, min(1.0, float(p)), significance)
        for (case, test), p in zip(tests, p_values, strict=True)
    ]


def peaks_of(findings: list[Finding], cases: list[Case], equations: list[str]) -> list[Peak]:
    """The tests of the spectrum among the findings, with their frequencies."""
    frequencies = {equations[case.equation]: case.examination.frequency for case in cases[::-1]}
    return [
        Peak(found.equation, frequency, found.share, found.p_value, found.significant)
        for found in findings
        if found.kind == "periodic" and (frequency := frequencies[found.equation]) is not None
    ]


def _finding(equation: str, case: Case, test: Test, p_value: float, significance: float) -> Finding:
    significant = p_value <= significance
    channel = test.channel
    return Finding(
        equation=equation,
        mode=case.mode,
        channel="time" if channel is None else channel.name,
        kind="periodic" if channel is None else channel.kind,
        aspect=test.aspect,
        share=test.share,
        p_value=p_value,
        significant=significant,
        direct=significant and test.direct,
        shape=_shape(test, case.examination.frequency) if significant else "",
    )


def _shape(test: Test, frequency: float | None) -> str:
    channel = test.channel
    if channel is None:
        return f"{frequency:.3g} Hz"
    if channel.kind in ("mode", "pair"):
        return ""
    if channel.kind == "surface":
        near = test.values[channel.bins <= 1].mean()
        far = test.values[channel.bins == channel.n_bins - 1].mean()
        return "larger near it" if near > far else "smaller near it"
    # The share is of the whole residual; what was tested may be what others left of it.
    tested = float(test.values.var()) if test.aspect == "mean" else 1.0
    name = "it" if channel.kind in ("lag", "residual lag") else channel.name
    return describe(name, channel.values, test.values, test.share / max(tested, 1e-12))
