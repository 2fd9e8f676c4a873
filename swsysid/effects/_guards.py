"""Guards with hysteresis: the sign of a function of the state, remembered inside a band."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from swsysid._classifier import PolynomialSurfaceClassifier
from swsysid._data.features import Monomials
from swsysid._data.records import Records
from swsysid._rendering.printing import linear_combination
from swsysid._results import Array
from swsysid.effects._base import figure, products
from swsysid.effects._types import Crossing, GuardEffect

_N_THRESHOLDS = 32  # scanned as ends of a band
_N_HALVINGS = 5  # of the distance between two of them, to refine the band
# Modes are wrong on a few rows in thousands next to a guard.
_WORTH_A_TERM = 0.0005
_WORTH_A_BAND = 0.002
_MOST_GUARDS = 3
_SLIGHT = 0.1  # of the largest term: less is the classifier's margin, not the plant's

Modes = NDArray[np.intp]
Terms = tuple[tuple[int, ...], ...]
Band = tuple[float, float]


@dataclass(frozen=True)
class Guard:
    """A function of the channels of X whose sign, remembered inside a band, is the mode."""

    terms: Terms  # channels of the factors of each monomial
    weights: tuple[float, ...]
    upper_mode: int  # above the band

    def __call__(self, X: Array) -> Array:
        return _monomials(X, self.terms) @ np.array(self.weights)

    def modes(self, records: Records, low: float, high: float) -> Modes:
        """Modes along the trajectories."""
        above = _remembered(records, self(records.X), low, high) > 0
        return np.where(above, self.upper_mode, 1 - self.upper_mode)


@dataclass(frozen=True)
class _Banded:
    """A guard with its best band, and the share of the rows whose modes agree with it."""

    agreement: float
    guard: Guard
    band: Band


class GuardHysteresis(GuardEffect):
    """The guard is crossed at one value on the way up and at a lower one on the way down.

    The mode is that of the side on which the guard's value last was outside the band. The guard
    is found as a margin classifier of the mode from the states *and the mode of the sample
    before*, whose coefficient is half the width of the band.
    """

    kind = "guard_hysteresis"
    meaning = "the guard switches at another place on the way back (hysteresis)"
    needs = frozenset({"order"})

    def candidates(self, records: Records, modes: Modes) -> Iterator[tuple[Guard, Band]]:
        """Guards with a band, of few monomials and of more."""
        for one in _worthwhile(guards_of(records, modes)):
            single = _single(one.guard, records, modes)
            with_band, without = (
                np.mean((one.guard.modes(records, *band) == modes)[modes >= 0])
                for band in (one.band, single)
            )
            if with_band > without + _WORTH_A_BAND:
                yield one.guard, one.band

    def refitted(self, place: Guard, records: Records, modes: Modes) -> tuple[Guard, Band]:
        """The guard and its thresholds for other modes, with the same monomials."""
        anew = [_guard_with_memory(records, modes, place.terms, turns) for turns in (False, True)]
        options = [_with_band(guard, records, modes) for guard in (place, *anew) if guard]
        best = max(options, key=lambda option: option.agreement)
        return best.guard, best.band

    def place_parameters(self, place: Guard) -> int:
        """Weights of the guard but one, which is a matter of scale."""
        return len(place.terms) - 1

    def theta_names(self, records: Records, place: Guard) -> tuple[str, ...]:
        """Where the guard switches on the way down and on the way up."""
        return ("lower", "upper")

    def switched(self, records: Records, place: Guard, *theta: float) -> Modes:
        return place.modes(records, *theta)

    def remembers(self, *theta: float) -> bool:
        lower, upper = theta
        return upper > lower

    def without_memory(
        self, place: Guard, records: Records, modes: Modes, *theta: float
    ) -> Iterator[tuple[Guard, Band]]:
        for guard in (place, *_guards_without_memory(records, modes)):
            yield guard, _single(guard, records, modes)

    def crossings(self, place: Guard, n_columns: int, *theta: float) -> list[Crossing]:
        powers = np.array(
            [[term.count(channel) for channel in range(n_columns)] for term in ((), *place.terms)]
        )
        upper, lower = place.upper_mode, 1 - place.upper_mode
        down, up = (
            sign * np.array([-edge, *place.weights])
            for sign, edge in zip((-1.0, 1.0), theta, strict=True)
        )
        return [Crossing(upper, lower, down, powers), Crossing(lower, upper, up, powers)]

    def shortened(self, records: Records, place: Guard, *theta: float) -> Records:
        values = place(records.X)
        outside = np.flatnonzero((values < theta[0]) | (values > theta[1]))
        return records.take(np.array([outside[-1] if len(outside) else 0]))

    def statement(self, place: Guard, names: Sequence[str], target: int, *theta: float) -> str:
        listed = [" ".join(names[channel] for channel in term) for term in place.terms]
        modes, band = [1 - place.upper_mode, place.upper_mode], list(theta)
        if len(listed) == 1:
            value, weight = listed[0], place.weights[0]
            band = sorted(edge / weight for edge in band)
            modes = modes if weight > 0.0 else modes[::-1]
        else:
            value = linear_combination(place.weights, listed)
        return (
            f"mode {modes[0]} from {value} < {figure(band[0])} on, mode {modes[1]} from {value} > "
            f"{figure(band[1])} on, in between the mode of before"
        )

    def label(self, place: Guard, names: Sequence[str]) -> str:
        """The guard as text; a single channel as itself."""
        parts = [
            f"{weight:+.3g} {' '.join(names[channel] for channel in term)}"
            for term, weight in zip(place.terms, place.weights, strict=True)
            if abs(weight) > 1e-3 * max(map(abs, place.weights))
        ]
        return " ".join(parts) if len(parts) > 1 else parts[0].removeprefix("+1 ")


# -- guards ----------------------------------------------------------------------------------------


def guards_of(records: Records, modes: Modes) -> list[_Banded]:
    """Guards that could have the modes: one state alone, and polynomials."""
    guards = [Guard(((state,),), (1.0,), upper) for state in records.variables for upper in (1, 0)]
    channels = range(records.X.shape[1])
    for degree, turns in product((1, 2), (False, True)):
        found = _guard_with_memory(records, modes, tuple(products(channels, degree)), turns)
        if found is not None:
            few = _guard_with_memory(records, modes, _main_terms(found, records), turns)
            guards += [guard for guard in (found, few) if guard is not None]
    return [_with_band(guard, records, modes) for guard in guards]


def _guards_without_memory(records: Records, modes: Modes) -> Iterator[Guard]:
    """Guards of the same kinds whose modes are a function of the present state."""
    known = modes >= 0
    X, modes = records.X[known], modes[known]
    for degree in (1, 2):
        terms = tuple(products(range(X.shape[1]), degree))
        found = _separating(X, modes, terms, np.empty((len(X), 0)), None)
        if found is not None:
            few = _separating(X, modes, _main_terms(found, records), np.empty((len(X), 0)), None)
            yield from (guard for guard in (found, few) if guard is not None)


def _guard_with_memory(records: Records, modes: Modes, terms: Terms, turns: bool) -> Guard | None:
    """Margin classifier of the mode from monomials and the mode of the sample before."""
    # Where samples are many between two switches, the mode before says it all of nearly every row
    # and the states nothing. With `turns` the rows on which the mode turns weigh as much as all
    # others; without, a mode that is wrong here and there does little harm.
    pairs = [np.column_stack([rows[:-1], rows[1:]]) for rows in records.trajectories]
    before, after = np.concatenate(pairs).T
    known = (modes[before] >= 0) & (modes[after] >= 0)
    before, after = before[known], after[known]
    turned = modes[before] != modes[after]
    if not turned.any():
        return None
    weight = np.where(turned & turns, np.sum(~turned) / np.sum(turned), 1.0)
    memory = 2.0 * modes[before, None].astype(float) - 1.0
    return _separating(records.X[after], modes[after], terms, memory, weight)


def _separating(
    X: Array, modes: Modes, terms: Terms, memory: Array, weight: Array | None
) -> Guard | None:
    """Margin classifier of the mode from monomials, and from the mode before if it is known."""
    if len(np.unique(modes)) < 2:
        return None
    columns = _monomials(X, terms)
    centre, size = columns.mean(axis=0), columns.std(axis=0)
    size[size == 0.0] = 1.0
    classifier = PolynomialSurfaceClassifier(degree=1, standardize=False)
    design = np.column_stack([(columns - centre) / size, memory])
    classifier.fit(design, modes, sample_weight=weight)
    weights = classifier.coef_[0][1 : 1 + len(terms)] / size
    if not weights.any():
        return None
    lead = weights[np.argmax(np.abs(weights))]
    upper_mode = int(classifier.mode_book_[1, 0] * lead > 0.0)
    return Guard(terms, tuple(float(weight) for weight in weights / lead), upper_mode)


def _main_terms(guard: Guard, records: Records) -> Terms:
    """Terms of a guard that matter."""
    sizes = np.abs(guard.weights) * _monomials(records.X, guard.terms).std(axis=0)
    kept = sizes >= _SLIGHT * sizes.max()
    return tuple(term for term, keep in zip(guard.terms, kept, strict=True) if keep)


def _worthwhile(options: list[_Banded]) -> list[_Banded]:
    """The best guards of each number of monomials, as long as more of them agree better."""
    first, *others = sorted(options, key=lambda one: (len(one.guard.terms), -one.agreement))
    chosen = [first]
    for option in others:
        more = len(option.guard.terms) - len(chosen[-1].guard.terms)
        if option.agreement > chosen[-1].agreement + _WORTH_A_TERM * more:
            chosen.append(option)
    return chosen[-_MOST_GUARDS:]


def _monomials(X: Array, terms: Terms) -> Array:
    powers = [[term.count(channel) for channel in range(X.shape[1])] for term in terms]
    return Monomials(np.array(powers))(X)


# -- bands -----------------------------------------------------------------------------------------


def _with_band(guard: Guard, records: Records, modes: Modes) -> _Banded:
    """The band of a guard that agrees best with the modes."""
    values, known = guard(records.X), modes >= 0
    sides = np.where(known, np.where(modes == guard.upper_mode, 1.0, -1.0), 0.0)
    shares = np.linspace(0.02, 0.98, _N_THRESHOLDS)
    levels = np.unique(np.quantile(values[known], shares))
    pairs = [(low, high) for place, low in enumerate(levels) for high in levels[place:]]
    excess, band = best_band(pairs, records, values, sides)
    step = 0.5 * float(np.max(np.diff(levels), initial=0.0))
    for _ in range(_N_HALVINGS):
        lows, highs = ((edge - step, edge, edge + step) for edge in band)
        ordered = [pair for pair in product(lows, highs) if pair[0] <= pair[1]]
        excess, band = best_band(ordered, records, values, sides)
        step *= 0.5
    for edge in (0, 1):
        excess, band = _midway(edge, band, records, values, sides)
    agreement = 0.5 * (1.0 + excess / known.sum())
    return _Banded(agreement, guard, band)


def _midway(
    edge: int, band: Band, records: Records, values: Array, sides: Array
) -> tuple[float, Band]:
    """The band with one of its edges in the middle of where it agrees best, and how well."""
    # The modes are the same wherever an edge lies between two samples, and a trajectory that turns
    # back between it and the true one is in the wrong mode for a whole stay.
    levels = np.unique(values)
    place, most = int(np.searchsorted(levels, band[edge])), _N_THRESHOLDS
    near = levels[max(0, place - most) : place + most]
    other = band[1 - edge]
    near = near[near <= other] if edge == 0 else near[near >= other]
    if len(near) < 2:
        return float(_excesses([band], records, values, sides)[0]), band
    middles = 0.5 * (near[1:] + near[:-1])
    bands = [(middle, other) if edge == 0 else (other, middle) for middle in middles.tolist()]
    excesses = _excesses(bands, records, values, sides)
    best = np.flatnonzero(excesses == excesses.max())
    runs = np.split(best, np.flatnonzero(np.diff(best) > 1) + 1)
    widest = max(runs, key=lambda run: float(near[run[-1] + 1] - near[run[0]]))
    value = 0.5 * float(near[widest[0]] + near[widest[-1] + 1])
    return float(excesses.max()), (value, other) if edge == 0 else (other, value)


def _single(guard: Guard, records: Records, modes: Modes) -> Band:
    """The threshold that agrees best with the modes if nothing is remembered, twice."""
    known, values = modes >= 0, guard(records.X)
    order = np.argsort(values[known])
    level = values[known][order]
    above = np.where(modes[known][order] == guard.upper_mode, 1.0, -1.0)
    # of the rows above a threshold those in the upper mode less the others; it lies below all
    # rows, between two of them, or above all
    edges = np.concatenate([level[:1], 0.5 * (level[1:] + level[:-1]), level[-1:]])
    best = int(np.argmax(above.sum() - 2.0 * np.concatenate([[0.0], np.cumsum(above)])))
    return (float(edges[best]),) * 2


def best_band(
    bands: list[Band], records: Records, values: Array, sides: Array
) -> tuple[float, Band]:
    """The band whose remembered sides agree best with `sides`, and agreeing rows less others."""
    excesses = _excesses(bands, records, values, sides)
    best = int(np.argmax(excesses))
    return float(excesses[best]), bands[best]


def _excesses(bands: list[Band], records: Records, values: Array, sides: Array) -> Array:
    """For each band the rows whose remembered side agrees with `sides` less all others."""
    # Rows that follow each other between the same two edges have the same side whatever the band,
    # so that the first of them stands for all.
    edges, order = np.unique(bands), np.concatenate(records.trajectories)
    along = values[order]
    between = np.searchsorted(edges, along, "left") + np.searchsorted(edges, along, "right")
    begins = np.diff(between, prepend=-1) != 0
    begins[np.cumsum([0, *map(len, records.trajectories[:-1])])] = True
    first = order[begins]
    votes = np.bincount(np.cumsum(begins) - 1, weights=sides[order])
    some, part = records.take(first), values[first]
    return np.array([float(votes @ _remembered(some, part, *band)) for band in bands])


def _remembered(records: Records, values: Array, low: float, high: float) -> Array:
    """+1 or -1: the side of the band [low, high] on which the values last were."""
    # A trajectory that begins inside the band is taken to come from the nearer side.
    side = np.where(values > high, 1.0, np.where(values < low, -1.0, 0.0))
    first = np.array([rows[0] for rows in records.trajectories])
    start = np.where(values[first] > 0.5 * (low + high), 1.0, -1.0)
    side[first] = np.where(side[first] == 0.0, start, side[first])

    # every trajectory begins with a side, so that none remembers the one before it
    order = np.concatenate(records.trajectories)
    along = side[order]
    side[order] = along[np.maximum.accumulate(np.where(along != 0.0, np.arange(len(order)), 0))]
    return side
