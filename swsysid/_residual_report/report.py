"""`residual_report`: what a fitted model leaves over, and what the leftover depends on."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from swsysid._checks.parameters import random_numbers, real, whole
from swsysid._residual_report.channels import Channel
from swsysid._residual_report.contents import (
    ReportData,
    ResidualContents,
    table_of_findings,
    table_of_sizes,
)
from swsysid._residual_report.dependence import FEWEST_ROWS_OF_A_PIECE, Clock
from swsysid._residual_report.display import ResidualReportDisplay
from swsysid._residual_report.findings import (
    WEIGHT_OF_REARRANGEMENTS,
    Case,
    examine_all,
    findings_of,
)
from swsysid._residual_report.noise_floor import sizes
from swsysid._residual_report.samples import Predictor, ResidualSamples, collect
from swsysid._residual_report.whiteness import biases, whiteness
from swsysid._results import Array

_MOST_PERMUTATIONS = 100_000  # more take hours and tell nothing further


@dataclass(frozen=True, eq=False, repr=False)
class ResidualReport(ResidualContents):
    """What a fitted model leaves over; see `residual_report`.

    An object with the attributes below, and a mapping from their names (and those of the
    properties) to plain lists, dicts, numbers and strings: ``report["whiteness"]``,
    ``dict(report)``, ``json.dumps(report.to_dict())``.

    Attributes
    ----------
    equations : tuple of str
        States whose velocities are explained.
    n_samples, n_trajectories : int
        No trajectories if rows have no order.
    significance : float
    n_permutations : int
    size : tuple of Size
        Residual and noise floor of every equation, then of every equation and mode.
    whiteness : tuple of Whiteness
    tests : tuple of Finding
        Every dependence that was tested, the largest share first.
    spectrum : tuple of Peak
    skipped : dict of str to str
        What was not tested, and why.
    data : ReportData
        Arrays for `plot`; not part of the dict.
    """

    def plot(self, equation: str | None = None, *, ax=None) -> ResidualReportDisplay:
        """Draw the residual of one equation; see `swsysid.plotting.ResidualReportDisplay`."""
        return ResidualReportDisplay.from_report(self, equation=equation, ax=ax)

    def __str__(self) -> str:
        trajectories = {0: "rows without order", 1: "1 trajectory"}.get(
            self.n_trajectories, f"{self.n_trajectories} trajectories"
        )
        head = f"Residual report: {self.n_samples} rows, {trajectories}, "
        lines = [f"{head}significance {self.significance:g}"]
        lines += [*table_of_sizes(self.size, self.whiteness), ""]
        found = [test for test in self.tests if test.direct]
        lines += [*table_of_findings(found), ""] if found else []
        lines += [f"{name}: {text}" for name, text in self.verdicts.items()]
        lines += [f"skipped: {part} ({reason})" for part, reason in self.skipped.items()]
        return "\n".join(lines)


def residual_report(
    model: Predictor,
    X: ArrayLike,
    Xdot: ArrayLike,
    t: ArrayLike | None = None,
    groups: ArrayLike | None = None,
    signals: ArrayLike | None = None,
    *,
    window: int = 1,
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
    window : int, default=1
        Rows that share measurements with a row, itself included, where a smoother has made the
        velocities: `Derivatives.window`. Neighbours then share their noise, and a row next to a
        switch is a mixture of two laws. Only rows that share nothing and whose window lies in one
        mode are tested, so that the smoother itself is no finding. 1 is for measured velocities.
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

    With a `window`, what polynomials of degree 4 bend over so many rows of states, inputs and
    predicted velocities is taken from the residual. Of laws that are far from linear over a window
    something is left, and is reported.

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

    A recording, differentiated: the noise that neighbours share is no finding.

    >>> from swsysid.differentiation import differentiate
    >>> t = np.linspace(0, 60, 3001)
    >>> x = np.column_stack([np.sin(t), np.cos(t)]) + 0.01 * rng.standard_normal((3001, 2))
    >>> rows = differentiate(x, t, window=41)
    >>> model = LinearRegression().fit(rows.X, rows.Xdot)
    >>> residual_report(model, *rows[:4], window=rows.window, random_state=0).clean
    True
    """
    real("significance", significance, above=0, below=1)
    whole("n_lags", n_lags)
    whole("window", window)
    fewest = math.ceil(1.0 / (WEIGHT_OF_REARRANGEMENTS * significance) - 1e-9) - 1
    if whole("n_permutations", n_permutations, most=_MOST_PERMUTATIONS) < fewest:
        raise ValueError(
            f"n_permutations={n_permutations} cannot reach significance {significance:g}; use at "
            f"least {fewest}."
        )
    samples = collect(model, X, Xdot, t, groups, signals, window)
    return report_on(samples, n_lags, n_permutations, significance, random_state)


def report_on(
    samples: ResidualSamples,
    n_lags: int = 10,
    n_permutations: int = 499,
    significance: float = 0.01,
    random_state: int | np.random.RandomState | None = None,
) -> ResidualReport:
    """The report of samples that have been collected; see `residual_report`."""
    clock, skipped = _clock(samples)
    size = sizes(samples)
    live = [i for i in range(len(samples.equations)) if not size[i].exact]
    rng = random_numbers(random_state)
    options = n_lags, n_permutations, significance, rng
    cases, spectra = examine_all(samples, live, clock, *options)
    findings, peaks = findings_of(cases, significance)
    findings += biases(samples, live, significance)
    try:
        white = whiteness(samples, live, n_lags, significance)
    except ValueError as error:  # trajectories are too short
        white, skipped["whiteness"] = [], str(error).rstrip(".")
    return ResidualReport(
        equations=tuple(samples.equations),
        n_samples=len(samples.residual),
        n_trajectories=len(samples.trajectories) if samples.records.ordered else 0,
        significance=float(significance),
        n_permutations=int(n_permutations),
        size=tuple(size),
        whiteness=tuple(white),
        tests=tuple(sorted(findings, key=lambda found: -found.share)),
        spectrum=tuple(peaks),
        skipped=skipped,
        data=_data(samples, cases, spectra, clock),
    )


def _clock(samples: ResidualSamples) -> tuple[Clock | None, dict[str, str]]:
    """Times for the spectrum, and what is skipped and why."""
    records, skipped = samples.records, {}
    if not records.ordered:
        reason = "without t and groups rows have no order in time"
        skipped = dict.fromkeys(("whiteness", "lags", "spectrum", "time"), reason)
    elif not records.timed:
        skipped = dict.fromkeys(("spectrum", "time"), "t is not given")
    if samples.n_shared:
        skipped["rows"] = f"{samples.n_shared} that share measurements or are next to a switch"
    if samples.nearness is None:
        skipped["surface"] = samples.why_no_nearness
    if records.t is None or not records.timed:
        return None, skipped
    clock = Clock.of(records.t, samples.codes)
    if clock is None:
        skipped["spectrum"] = f"no trajectory has {FEWEST_ROWS_OF_A_PIECE} rows"
    return clock, skipped


def _data(
    samples: ResidualSamples, cases: list[Case], spectra: dict[str, Array], clock: Clock | None
) -> ReportData:
    """Arrays behind the pictures."""
    sources = [test.source for _, mode, test in cases if mode is None]
    channels = [source for source in sources if isinstance(source, Channel)]
    return ReportData(
        residual=samples.residual,
        channels={channel.name: channel.values for channel in channels},
        pairs={
            channel.name: (channel.parts[0].name, channel.parts[1].name)
            for channel in channels
            if channel.parts is not None
        },
        frequency=None if clock is None else clock.frequency,
        periodogram=spectra,
        static=samples.records.static,
    )
