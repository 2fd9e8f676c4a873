"""A smooth function of one channel or of two that has no name: a regression spline.

Of two channels it is any function of both, one of their product, or one of the first that the
second is multiplied by: a gain or a damping that depends on where the plant is.

Its columns are cardinal: a coefficient is the value of the function at a knot. Between the knots
it is the cubic radial basis function with a linear part, which of one channel is the natural cubic
spline: beyond the outermost knots it goes on as a straight line. Some knots may be where only rows
are that take no part in a fit; so at every knot the function is taken to be what its values at the
others make of it, of two channels to be zero, as if a part of a row had said so (`prior_rows`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from itertools import combinations, permutations

import numpy as np
from scipy.interpolate import CubicSpline, PPoly, RBFInterpolator
from scipy.linalg import null_space
from scipy.spatial.distance import cdist
from scipy.stats import rankdata
from sklearn.cluster import KMeans

from swsysid._data.records import Records
from swsysid._noise import root_mean_square
from swsysid._results import Array
from swsysid.effects._base import Effect, Place, figure

SAMPLES_A_KNOT = 4  # at least

_KNOTS: tuple[int, ...] = (6, 12, 24)  # of a function of one channel
_MORE_KNOTS: tuple[int, ...] = (48,)  # tried after the last of them, one after another
_KNOTS_OF_TWO: tuple[int, ...] = (20, 50)  # of a function of two
_MORE_KNOTS_OF_TWO: tuple[int, ...] = (100, 200, 300)
_PRIOR_ROWS = 0.1  # one row near a knot is worth ten of these
_PRIOR_ROWS_OF_ZERO = 1e-3  # which leave a straight line to the library
_OUTER = 0.01  # share of the samples beyond each outermost knot
_DIGITS = 9  # of a channel's range: values closer than that are one

_TIMES = ", times "  # between the argument of a function and what it is multiplied by


class UnknownFunction(Effect):
    """``f(x)``, ``f(x) v``, ``f(x v)`` or ``f(x, v)``: a smooth function without a name.

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
    reference : float or None, default=None
        For a function of the first channel times the second one: the value of the second for which
        the function tells the contribution, in the unit of that channel. Its knots are values of
        the first channel.

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
        reference: float | None = None,
    ):
        self.channels = channels
        self.knots = knots
        self.of_product = of_product
        self.reference = reference

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
        if self.of_product:
            return [tuple(self.channels)]
        first, second = self.channels
        return [((first,), (second,)) if self.reference is None else ((first,), second)]

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        basis = self.basis(self.points(records))
        return basis if self.reference is None else basis * self.factor(records)[:, None]

    def factor(self, records: Records) -> Array:
        """What the function is multiplied by on every row, (n_samples,)."""
        if self.reference is None:
            return np.ones(len(records))
        return records.channel(self.channels[1]) / self.reference

    @property
    def n_arguments(self) -> int:
        """Two of a function of two channels, one of every other."""
        is_of_one = self.of_product or self.reference is not None
        return 1 if is_of_one else len(self.channels)

    def points(self, records: Records) -> Array:
        """Its arguments on every row, (n_samples, n_arguments)."""
        listed = [records.channel(channel) for channel in self.channels]
        if self.of_product:
            return np.prod(listed, axis=0)[:, None]
        return np.column_stack(listed[: self.n_arguments])

    def condition(self, names: Sequence[str]) -> str:
        """The value of the other channel for which the function is told; nothing without one."""
        if self.reference is None:
            return ""
        return f"{names[self.channels[1]]} = {figure(self.reference)}"

    def arguments(self, names: Sequence[str]) -> tuple[str, ...]:
        """Names of its arguments."""
        own = tuple(str(names[channel]) for channel in self.channels)
        return (" ".join(own),) if self.of_product else own[: self.n_arguments]

    def basis(self, points: Array) -> Array:
        """Columns at some values of the channels, or of their product, (n_points, n_arguments)."""
        scale = np.ptp(np.array(self.knots), axis=0)
        return np.asarray(_cardinal(self.knots)(points / scale))

    def label(self, place: Place, names: Sequence[str]) -> str:
        if not self.channels:
            return super().label(place, names)
        factor = "" if self.reference is None else f"{_TIMES}{names[self.channels[1]]}"
        return ", ".join(self.arguments(names)) + factor

    def physical(self, theta: Mapping[str, float], coef: Mapping[str, float]) -> dict[str, float]:
        """Its spread over the knots, which lie as densely as the samples, and its range."""
        values = np.array(list(coef.values()) or [np.nan])
        return {
            "size": float(values.std()),
            "smallest": float(values.min()),
            "largest": float(values.max()),
        }

    def written(self, label: str, theta: Sequence[float], coef: Array) -> list[tuple[float, str]]:
        return [(1.0, self._text(label))] if len(coef) else []

    def formula(self, label: str, parameters: Mapping[str, float]) -> str:
        return f"{self._text(label)}, size {parameters['size']:.4g}"

    def describe(self, label: str, target: str) -> str:
        if self.reference is None:
            return super().describe(label, target)
        argument, factor = label.split(_TIMES)
        return super().describe(argument, f"what {factor} does to {target}")

    def _text(self, label: str) -> str:
        if self.reference is None:
            return f"f({label})"
        argument, factor = label.split(_TIMES)
        return f"f({argument}) {factor} / {figure(self.reference)}"


@lru_cache(maxsize=256)
def _cardinal(knots: tuple[tuple[float, ...], ...]) -> Callable[[Array], Array]:
    """Functions that are one at a knot and zero at the others, of channels in units of a range."""
    points = np.array(knots)
    scaled, values = points / np.ptp(points, axis=0), np.eye(len(points))
    if points.shape[1] > 1:
        return RBFInterpolator(scaled, values, kernel="cubic", degree=1)
    # the same function, whose pieces ask no row for its distance to every knot
    order = np.argsort(scaled[:, 0])
    splines = _straight_beyond(CubicSpline(scaled[order, 0], values[order], bc_type="natural"))
    return lambda at: np.asarray(splines(at[:, 0]))


def _straight_beyond(inside: CubicSpline) -> PPoly:
    """Natural splines that go on as straight lines."""
    ends = inside.x[[0, -1]]
    lines = np.zeros((4, 2, inside.c.shape[2]))
    lines[2], lines[3] = inside(ends, 1), inside(ends)
    lines[3, 0] -= lines[2, 0]  # the first one begins a unit before the first knot
    pieces = np.hstack([lines[:, :1], inside.c, lines[:, 1:]])
    return PPoly(pieces, [ends[0] - 1.0, *inside.x, ends[1] + 1.0])


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
        return np.sqrt(_PRIOR_ROWS) * np.eye(len(points))
    scaled = points / np.ptp(points, axis=0)
    bent = null_space(np.column_stack([np.ones(len(points)), scaled]).T)
    kernel = cdist(scaled, scaled) ** 3
    weights = bent @ np.linalg.solve(bent.T @ kernel @ bent, bent.T)
    missed = weights / np.diag(weights)[:, None] if bent.size else weights
    rows, of_zero = _PRIOR_ROWS, _PRIOR_ROWS_OF_ZERO
    return np.vstack([np.sqrt(rows) * missed, np.sqrt(of_zero) * np.eye(len(points))])


def shapes(records: Records) -> list[UnknownFunction]:
    """Smooth functions of channels, of products and of pairs of them, the smoothest first.

    They have few knots; `finer` has more of them.
    """
    channels = [*records.states, *records.inputs]
    pairs = list(combinations(channels, 2))
    plain = [UnknownFunction((channel,)) for channel in channels]
    plain += [UnknownFunction(pair, of_product=True) for pair in pairs]
    plain += [
        UnknownFunction(pair, reference=float(root_mean_square(records.channel(pair[1]))))
        for pair in permutations(channels, 2)
        if records.channel(pair[1]).any()
    ]
    sized = [(shape, _KNOTS) for shape in plain]
    sized += [(UnknownFunction(pair), _KNOTS_OF_TWO) for pair in pairs]
    return [shape for each in sized for shape in _sized(records, *each)]


def finer(shape: UnknownFunction, records: Records) -> list[UnknownFunction]:
    """The function of the same channels with the next larger number of knots.

    There is none after a smooth one, and none where the samples do not bear it.
    """
    is_surface = shape.n_arguments > 1
    scanned = _KNOTS_OF_TWO if is_surface else _KNOTS
    more = _MORE_KNOTS_OF_TWO if is_surface else _MORE_KNOTS
    if len(shape.knots) < scanned[-1]:
        return []
    larger = [count for count in more if count > len(shape.knots)][:1]
    return _sized(records, shape, larger)


def _sized(
    records: Records, shape: UnknownFunction, counts: Sequence[int]
) -> list[UnknownFunction]:
    """A shape with so many knots, where the samples bear them."""
    points = shape.points(records)
    width = np.ptp(points, axis=0)
    if not width.all():
        return []
    # values that differ by rounding, as a filter leaves them of an input at rest, are one
    points = np.unique(np.round(points / width, _DIGITS), axis=0) * width
    return [
        UnknownFunction(shape.channels, _knots(points, count), shape.of_product, shape.reference)
        for count in counts
        if len(points) > SAMPLES_A_KNOT * count
    ]


def _knots(points: Array, count: int) -> tuple[tuple[float, ...], ...]:
    """Knots that lie where samples do: evenly, of two channels in the middles of clusters.

    Both in coordinates midway between values and ranks. By ranks alone a function of a product,
    most of whose values are small, would have no knots where it is large.
    """
    if points.shape[1] == 1:
        tails = np.quantile(points, [_OUTER, 1.0 - _OUTER])
        values = np.sort(points[:, 0])
        values = values[(values >= tails[0]) & (values <= tails[1])]
        midway = (values - values[0]) / np.ptp(values) + np.linspace(0.0, 1.0, len(values))
        levels = np.interp(np.linspace(0.0, 2.0, count), midway, values)
        return tuple((level,) for level in np.unique(levels).tolist())
    warped = points / np.std(points, axis=0) + 4.0 * rankdata(points, axis=0) / len(points)
    # in an order that does not tell which channel is the first: the clusters begin with some points
    order = np.argsort(warped.sum(axis=1), kind="stable")
    points, warped = points[order], warped[order]
    own = KMeans(count, n_init=1, random_state=0).fit(warped).labels_
    return tuple(tuple(points[own == number].mean(axis=0).tolist()) for number in np.unique(own))
