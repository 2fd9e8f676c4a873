"""The shape of an effect: what it contributes along the channel that it is a function of."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from swsysid._data.records import Records
from swsysid._effect_model.joint_fit import JointFit
from swsysid._effect_search.intervals import linearised
from swsysid._effect_search.report_settings import REPORT
from swsysid._results import Array
from swsysid.effects import PlacedEffect, ResetEffect
from swsysid.effects._placed import corrected

__all__ = ["Shape", "effect_shape"]

_TIME, _ROW = "time", "row"


@dataclass(frozen=True, eq=False)
class Shape:
    """What one effect contributes to the velocity of its state, sample by sample.

    Attributes
    ----------
    axis : str
        Name of what `values` are: a channel, a monomial or the time.
    target : int
        State whose velocity is changed.
    values, contribution : ndarray of shape (n_samples,)
        In increasing order of `values`.
    half_width : ndarray of shape (n_samples,)
        Of the 95 % confidence band, from the covariance of all parameters of the effect beside
        those of the declared model; NaN for an effect that has no term of its own.
    wanted : ndarray of shape (n_samples,)
        The contribution and the residual: what the measured velocities ask of the effect.
    modes : ndarray of shape (n_samples,), int
        0 everywhere unless the effect has other coefficients in other modes.
    is_function : bool
        Whether the contribution is a function of `values`; otherwise it is drawn as dots.
    """

    axis: str
    target: int
    values: Array
    contribution: Array
    half_width: Array
    wanted: Array
    modes: NDArray[np.intp]
    is_function: bool


def effect_shape(
    declared: JointFit,
    fit: JointFit,
    place: int,
    covariance: Array,
    records: Records,
    targets: Array,
) -> Shape:
    """Shape of the term at `place` of a fit on some records.

    An effect without columns (of a sensor, of the modes) contributes the difference between the
    predictions with and without the effects, in the state in which that is largest.
    """
    term, modes = fit.terms[place], fit.predict_modes(records)
    predicted, target = fit.predict(records, modes), term.target
    everything = np.arange(len(records))
    half_width = np.full(len(records), np.nan)
    if term.effect.terms:
        seen = corrected(fit.terms, records)
        slopes = linearised(fit, place, seen, everything, modes)
        contribution = slopes[:, : len(fit.coef[place])] @ fit.coef[place]
        if len(covariance):
            variance = np.einsum("ij,jk,ik->i", slopes, covariance, slopes)
            quantile = stats.norm.ppf(0.5 + REPORT.confidence / 2)
            half_width = quantile * np.sqrt(np.maximum(variance, 0.0))
    else:
        change = predicted - declared.predict(records)
        spread = targets.std(axis=0)
        share = np.sqrt(np.mean(change**2, axis=0)) / np.where(spread > 0, spread, np.inf)
        target = target if isinstance(term.effect, ResetEffect) else int(np.argmax(share))
        contribution = change[:, target]
    axis, values, shown = _axis(term, records)
    if term.mode is not None:
        shown = shown[modes[shown] == term.mode]
    order = shown[np.argsort(values[shown], kind="stable")]
    own = modes if term.effect.terms and term.replaced is not None else np.zeros_like(modes)
    shape = Shape(
        axis=axis,
        target=target,
        values=values[order],
        contribution=contribution[order],
        half_width=half_width[order],
        wanted=((targets - predicted)[:, target] + contribution)[order],
        modes=own[order],
        is_function=True,
    )
    in_time = axis in (_TIME, _ROW) and records.ordered
    return replace(shape, is_function=in_time or all(map(_is_function, _by_mode(shape))))


def _axis(term: PlacedEffect, records: Records) -> tuple[str, Array, NDArray[np.intp]]:
    """What to draw an effect over: name, values, and the rows to show."""
    everything = np.arange(len(records))
    in_time = "time" in term.effect.needs and term.effect.terms
    if isinstance(term.place, (int, np.integer)) and not in_time:
        return records.names[term.place], records.channel(int(term.place)), everything
    if isinstance(term.place, tuple) and not in_time and term.effect.terms:
        channels = sorted(set(term.place))
        if len(channels) == 1:
            return records.names[channels[0]], records.channel(channels[0]), everything
        values = term.columns(records)[:, 0]
        return term.label(records.names), values, everything
    if records.t is None:
        return _ROW, everything.astype(float), everything
    longest = max(records.trajectories, key=len)[: REPORT.stretch]
    return (_TIME if records.timed else _ROW), records.t, longest


def _by_mode(shape: Shape):
    return (shape.contribution[shape.modes == mode] for mode in np.unique(shape.modes))


def _is_function(contribution: Array) -> bool:
    """True if neighbours along the axis are close."""
    if len(contribution) < 3:
        return True
    return bool(
        np.median(np.abs(np.diff(contribution))) <= REPORT.jump * np.ptp(contribution)
        or np.ptp(contribution) == 0.0
    )
