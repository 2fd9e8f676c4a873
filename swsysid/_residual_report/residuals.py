"""`residual_report`: what a fitted model leaves over, and what the leftover depends on."""

from __future__ import annotations

import math
from typing import Any

from numpy.typing import ArrayLike

from swsysid._checks.parameters import random_numbers, real, whole
from swsysid._residual_report.cases import Case, examine_all, findings_of, peaks_of
from swsysid._residual_report.dependence import Clock
from swsysid._residual_report.report import ReportData, ResidualReport
from swsysid._residual_report.samples import ResidualSamples, collect
from swsysid._residual_report.sizes import biases, sizes, whiteness
from swsysid._residual_report.spectrum import FEWEST_ROWS, frequency_grid, make_pieces

__all__ = ["residual_report"]

# How the significance is divided: rearrangements share one correction (Westfall and Young), the
# two tests with known distributions have Holm's.
_PERMUTED, _WHITENESS, _BIAS = 0.8, 0.1, 0.1
_MOST_PERMUTATIONS = 100_000


def residual_report(
    model: Any,
    X: ArrayLike,
    Xdot: ArrayLike,
    t: ArrayLike | None = None,
    groups: ArrayLike | None = None,
    signals: ArrayLike | None = None,
    *,
    n_lags: int = 10,
    n_permutations: int = 499,
    significance: float = 0.01,
    random_state=None,
) -> ResidualReport:
    """What a fitted model leaves over of the velocities, and what the leftover depends on.

    For every state equation: the size of the residual against an estimate of the noise; whether
    it is white and centred; whether its mean or its spread depends on a state, an input, the time,
    a signal, the mode, the past, or the distance from the switching surface; whether it
    oscillates. With `significance` 0.01 a model that leaves nothing but noise is reported clean
    in 99 of 100 cases: all tests of all equations and modes are corrected together.

    Parameters
    ----------
    model : object
        Fitted, with ``predict(X)``, or ``predict(X, t=, groups=, signals=)`` of which it is given
        what its signature names. With ``predict_modes`` every mode is examined too, with
        ``surface_`` (its own, or that of the regressor inside a pipeline, a model with effects
        or a search) the neighbourhood of the switching surface.
    X : array-like or data frame of shape (n_samples, n_states + n_inputs)
    Xdot : array-like of shape (n_samples, n_states) or (n_samples,)
        Measured velocities (next states in discrete time).
    t : array-like of shape (n_samples,), default=None
        Times in s, increasing within each trajectory.
    groups : array-like of shape (n_samples,), default=None
        Trajectory of each row, rows in time order. Without `t` and `groups` rows have no order,
        and everything about time is skipped.
    signals : array-like or data frame of shape (n_samples, n_signals), default=None
        Logged channels that the model does not use.
    n_lags : int, default=10
        Rows to look back.
    n_permutations : int, default=499
        Rearrangements of the residual.
    significance : float, default=0.01
        Probability of finding anything in a residual of which nothing can be explained.
    random_state : int, RandomState instance or None, default=None

    Returns
    -------
    ResidualReport
        Prints as a table with a verdict for each equation; behaves as a dict; ``clean`` says
        whether nothing was found, ``plot()`` draws.

    Raises
    ------
    TypeError, ValueError
        If the parameters or the data make no sense; the message says what to do.

    Notes
    -----
    Shares and tests are of residuals cut off at four robust standard deviations. Rows that are
    correlated in time are rearranged in blocks, so that channels and residuals that are slow, but
    have nothing to do with each other, are not brought together.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn.linear_model import LinearRegression
    >>> from swsysid.diagnosis import residual_report
    >>> rng = np.random.default_rng(0)
    >>> X = rng.uniform(-1, 1, (500, 2))
    >>> Xdot = X[:, :1] - 0.5 * np.sign(X[:, 1:]) + 0.05 * rng.standard_normal((500, 1))
    >>> report = residual_report(LinearRegression().fit(X, Xdot), X, Xdot, random_state=0)
    >>> report.clean, report.findings[0].channel
    (False, 'x1')
    """
    _check(n_lags, n_permutations, significance)
    samples = collect(model, X, Xdot, t, groups, signals)
    clock, skipped = _clock(samples)
    size = sizes(samples)
    live = [i for i in range(len(samples.equations)) if not size[i].exact]
    cases = examine_all(
        samples,
        live,
        clock,
        n_lags=n_lags,
        n_permutations=n_permutations,
        significance=significance,
        rng=random_numbers(random_state),
    )
    findings = findings_of(samples, cases, significance, _PERMUTED)
    white = whiteness(samples, live, n_lags, significance, _WHITENESS, skipped)
    offsets = biases(samples, live, significance, _BIAS)
    return ResidualReport(
        equations=tuple(samples.equations),
        n_samples=len(samples.X),
        n_trajectories=len(samples.trajectories) if samples.ordered else 0,
        significance=float(significance),
        n_permutations=int(n_permutations),
        size=tuple(size),
        whiteness=tuple(white),
        tests=tuple(sorted(findings + offsets, key=lambda found: -found.share)),
        spectrum=tuple(peaks_of(findings, cases, samples.equations)),
        skipped=skipped,
        data=_data(samples, cases, clock),
    )


def _check(n_lags: int, n_permutations: int, significance: float) -> None:
    real("significance", significance, above=0, below=1)
    whole("n_lags", n_lags)
    fewest = math.ceil(1.0 / (_PERMUTED * significance) - 1e-9) - 1
    if whole("n_permutations", n_permutations, most=_MOST_PERMUTATIONS) < fewest:
        raise ValueError(
            f"n_permutations={n_permutations} cannot reach significance {significance:g}; use at "
            f"least {fewest}."
        )


def _clock(samples: ResidualSamples) -> tuple[Clock | None, dict[str, str]]:
    """Times for the spectrum, and what is skipped and why."""
    skipped = {}
    if not samples.ordered:
        reason = "without t and groups rows have no order in time"
        skipped = dict.fromkeys(("whiteness", "lags", "spectrum", "time"), reason)
    elif samples.t is None:
        skipped = dict.fromkeys(("spectrum", "time"), "t is not given")
    if samples.nearness is None:
        skipped["surface"] = samples.why_no_nearness
    if samples.t is None:
        return None, skipped
    pieces = make_pieces(samples.codes)
    if not pieces:
        return None, skipped | {"spectrum": f"no trajectory has {FEWEST_ROWS} rows"}
    return Clock(samples.t, pieces, frequency_grid(samples.t, pieces)), skipped


def _data(samples: ResidualSamples, cases: list[Case], clock: Clock | None) -> ReportData:
    """Arrays behind the pictures."""
    whole = [case for case in cases if case.mode is None]
    tested = [test.channel for case in whole for test in case.examination.tests if test.channel]
    return ReportData(
        residual=samples.residual,
        channels={channel.name: channel.values for channel in tested},
        pairs={
            channel.name: (channel.parts[0].name, channel.parts[1].name)
            for channel in tested
            if channel.parts is not None
        },
        frequency=None if clock is None else clock.frequency,
        periodogram={
            samples.equations[case.equation]: case.examination.periodogram
            for case in whole
            if case.examination.periodogram is not None
        },
    )
