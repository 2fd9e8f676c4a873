"""What a model leaves over: a field that neighbouring samples share, a constant, or noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from swsysid._results import Array

# Mean of |r - r'| / (|r| + |r'|), as a ratio of means, for independent normal residuals.
_INDEPENDENT = np.sqrt(0.5)


@dataclass(frozen=True)
class MisfitSettings:
    """When residuals are no noise."""

    # Neighbours share this much of the residuals if what is missing is seven times the noise: less
    # is the rule in measured data, whose laws are never quite those of the library.
    structured: float = 0.85
    # What is shared must also be this share of the spread of the velocity: less is no wrong
    # partition.
    large: float = 0.05
    # Residuals below this share of the spread of a velocity are rounding errors.
    rounding: float = 1e-7
    fewest_pairs: int = 100  # fewer pairs of neighbours allow no judgement ...
    most_rows: int = 3000  # ... and more rows say no more
    # Rows of one trajectory this close in time share the errors of differentiation and filters, so
    # they are no neighbours: so many, and this share of the rows if that is more.
    apart: int = 50
    apart_share: float = 0.02
    n_neighbours: int = 128  # among which one that is far enough in time is looked for ...
    more_neighbours: int = 8  # ... so many times as many each time that there is none
    # A constant is missed if it explains this share of the squared residuals of a mode, and this
    # share of the spread of the velocity.
    explained: float = 0.3
    noticed: float = 0.1
    rows_a_coefficient: int = 10  # of a mode at least, to judge its constant


DEFAULTS = MisfitSettings()


@dataclass(frozen=True)
class Misfit:
    """How much of the residuals is no noise."""

    # 0 if the residuals of neighbouring samples are independent, 1 if they are equal; the largest
    # of all velocities. 0 without a judgement.
    share: float
    size: float  # root mean square of the residuals of that velocity, over its standard deviation
    output: int  # the number of that velocity
    structured: bool  # True if a part of the vector field far above the noise is left over


def shared_residual(
    points: Array,
    residuals: Array,
    spread: Array,
    modes: NDArray[np.intp],
    trajectory: NDArray[np.intp] | None = None,
    time: NDArray[np.intp] | None = None,
    settings: MisfitSettings = DEFAULTS,
) -> Misfit:
    r"""Compare the residuals of every sample with those of its nearest neighbour in the same mode.

    .. math:: 1 - \sqrt 2 \; \frac{\sum_i |r_i - r_{n(i)}|}{\sum_i (|r_i| + |r_{n(i)}|)}

    is about 0 for independent residuals and 1 for a smooth function of the state, whose difference
    between neighbours is small: a wrong partition, or a term that the library lacks. `points` are
    standardised coordinates, `spread` (n_states,) the standard deviations of the velocities. Rows
    of one trajectory at nearly the same time, their number in the record, are no neighbours.
    """
    first, second = _pairs(points, modes, trajectory, time, settings)
    best = Misfit(0.0, 0.0, 0, False)
    if len(first) < settings.fewest_pairs:
        return best
    for output, values in enumerate(residuals.T):
        size = np.abs(values[first]) + np.abs(values[second])
        if not spread[output] or size.mean() <= 2 * settings.rounding * spread[output]:
            continue
        difference = np.abs(values[first] - values[second])
        share = 1.0 - float(difference.sum() / (_INDEPENDENT * size.sum()))
        if share > best.share:
            rms = float(np.sqrt(np.mean(np.square(values))) / spread[output])
            structured = share > settings.structured and rms > settings.large
            best = Misfit(share, rms, output, structured)
    return best


@dataclass(frozen=True)
class MissingConstant:
    """Where a constant would help most."""

    share: float  # of the squared residuals of that mode and velocity, what it explains
    mode: int
    output: int


def missing_constant(
    features: Array,
    targets: Array,
    modes: NDArray[np.intp],
    weight: Array,
    settings: MisfitSettings = DEFAULTS,
) -> MissingConstant | None:
    """Where one more feature, a constant, explains a good part of the least-squares residuals."""
    # A weight of zero leaves a row out, an outlier for example.
    best = MissingConstant(0.0, 0, 0)
    spread = targets.std(axis=0)
    for mode in np.unique(modes):
        rows = np.flatnonzero((modes == mode) & (weight > 0))
        if len(rows) < settings.rows_a_coefficient * (features.shape[1] + 1):
            continue
        rooted = np.sqrt(weight[rows])[:, None]
        design = rooted * features[rows]
        with_constant = np.hstack([design, rooted])
        target = rooted * targets[rows]
        before, after = (_squared_residuals(each, target) for each in (design, with_constant))
        noticed = before - after > np.square(settings.noticed * spread) * weight[rows].sum()
        share = np.where(noticed, 1.0 - after / np.where(noticed, before, 1.0), 0.0)
        if share.max() > best.share:
            best = MissingConstant(float(share.max()), int(mode), int(share.argmax()))
    return best if best.share > settings.explained else None


def _squared_residuals(design: Array, targets: Array) -> Array:
    residuals = targets - design @ np.linalg.lstsq(design, targets, rcond=None)[0]
    return np.square(residuals).sum(axis=0)


def _pairs(points, modes, trajectory, time, settings) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows, and the nearest neighbour of each; rows without one among the nearest are left out."""
    n_apart = max(settings.apart, int(settings.apart_share * len(points)))
    step = max(1, len(points) // settings.most_rows)
    most = 2 if time is None else settings.n_neighbours
    nearest = np.full(len(points), -1)
    for mode in np.unique(modes):
        members = np.flatnonzero(modes == mode)
        tree, chosen, count = cKDTree(points[members]), members[::step], 1
        # Most rows have one among their first few; the others ask for more.
        while len(chosen) and count < min(most, len(members)):
            count = min(settings.more_neighbours * count, most, len(members))
            found = members[tree.query(points[chosen], count)[1]]
            allowed = found != chosen[:, None]
            if time is not None:
                other = trajectory[found] != trajectory[chosen, None]
                allowed &= other | (np.abs(time[found] - time[chosen, None]) > n_apart)
            has_one = allowed.any(axis=1)
            nearest[chosen[has_one]] = found[has_one, allowed[has_one].argmax(axis=1)]
            chosen = chosen[~has_one]
    first = np.flatnonzero(nearest >= 0)
    return first, nearest[first]
