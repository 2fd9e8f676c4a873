"""Effects on the modes themselves: one more mode, a guard with hysteresis, a jump of the state."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement, product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from swsysid._classifier import PolynomialSurfaceClassifier
from swsysid._data.records import Records
from swsysid._pipelines import switching_step, with_parameters
from swsysid._rendering.printing import linear_combination
from swsysid._results import Array
from swsysid._search.trials import Bench, PlacedEffect
from swsysid.effects._base import Effect, figure

__all__ = ["ExtraMode", "GuardHysteresis", "Reset", "remembered"]

Modes = NDArray[np.intp]

_N_THRESHOLDS = 32
_TERM = 0.0005  # agreement that one more term must win
_MOST_GUARDS = 3
_REFINEMENTS = 5
_SLIGHT = 0.1  # of the largest term
_BAND = 0.002  # agreement that a band must win
_FEWEST_JUMPS = 5
_SAME_CROSSING = 0.7  # share of the jumps


class _Structural(Effect):
    """An effect without columns."""

    terms = ()
    acts_at_guards = True


class ExtraMode(_Structural):
    """One more mode than declared, with the same library."""

    kind = "extra_mode"
    meaning = "there is one more region with a law of its own"
    n_more_modes = 1

    def proposals(self, bench: Bench) -> Iterator[PlacedEffect]:
        """One more mode."""
        yield PlacedEffect(self, "modes", 0)

    def extended(self, estimator: Any) -> Any:
        declared = switching_step(estimator)[1].n_modes
        return with_parameters(estimator, n_modes=declared + 1)


@dataclass(frozen=True)
class Guard:
    """A function of the channels of X whose sign, remembered inside a band, is the mode.

    Attributes
    ----------
    terms : tuple of tuple of int
        Channels of the factors of each monomial.
    weights : tuple of float
    upper_mode : int
        Mode above the band.
    """

    terms: tuple[tuple[int, ...], ...]
    weights: tuple[float, ...]
    upper_mode: int

    def __call__(self, X: Array) -> Array:
        return _monomials(X, self.terms) @ np.array(self.weights)

    def statement(self, names: Sequence[str], low: float, high: float) -> str:
        """Where either mode begins, in words."""
        products = [" ".join(names[channel] for channel in term) for term in self.terms]
        modes = [1 - self.upper_mode, self.upper_mode]
        if len(products) == 1:
            ((value, weight),) = zip(products, self.weights, strict=True)
            low, high = sorted((low / weight, high / weight))
            modes = modes if weight > 0.0 else modes[::-1]
        else:
            value = linear_combination(self.weights, products)
        return (
            f"mode {modes[0]} from {value} < {figure(low)} on, mode {modes[1]} from {value} > "
            f"{figure(high)} on, in between the mode of before"
        )

    def modes(self, records: Records, low: float, high: float) -> Modes:
        """Modes along the trajectories."""
        above = remembered(records, self(records.X), low, high) > 0
        return np.where(above, self.upper_mode, 1 - self.upper_mode)


class GuardHysteresis(_Structural):
    """The guard is crossed at one value on the way up and at a lower one on the way down.

    The mode is that of the side on which the guard's value last was outside the band. The guard
    is found as a margin classifier of the mode from the states *and the mode of the sample
    before*, whose coefficient is half the width of the band.
    """

    kind = "guard_hysteresis"
    meaning = "the guard switches at another place on the way back (hysteresis)"
    remembers = True
    needs = frozenset({"order"})

    def proposals(self, bench: Bench) -> Iterator[PlacedEffect]:
        """Guards with a band, of few monomials and of more, if there are two modes."""
        if bench.fit.n_modes != 2 or any(term.effect.remembers for term in bench.fit.terms):
            return
        modes = bench.regression.modes
        for _, guard, band in _worthwhile(_guards(bench.records, bench.rows, modes)):
            if _has_band(bench, guard, band):
                yield PlacedEffect(self, guard, bench.loudest_state, theta=band)

    def settled(self, place: Any, records: Records, rows: NDArray[np.intp], modes: Modes):
        """The guard and its thresholds for other modes, with the same monomials."""
        known = _known(records, rows, modes)
        guards = [_guard_with_memory(records, known, place.terms, turns) for turns in (False, True)]
        options = [
            _with_thresholds(guard, records, rows, modes) for guard in (place, *guards) if guard
        ]
        return max(options, key=lambda option: option[0])[1:]

    def place_parameters(self, place: Any) -> int:
        """Weights of the guard but one, which is a matter of scale."""
        return len(place.terms) - 1

    def theta_names(self, records: Records, place: Any) -> tuple[str, ...]:
        """Where the guard switches on the way down and on the way up."""
        return ("lower", "upper")

    def switched(self, records: Records, place: Any, *theta: float) -> Modes:
        return place.modes(records, *theta)

    def shortened(self, records: Records, place: Any, *theta: float) -> Records:
        values = place(records.X)
        outside = np.flatnonzero((values < theta[0]) | (values > theta[1]))
        return records.take(np.array([outside[-1] if len(outside) else 0]))

    def statement(self, place: Any, names: Sequence[str], target: int, *theta: float) -> str:
        return place.statement(names, *theta)

    def label(self, place: Any, names) -> str:
        """The guard as text; a single channel as itself."""
        parts = [
            f"{weight:+.3g} {' '.join(names[channel] for channel in term)}"
            for term, weight in zip(place.terms, place.weights, strict=True)
            if abs(weight) > 1e-3 * max(map(abs, place.weights))
        ]
        return " ".join(parts) if len(parts) > 1 else parts[0].removeprefix("+1 ")


Option = tuple[float, Guard, tuple[float, float]]  # agreement with the modes, guard, band


def _known(records: Records, rows: NDArray[np.intp], modes: Modes) -> Modes:
    """Modes of the whole record, -1 where they are not known."""
    known = np.full(len(records), -1)
    known[rows] = modes
    return known


def _guards(records: Records, rows: NDArray[np.intp], modes: Modes) -> list[Option]:
    """Guards that could have the modes: one state alone, and polynomials."""
    known = _known(records, rows, modes)
    guards = [Guard(((state,),), (1.0,), upper) for state in records.states for upper in (1, 0)]
    for degree, turns in product((1, 2), (False, True)):
        found = _guard_with_memory(records, known, _all_terms(records, degree), turns)
        if found is not None:
            few = _guard_with_memory(records, known, _main_terms(found, records), turns)
            guards += [guard for guard in (found, few) if guard is not None]
    return [_with_thresholds(guard, records, rows, modes) for guard in guards]


def _worthwhile(options: list[Option]) -> list[Option]:
    """The best guards of each number of monomials, as long as more of them agree better."""
    chosen: list[Option] = []
    for option in sorted(options, key=lambda option: (len(option[1].terms), -option[0])):
        if chosen:
            more = len(option[1].terms) - len(chosen[-1][1].terms)
            if option[0] <= chosen[-1][0] + _TERM * more:
                continue
        chosen.append(option)
    return chosen[-_MOST_GUARDS:]


def _has_band(bench: Bench, guard: Guard, theta: tuple[float, ...]) -> bool:
    """True if the modes agree better with the band than with any single threshold."""
    records, rows, modes = bench.records, bench.rows, bench.regression.modes
    values = guard(records.X)[rows]
    above = np.where(modes == guard.upper_mode, 1.0, -1.0)[np.argsort(values)]
    single = 0.5 + 0.5 * np.abs(2.0 * np.cumsum(above) - above.sum()).max() / len(above)
    return bool(np.mean(guard.modes(records, *theta)[rows] == modes) > single + _BAND)


def _monomials(X: Array, terms) -> Array:
    return np.column_stack([np.prod(X[:, list(term)], axis=1) for term in terms])


def _all_terms(records: Records, degree: int) -> tuple[tuple[int, ...], ...]:
    """Monomials up to a degree, as the channels of their factors."""
    channels = range(records.X.shape[1])
    return tuple(
        term
        for power in range(1, degree + 1)
        for term in combinations_with_replacement(channels, power)
    )


def _main_terms(guard: Guard, records: Records) -> tuple[tuple[int, ...], ...]:
    """Terms of a guard that matter: the others are the classifier's margin, not the plant's."""
    sizes = np.abs(guard.weights) * _monomials(records.X, guard.terms).std(axis=0)
    kept = sizes >= _SLIGHT * sizes.max()
    return tuple(term for term, keep in zip(guard.terms, kept, strict=True) if keep)


def _with_thresholds(
    guard: Guard, records: Records, rows: NDArray[np.intp], modes: Modes
) -> Option:
    """How well the best band of a guard agrees with the modes, the guard, and the band."""
    values, sides = guard(records.X), np.zeros(len(records))
    sides[rows] = np.where(modes == guard.upper_mode, 1.0, -1.0)
    levels = np.unique(np.quantile(values[rows], np.linspace(0.02, 0.98, _N_THRESHOLDS)))
    pairs = [(low, high) for place, low in enumerate(levels) for high in levels[place:]]
    excess, band = _best_band(pairs, records, values, sides)
    step = 0.5 * float(np.max(np.diff(levels), initial=0.0))
    for _ in range(_REFINEMENTS):
        lows, highs = ((edge - step, edge, edge + step) for edge in band)
        near = product(lows, highs)
        ordered = [pair for pair in near if pair[0] <= pair[1]]
        excess, band = _best_band(ordered, records, values, sides)
        step *= 0.5
    return 0.5 * (len(rows) + excess) / len(rows), guard, (float(band[0]), float(band[1]))


def _best_band(
    bands: list[tuple[float, float]], records: Records, values: Array, sides: Array
) -> tuple[float, tuple[float, float]]:
    """The band whose remembered sides agree best with `sides`, and agreeing rows less others.

    Rows that follow each other between the same two edges have the same side whatever the band,
    so that the first of them stands for all.
    """
    edges, order = np.unique(bands), np.concatenate(records.trajectories)
    along = values[order]
    between = np.searchsorted(edges, along, "left") + np.searchsorted(edges, along, "right")
    begins = np.diff(between, prepend=-1) != 0
    begins[np.cumsum([0, *map(len, records.trajectories[:-1])])] = True
    first = order[begins]
    votes = np.bincount(np.cumsum(begins) - 1, weights=sides[order])
    some, part = records.take(first), values[first]
    excesses = [float(votes @ remembered(some, part, *band)) for band in bands]
    best = int(np.argmax(excesses))
    return excesses[best], bands[best]


def _guard_with_memory(
    records: Records, known: Modes, terms: tuple[tuple[int, ...], ...], turns: bool
) -> Guard | None:
    """Margin classifier of the mode from monomials and the mode of the sample before.

    Where samples are many between two switches, the mode before says it all of nearly every row and
    the states nothing. With `turns` the rows on which the mode turns weigh as much as all others;
    without, a mode that is wrong here and there does little harm.
    """
    pairs = [np.column_stack([rows[:-1], rows[1:]]) for rows in records.trajectories]
    before, after = np.concatenate(pairs).T
    told = (known[before] >= 0) & (known[after] >= 0)
    before, after = before[told], after[told]
    turned = known[before] != known[after]
    if not turned.any():
        return None
    weight = np.where(turned & turns, np.sum(~turned) / np.sum(turned), 1.0)
    columns = _monomials(records.X, terms)
    centre, size = columns.mean(axis=0), columns.std(axis=0)
    size[size == 0.0] = 1.0
    memory = 2.0 * known[before] - 1.0
    classifier = PolynomialSurfaceClassifier(degree=1, standardize=False)
    design = np.column_stack([(columns[after] - centre) / size, memory])
    classifier.fit(design, known[after], sample_weight=weight)
    weights = classifier.coef_[0][1:-1] / size
    if not weights.any():
        return None
    lead = weights[np.argmax(np.abs(weights))]
    upper_mode = int(classifier.mode_book_[1, 0] * lead > 0.0)
    return Guard(terms, tuple(float(weight) for weight in weights / lead), upper_mode)


class Reset(_Structural):
    """``x(after) = factor * x(before)`` where the surface is crossed from one mode to another."""

    kind = "reset"
    meaning = "{channel} jumps where the surface is crossed (impact, reset)"
    needs = frozenset({"time"})
    shows_in_velocities = False

    def theta_names(self, records: Records, place: Any) -> tuple[str, ...]:
        """What the state is multiplied by."""
        return ("factor",)

    def statement(self, place: Any, names: Sequence[str], target: int, *theta: float) -> str:
        return (
            f"{names[target]} is multiplied by {figure(theta[0])} where mode {place[0]} turns into "
            f"mode {place[1]}"
        )

    def jump(self, place: Any, *theta: float) -> tuple[tuple[int, int], float]:
        return place, theta[0]

    def renamed(self, place: Any, order: Modes) -> tuple[int, int]:
        return int(order[place[0]]), int(order[place[1]])

    def proposals(self, bench: Bench) -> Iterator[PlacedEffect]:
        """Jumps of each state that the velocities cannot explain."""
        if bench.fit.switching.discrete_time:
            return  # the targets are the next states, jumps included
        for target in bench.records.states:
            before, after, crossing = _jumps(bench, target)
            if len(before) < _FEWEST_JUMPS or crossing[0] == crossing[1]:
                continue
            factor = float(before @ after / (before @ before))
            yield PlacedEffect(self, crossing, target, theta=(factor,))

    def gain(self, bench: Bench, candidate: PlacedEffect) -> tuple[float, float]:
        """Nats won on the jumps, each predicted by the others, and their p-value."""
        before, after, _ = _jumps(bench, candidate.target)
        if len(before) < _FEWEST_JUMPS:  # the effects found since have explained them
            return 0.0, 1.0
        size = before @ before
        leverage = before**2 / size
        error = (after - before * (before @ after) / size) / (1.0 - leverage)
        nothing = np.sum((after - before) ** 2)
        count = len(before)
        ratio = max(float(np.sum(error**2) / nothing), 1e-12)
        statistic = (1.0 / ratio - 1.0) * (count - 1)
        return 0.5 * count * -np.log(ratio), float(stats.f.sf(max(statistic, 0.0), 1, count - 1))


def _jumps(bench: Bench, target: int) -> tuple[Array, Array, tuple[int, int]]:
    """States before and after each jump, and the modes between which most of them happen."""
    records, velocity = bench.records, bench.velocities[:, target]
    assert records.t is not None
    before, after, crossings = [], [], []
    values = records.channel(target)
    for rows in records.trajectories:
        step, rates = np.diff(records.t[rows]), velocity[rows]
        moved = 0.5 * step * (rates[1:] + rates[:-1])
        surprise = np.abs(np.diff(values[rows]) - moved)
        usual = 2.0 * step * np.abs(np.diff(rates)) + 8.0 * np.median(surprise) + 1e-12
        for place in np.flatnonzero(surprise > usual + 0.02 * np.std(values)).tolist():
            # half a step with each of the two laws is all the velocities explain
            before.append(values[rows[place]] + 0.5 * step[place] * rates[place])
            after.append(values[rows[place + 1]] - 0.5 * step[place] * rates[place + 1])
            early, late = rows[max(place - 1, 0)], rows[min(place + 2, len(rows) - 1)]
            crossings.append((int(bench.all_modes[early]), int(bench.all_modes[late])))
    crossing = max(set(crossings), key=crossings.count) if crossings else (0, 0)
    kept = np.array([one == crossing for one in crossings], dtype=bool)
    if not len(kept) or kept.mean() < _SAME_CROSSING:
        return np.empty(0), np.empty(0), crossing
    return np.array(before)[kept], np.array(after)[kept], crossing


def remembered(records: Records, values: Array, low: float, high: float) -> Array:
    """+1 or -1: the side of the band [low, high] on which the values last were.

    A trajectory that begins inside the band is taken to come from the nearer side.
    """
    side = np.where(values > high, 1.0, np.where(values < low, -1.0, 0.0))
    first = np.array([rows[0] for rows in records.trajectories])
    start = np.where(values[first] > 0.5 * (low + high), 1.0, -1.0)
    side[first] = np.where(side[first] == 0.0, start, side[first])

    # every trajectory begins with a side, so that none remembers the one before it
    order = np.concatenate(records.trajectories)
    along = side[order]
    side[order] = along[np.maximum.accumulate(np.where(along != 0.0, np.arange(len(order)), 0))]
    return side
