"""What a model leaves over: a field that neighbouring samples share, a constant, or noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from swsysid._results import Array

__all__ = ["Misfit", "MissingConstant", "missing_constant", "shared_residual"]

# Mean of |r - r'| / (|r| + |r'|), as a ratio of means, for independent normal residuals.
_INDEPENDENT = np.sqrt(0.5)


@dataclass(frozen=True)
class MisfitSettings:
    """When residuals are no noise.

    Attributes
    ----------
    structured : float
        Neighbours share this much of the residuals if what is missing is seven times the noise:
        less is the rule in measured data, whose laws are never quite those of the library.
    large : float
        What is shared must also be this share of the spread of the velocity: less is no wrong
        partition.
    rounding : float
        Residuals below this share of the spread of a velocity are rounding errors.
    fewest_pairs : int
        Fewer pairs of neighbours allow no judgement,
    most_rows : int
        and more rows say no more.
    apart, apart_share : int, float
        Rows of one trajectory this close in time share the errors of differentiation and filters,
        so they are no neighbours: so many, and this share of the rows if that is more.
    n_neighbours : int
        Among which one that is far enough in time is looked for.
    explained, noticed : float
        A constant is missed if it explains this share of the squared residuals of a mode, and
        this share of the spread of the velocity,
    rows_a_coefficient : int
        where the mode has at least so many rows for each coefficient.
    """

    structured: float = 0.85
    large: float = 0.05
    rounding: float = 1e-7
    fewest_pairs: int = 100
    most_rows: int = 3000
    apart: int = 50
    apart_share: float = 0.02
    n_neighbours: int = 128
    explained: float = 0.3
    noticed: float = 0.1
    rows_a_coefficient: int = 10


_SETTINGS = MisfitSettings()


@dataclass(frozen=True)
class Misfit:
    """How much of the residuals is no noise.

    Attributes
    ----------
    share : float
        0 if the residuals of neighbouring samples are independent, 1 if they are equal; the
        largest of all velocities. 0 without a judgement.
    size : float
        Root mean square of the residuals of that velocity, over its standard deviation.
    output : int
        The number of that velocity.
    """

    share: float
    size: float
    output: int

    @property
    def structured(self) -> bool:
        """True if a part of the vector field that is far above the noise is left over."""
        return self.share > _SETTINGS.structured and self.size > _SETTINGS.large


def shared_residual(
    points: Array,
    residuals: Array,
    spread: Array,
    modes: NDArray[np.intp],
    trajectory: NDArray[np.intp] | None = None,
    time: NDArray[np.intp] | None = None,
) -> Misfit:
    r"""Compare the residuals of every sample with those of its nearest neighbour in the same mode.

    .. math:: 1 - \sqrt 2 \; \frac{\sum_i |r_i - r_{n(i)}|}{\sum_i (|r_i| + |r_{n(i)}|)}

    is about 0 for independent residuals and 1 for a smooth function of the state, whose difference
    between neighbours is small: a wrong partition, or a term that the library lacks.

    Parameters
    ----------
    points : ndarray of shape (n_samples, n_coordinates)
        Standardised coordinates.
    residuals : ndarray of shape (n_samples, n_states)
    spread : ndarray of shape (n_states,)
        Standard deviations of the velocities.
    modes : ndarray of shape (n_samples,), int
    trajectory, time : ndarray of shape (n_samples,), int, default=None
        Trajectory of each row, and its number in the record. Rows of one trajectory at nearly the
        same time are then no neighbours.

    Returns
    -------
    Misfit
    """
    first, second = _pairs(points, modes, trajectory, time)
    best = Misfit(0.0, 0.0, 0)
    if len(first) < _SETTINGS.fewest_pairs:
        return best
    for output, values in enumerate(residuals.T):
        size = np.abs(values[first]) + np.abs(values[second])
        if size.mean() <= 2 * _SETTINGS.rounding * spread[output]:
            continue
        difference = np.abs(values[first] - values[second])
        share = 1.0 - float(difference.sum() / (_INDEPENDENT * size.sum()))
        if share > best.share:
            rms = float(np.sqrt(np.mean(np.square(values))) / spread[output])
            best = Misfit(share, rms, output)
    return best


@dataclass(frozen=True)
class MissingConstant:
    """Where a constant would help most.

    Attributes
    ----------
    share : float
        Of the squared residuals of that mode and velocity, what it explains.
    mode, output : int
    """

    share: float
    mode: int
    output: int

    @property
    def helps(self) -> bool:
        """True if a good part of the residual of some mode is a constant."""
        return self.share > _SETTINGS.explained


def missing_constant(
    features: Array, targets: Array, modes: NDArray[np.intp], weight: Array
) -> MissingConstant:
    """How much of the least-squares residuals of a mode one more feature, a constant, explains.

    A weight of zero leaves a row out, an outlier for example.
    """
    best = MissingConstant(0.0, 0, 0)
    spread = targets.std(axis=0)
    for mode in np.unique(modes):
        rows = np.flatnonzero((modes == mode) & (weight > 0))
        if len(rows) < _SETTINGS.rows_a_coefficient * (features.shape[1] + 1):
            continue
        rooted = np.sqrt(weight[rows])[:, None]
        design = rooted * features[rows]
        with_constant = np.hstack([design, rooted])
        target = rooted * targets[rows]
        before, after = (_squared_residuals(each, target) for each in (design, with_constant))
        noticed = before - after > np.square(_SETTINGS.noticed * spread) * weight[rows].sum()
        share = np.where(noticed, 1.0 - after / np.where(noticed, before, 1.0), 0.0)
        if share.max() > best.share:
            best = MissingConstant(float(share.max()), int(mode), int(share.argmax()))
    return best


def _squared_residuals(design: Array, targets: Array) -> Array:
    residuals = targets - design @ np.linalg.lstsq(design, targets, rcond=None)[0]
    return np.square(residuals).sum(axis=0)


def _pairs(points, modes, trajectory, time) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows, and the nearest neighbour of each; rows without one among the nearest are left out."""
    n_apart = max(_SETTINGS.apart, int(_SETTINGS.apart_share * len(points)))
    step = max(1, len(points) // _SETTINGS.most_rows)
    firsts, seconds = [], []
    for mode in np.unique(modes):
        members = np.flatnonzero(modes == mode)
        if len(members) < 2:
            continue
        chosen = members[::step]
        count = min(2 if time is None else _SETTINGS.n_neighbours, len(members))
        found = members[cKDTree(points[members]).query(points[chosen], count)[1]]
        allowed = found != chosen[:, None]
        if time is not None:
            other = trajectory[found] != trajectory[chosen, None]
            allowed &= other | (np.abs(time[found] - time[chosen, None]) > n_apart)
        has_one = allowed.any(axis=1)
        firsts.append(chosen[has_one])
        seconds.append(found[has_one, allowed[has_one].argmax(axis=1)])
    nothing = np.empty(0, dtype=np.intp)
    return np.concatenate([nothing, *firsts]), np.concatenate([nothing, *seconds])
