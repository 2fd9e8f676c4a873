"""How large a residual is, and how much of it is noise: differences between neighbours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import norm
from sklearn.neighbors import NearestNeighbors

from swsysid._checks.arrays import column, labels, refuse_vanishing, table
from swsysid._data.rows import spread_rows
from swsysid._data.trajectories import trajectories
from swsysid._noise import robust_scale
from swsysid._residual_report.samples import ResidualSamples
from swsysid._results import Array

FEWEST_NEIGHBOURS = 10  # pairs or triples of rows behind one number of a trajectory

_EXACT = 1e-9  # of the velocities: below it a residual is rounding

_CLIP_OF_SIZE = 2.0  # of the size of noise: neighbours across a jump count little
_N_NEIGHBOURS = 10  # points of the line that meets distance zero at the variance
_MOST_ROWS_OF_NEIGHBOURS = 5000  # a size from so many rows is known to 1 %


@dataclass(frozen=True)
class NoiseFloor:
    """Standard deviation of the part of some values that nothing at hand explains.

    Attributes
    ----------
    value : float
        The smaller of the two estimates, NaN if there is none.
    how : str
        ``"neighbours in time"``, ``"neighbours in space"`` or ``"not estimated"``.
    in_time, in_space : float
        The estimates, NaN where there is none.
    """

    value: float
    how: str
    in_time: float
    in_space: float


@dataclass(frozen=True)
class Size:
    """How large the residual of one equation is, and how much of it is noise.

    Attributes
    ----------
    equation : str
    mode : int or None
        None is all rows.
    n_rows : int
    rmse, r2 : float
    size : float
        Root mean square after cutting off at two robust standard deviations, as the noise.
    noise_floor : float or None
        Noise of the velocities, estimated as `how` says.
    how : str
    ratio : float or None
        `size` over `noise_floor`.
    explainable : float or None
        Share of the residual's variance above the floor.
    exact : bool
        The residual is zero to rounding; nothing is tested.
    """

    equation: str
    mode: object
    n_rows: int
    rmse: float
    r2: float
    size: float
    noise_floor: float | None
    how: str
    ratio: float | None
    explainable: float | None
    exact: bool


def noise_floor(
    values: ArrayLike, X: ArrayLike | None = None, groups: ArrayLike | None = None
) -> NoiseFloor:
    r"""Standard deviation of the noise in `values`, whatever else they are made of.

    *In time*, second differences :math:`(r_{t-1} - 2 r_t + r_{t+1}) / \sqrt 6` leave noise and
    little of what changes slowly. *In space*, the Gamma test (Stefansson, Koncar and Jones, 1997):
    half the mean squared difference between a row and its k-th neighbour, drawn against their
    squared distance for k = 1, ..., 10, meets distance zero at the variance of the noise. Both
    sizes are taken after cutting off at two robust standard deviations, so that outliers and
    neighbours on two sides of a jump count little. What is slow in time *or* a smooth function of
    `X` can be explained: the smaller estimate is the floor. Noise that is itself correlated in
    time looks explicable to the first; white inputs that act late look like noise to both.

    Parameters
    ----------
    values : array-like of shape (n_samples,)
        Velocities, or better the residual of a model, from which the known part is gone.
    X : array-like of shape (n_samples, n_columns), default=None
        Where neighbours are sought, each column in its own standard deviation.
    groups : array-like of shape (n_samples,), default=None
        Trajectories, rows in time order; None means that rows have no order.

    Returns
    -------
    NoiseFloor

    Examples
    --------
    >>> import numpy as np
    >>> from swsysid.diagnosis import noise_floor
    >>> t = np.linspace(0.0, 20.0, 1000)
    >>> noise = 0.1 * np.random.default_rng(0).standard_normal(1000)
    >>> floor = noise_floor(np.sin(t) + noise, groups=np.zeros(1000))
    >>> bool(abs(floor.value - 0.1) < 0.01)
    True
    """
    values = column("values", values)
    refuse_vanishing("values", values[:, None])
    in_time = in_space = np.nan
    if groups is not None:
        in_time = _in_time(values, labels("groups", groups, len(values)))
    if X is not None:
        columns = table("X", X, len(values))
        refuse_vanishing("X", columns)
        in_space = _in_space(values, columns)
    estimates = {"neighbours in time": in_time, "neighbours in space": in_space}
    known = [(value, how) for how, value in estimates.items() if np.isfinite(value)]
    value, how = min(known, default=(np.nan, "not estimated"), key=lambda pair: pair[0])
    return NoiseFloor(float(value), how, float(in_time), float(in_space))


def _clipped_size(values: Array) -> float:
    """Root mean square after cutting off at two robust standard deviations.

    The factor makes it the standard deviation of Gaussian values, which lose 8 % of their variance.
    """
    reach = _CLIP_OF_SIZE
    limit = reach * robust_scale(values)
    if limit == 0.0:  # more than half of them are zero
        return float(np.sqrt(np.square(values).mean()))
    inside = 1.0 - 2.0 * norm.sf(reach) - 2.0 * reach * norm.pdf(reach)
    gaussian = inside + 2.0 * reach**2 * norm.sf(reach)
    return float(np.sqrt(np.square(np.clip(values, -limit, limit)).mean() / gaussian))


def _in_time(values: Array, groups) -> float:
    pieces = [np.diff(values[rows], 2) for _, rows in trajectories(groups)]
    second = np.concatenate(pieces) / np.sqrt(6.0)
    return _clipped_size(second) if len(second) >= FEWEST_NEIGHBOURS else np.nan


def _in_space(values: Array, X: Array) -> float:
    X = X[:, X.std(axis=0) > 0.0]
    if len(X) < 3 * _N_NEIGHBOURS or not X.shape[1]:
        return np.nan
    X = (X - X.mean(axis=0)) / X.std(axis=0)
    most = _MOST_ROWS_OF_NEIGHBOURS
    rows = np.arange(len(X)) if len(X) <= most else spread_rows(len(X), most)
    search = NearestNeighbors(n_neighbors=_N_NEIGHBOURS + 1).fit(X)
    distance, neighbour = search.kneighbors(X[rows])
    # Column 0 is the row itself, or one that equals it.
    difference = (values[rows, None] - values[neighbour[:, 1:]]) / np.sqrt(2.0)
    variance = np.array([_clipped_size(column) ** 2 for column in difference.T])
    squared = np.square(distance[:, 1:]).mean(axis=0)
    # Least squares line; a falling one, or one that ends below zero, is noise about a constant.
    centred = squared - squared.mean()
    slope = max(0.0, float(centred @ variance) / max(float(centred @ centred), 1e-300))
    intercept = variance.mean() - slope * squared.mean()
    return float(np.sqrt(np.clip(intercept, 0.0, None)))


def sizes(samples: ResidualSamples) -> list[Size]:
    """All equations in all rows first, then mode by mode."""
    equations = range(len(samples.equations))
    return [_size(samples, i, *part) for part in samples.parts() for i in equations]


def _size(samples: ResidualSamples, i: int, mode: object, rows: NDArray[np.intp]) -> Size:
    residual, target = samples.residual[rows, i], samples.target[rows, i]
    # Rows of one mode are not neighbours in time.
    in_time = samples.codes if samples.records.ordered and mode is None else None
    floor = noise_floor(residual, samples.records.X[rows], in_time)
    rmse, scale = float(np.sqrt(np.square(residual).mean())), float(target.std())
    smallest = _EXACT * (scale if scale > 0.0 else float(np.abs(target).max()))
    exact = rmse <= smallest
    size = _clipped_size(residual)
    known = np.isfinite(floor.value) and not exact
    value = max(floor.value, smallest) if known else None
    return Size(
        equation=samples.equations[i],
        mode=mode,
        n_rows=len(rows),
        rmse=rmse,
        r2=1.0 - (rmse / scale) ** 2 if scale > 0.0 else float("nan"),
        size=size,
        noise_floor=value,
        how=floor.how,
        ratio=None if value is None else size / value,
        explainable=None if value is None else max(0.0, 1.0 - (value / size) ** 2),
        exact=exact,
    )
