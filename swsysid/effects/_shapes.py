"""A smooth function of one channel or of two that has no name: a regression spline.

Its columns are cardinal: a coefficient is the value of the function at a knot. Between the knots
it is the cubic radial basis function with a linear part, which of one channel is the natural cubic
spline: beyond the outermost knots it goes on as a straight line. Some knots may be where only rows
are that take no part in a fit; so at every knot the function is taken to be what its values at the
others make of it, of two channels to be zero, as if a part of a row had said so (`prior_rows`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import combinations

import numpy as np
from scipy.interpolate import RBFInterpolator
from scipy.linalg import null_space
from scipy.spatial.distance import cdist
from scipy.stats import rankdata
from sklearn.cluster import KMeans

from swsysid._data.records import Records
from swsysid._results import Array
from swsysid.effects._base import Effect, Place, figure
from swsysid.effects._settings import SETTINGS


class UnknownFunction(Effect):
    """``f(x)``, ``f(x v)`` or ``f(x, v)``: a smooth function that no effect with a name describes.

    A search in whose library it stands says it where every effect with a name predicts worse than
    the best smooth function of the same channels, which it makes of the record.

    Parameters
    ----------
    channels : tuple of int, default=()
        One channel or two; none in the library of a search.
    knots : tuple of tuple of float, default=()
        Points at which its values are free: the values of the channels at each of them.
    of_product : bool, default=False
        True for a function of the product of the channels, whose knots are values of that.

    Examples
    --------
    >>> import numpy as np
    >>> from swsysid import EffectRegressor, SwitchingSystemRegressor
    >>> from swsysid.effects import PlacedEffect, UnknownFunction
    >>> v = np.linspace(-3.0, 3.0, 200)[:, None]
    >>> shape = UnknownFunction((0,), tuple((knot,) for knot in np.linspace(-3.0, 3.0, 13)))
    >>> model = EffectRegressor(SwitchingSystemRegressor(1), [PlacedEffect(shape, 0, 0)])
    >>> model = model.fit(v, -v + v**2 / (1.0 + v**2))
    >>> bool(np.abs(model.predict([[0.7]]) + 0.7 - 0.49 / 1.49).max() < 0.01)
    True
    """

    kind = "unknown_function"
    meaning = "{target} depends on {channel} by a function that no effect with a name describes"

    def __init__(
        self,
        channels: tuple[int, ...] = (),
        knots: tuple[tuple[float, ...], ...] = (),
        of_product: bool = False,
    ):
        self.channels = channels
        self.knots = knots
        self.of_product = of_product

    @property
    def terms(self) -> tuple[str, ...]:  # type: ignore[override]
        """A name for the value at every knot, or at every pair of them."""
        if not self.channels:
            return ()
        return tuple("at " + " ".join(map(figure, knot)) for knot in self.knots)

    @property
    def prior(self) -> Array:
        """Rows that say of the value at a knot that it is what the others make of it."""
        return _prior(self.knots) if self.knots else super().prior

    def places(self, records: Records) -> Sequence[Place]:
        if not self.channels:  # of no record yet
            return [*records.states, *records.inputs]
        if len(self.channels) == 1:
            return [self.channels[0]]
        # of two channels each stands for itself, of their product they are its factors
        return [tuple(self.channels) if self.of_product else tuple((one,) for one in self.channels)]

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        return self.basis(self.points(records))

    def points(self, records: Records) -> Array:
        """Its arguments on every row, (n_samples, n_arguments)."""
        return _points(records, self.channels, self.of_product)

    def basis(self, points: Array) -> Array:
        """Columns at some values of the channels, or of their product, (n_points, n_arguments)."""
        scale = np.ptp(np.array(self.knots), axis=0)
        return np.asarray(_cardinal(self.knots)(points / scale))

    def label(self, place: Place, names: Sequence[str]) -> str:
        if not self.channels:
            return super().label(place, names)
        joint = " " if self.of_product else ", "
        return joint.join(str(names[channel]) for channel in self.channels)

    def physical(self, theta: Mapping[str, float], coef: Mapping[str, float]) -> dict[str, float]:
        """Its spread over the knots, which lie as densely as the samples, and its range."""
        values = np.array(list(coef.values()) or [np.nan])
        return {
            "size": float(values.std()),
            "smallest": float(values.min()),
            "largest": float(values.max()),
        }

    def written(self, label: str, theta: Sequence[float], coef: Array) -> list[tuple[float, str]]:
        return [(1.0, f"f({label})")] if len(coef) else []

    def formula(self, label: str, parameters: Mapping[str, float]) -> str:
        return f"f({label}), size {parameters['size']:.4g}"


@lru_cache(maxsize=256)
def _cardinal(knots: tuple[tuple[float, ...], ...]) -> RBFInterpolator:
    """Functions that are one at a knot and zero at the others, of channels in units of a range."""
    points = np.array(knots)
    scaled = points / np.ptp(points, axis=0)
    return RBFInterpolator(scaled, np.eye(len(points)), kernel="cubic", degree=1)


@lru_cache(maxsize=256)
def _prior(knots: tuple[tuple[float, ...], ...]) -> Array:
    r"""Errors of the values f at the knots if each is predicted from the others, and f itself.

    The interpolation of f has radial functions with the weights A f, where
    :math:`A = N (N^\top K N)^{-1} N^\top` with the kernel K at the knots and a basis N of what
    straight lines are orthogonal to; that of all values but the k-th misses it by
    :math:`(A f)_k / A_{kk}`. In a plane, where most knots have no neighbours on some side, a value
    is predicted to be zero.
    """
    points = np.array(knots)
    if points.shape[1] > 1:
        return np.sqrt(SETTINGS.prior_rows) * np.eye(len(points))
    scaled = points / np.ptp(points, axis=0)
    bent = null_space(np.column_stack([np.ones(len(points)), scaled]).T)
    kernel = cdist(scaled, scaled) ** 3
    weights = bent @ np.linalg.solve(bent.T @ kernel @ bent, bent.T)
    missed = weights / np.diag(weights)[:, None] if bent.size else weights
    rows, of_zero = SETTINGS.prior_rows, SETTINGS.prior_rows_of_zero
    return np.vstack([np.sqrt(rows) * missed, np.sqrt(of_zero) * np.eye(len(points))])


def shapes(records: Records) -> list[UnknownFunction]:
    """Smooth functions of channels, of products and of pairs of them, the smoothest first.

    They have few knots; `finer` has more of them.
    """
    channels = [*records.states, *records.inputs]
    pairs = list(combinations(channels, 2))
    sized: list[tuple[tuple[int, ...], bool, tuple[int, ...]]]
    sized = [((channel,), False, SETTINGS.knots) for channel in channels]
    sized += [(pair, True, SETTINGS.knots) for pair in pairs]
    sized += [(pair, False, SETTINGS.knots_of_two) for pair in pairs]
    return [shape for each in sized for shape in _sized(records, *each)]


def finer(shape: UnknownFunction, records: Records) -> list[UnknownFunction]:
    """The function of the same channels with the next larger number of knots.

    There is none after a smooth one, and none where the samples do not bear it.
    """
    is_surface = len(shape.channels) > 1 and not shape.of_product
    scanned = SETTINGS.knots_of_two if is_surface else SETTINGS.knots
    more = SETTINGS.more_knots_of_two if is_surface else SETTINGS.more_knots
    if len(shape.knots) < scanned[-1]:
        return []
    larger = [count for count in more if count > len(shape.knots)][:1]
    return _sized(records, shape.channels, shape.of_product, larger)


def _sized(
    records: Records, place: tuple[int, ...], of_product: bool, counts: Sequence[int]
) -> list[UnknownFunction]:
    """Shapes with so many knots, where the samples bear them."""
    points = _points(records, place, of_product)
    width = np.ptp(points, axis=0)
    if not width.all():
        return []
    # values that differ by rounding, as a filter leaves them of an input at rest, are one
    points = np.unique(np.round(points / width, SETTINGS.digits), axis=0) * width
    return [
        UnknownFunction(place, _knots(points, count), of_product)
        for count in counts
        if len(points) > SETTINGS.samples_a_knot * count
    ]


def _points(records: Records, channels: Sequence[int], of_product: bool) -> Array:
    """Arguments of a shape on every row, (n_samples, n_arguments)."""
    columns = [records.channel(channel) for channel in channels]
    return np.prod(columns, axis=0)[:, None] if of_product else np.column_stack(columns)


def _knots(points: Array, count: int) -> tuple[tuple[float, ...], ...]:
    """Knots that lie where samples do: evenly, of two channels in the middles of clusters.

    Both in coordinates midway between values and ranks. By ranks alone a function of a product,
    most of whose values are small, would have no knots where it is large.
    """
    if points.shape[1] == 1:
        tails = np.quantile(points, [SETTINGS.outer, 1.0 - SETTINGS.outer])
        values = np.sort(points[:, 0])
        values = values[(values >= tails[0]) & (values <= tails[1])]
        midway = (values - values[0]) / np.ptp(values) + np.linspace(0.0, 1.0, len(values))
        levels = np.interp(np.linspace(0.0, 2.0, count), midway, values)
        return tuple((level,) for level in np.unique(levels).tolist())
    warped = points / np.std(points, axis=0) + 4.0 * rankdata(points, axis=0) / len(points)
    own = KMeans(count, n_init=1, random_state=0).fit(warped).labels_
    return tuple(tuple(points[own == number].mean(axis=0).tolist()) for number in np.unique(own))
