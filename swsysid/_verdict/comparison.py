"""Held-out rows, and what they say about a switching model: is switching there, how surely."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student_t

from swsysid._data.trajectories import places_along
from swsysid._results import Array
from swsysid._verdict.settings import JUDGING
from swsysid._verdict.terms import Terms


@dataclass(frozen=True)
class Split:
    """Rows to test on, shape (n_samples,); whole trajectories, or the last stretch of each."""

    test: NDArray[np.bool_]
    whole_groups: bool

    @property
    def train(self) -> NDArray[np.bool_]:
        """Rows to train on."""
        return ~self.test

    @property
    def swapped(self) -> Split:
        """Rows to train on in place of those to test on."""
        return replace(self, test=self.train)


def hold_out(groups: NDArray, fraction: float, random_state: int) -> Split:
    """Rows to test on: whole trajectories if there are enough, else the last of each."""
    if not 0.0 < fraction < 1.0:
        raise ValueError(f"The test fraction {fraction:g} is not between 0 and 1.")
    names, codes = np.unique(groups, return_inverse=True)
    whole = len(names) >= JUDGING.whole_groups
    if whole:
        n_test = max(1, round(fraction * len(names)))
        generator = np.random.default_rng(random_state)
        test = np.isin(codes, generator.permutation(len(names))[:n_test])
    else:
        test = places_along(codes) / np.bincount(codes)[codes] >= 1.0 - fraction
    if not test.any() or test.all():
        raise ValueError(
            f"{len(groups)} samples can be judged, too few to hold out {fraction:g} of them; give "
            "a recording of some dozens of samples."
        )
    return Split(test, whole)


class Verdict(Enum):
    """What the held-out samples say about a model of several modes."""

    SWITCHES = "several modes predict clearly better than any smooth law that was tried"
    SMOOTH = "a smooth law with more terms is as good"
    ONE_MODE = "one mode with the same terms is as good"
    CHANCE = "several modes predict better, which may be chance"
    TOO_FEW = "too few rows or switches to judge"
    USELESS = "nothing predicts better than the mean"
    UNREPEATED = "right for all that was recorded, which laws of a part of it do not repeat"
    HIDDEN = "the modes are there, and nothing that was measured says which one is active"


@dataclass(frozen=True)
class Rival:
    """A law of a single mode and its errors on the held-out rows, (n_rows, n_columns)."""

    terms: Terms
    errors: Array
    same: bool = False  # as the modes, which inputs of few values tell: it is no rival of them


@dataclass(frozen=True)
class Comparison:
    """A model of several modes against laws of one mode, on rows that none of them has seen.

    Columns are rates; or, where recordings are rolled out, measured states, NaN where a value is
    missing, with errors in units of their `noise`.
    """

    errors: Array  # of the model of several modes, (n_rows, n_columns)
    rivals: tuple[Rival, ...]  # with the same terms first, then with more of them
    spread: Array  # standard deviations of what is held out
    n_switches: int  # changes of the mode along the trajectories
    constant: bool  # the surface gives one mode to all samples
    # Errors where each sample has the mode that its own rates tell, or of samples that are told
    # their modes, (1, n_columns); None if they do not tell.
    told_by_rates: Array | None
    # Modes that are nearly absent from the training part; their held-out rows are left out.
    untested: tuple[int, ...]
    noise: Array | None = None  # of the columns, where they are measured states
    blocks: NDArray[np.intp] | None = None  # of the rows: independent stretches; None cuts some
    stretch: int = JUDGING.stretch  # samples of each that is rolled out
    seen: bool = False  # by the model of several modes, which is no better all the same
    # Whether the model of all recordings leaves nothing but noise where switches are told, and
    # predicts better than the best rival what is held out, which it has seen.
    explains: bool = False
    # Whether the best rival leaves nothing but noise of the samples it was made from: at rest,
    # or too short, what is held out is left alone by laws of anything.
    law_stands: bool = True

    @property
    def unit(self) -> Array:
        """What errors are measured in."""
        return self.spread if self.noise is None else self.noise

    @property
    def best(self) -> Rival:
        """The rival of the smallest error; of laws that hardly differ the one of fewest terms.

        One that is the same as the modes is no rival.
        """
        rivals = [rival for rival in self.rivals if not rival.same]
        sizes = [self._size(rival.errors) for rival in rivals]
        enough = (1.0 + JUDGING.worth) * min(sizes)
        return next(rival for rival, size in zip(rivals, sizes, strict=True) if size <= enough)

    @property
    def improvement(self) -> float:
        """Fraction by which several modes lower the held-out error of the best rival."""
        single = self._size(self.best.errors)
        return 1.0 - self._size(self.errors) / single if single > 0.0 else 0.0

    @property
    def gain(self) -> float:
        """The same in standard errors over blocks."""
        return certainty(self.best.errors, self.errors, self.unit, self.blocks)

    @property
    def is_sure(self) -> bool:
        """Whether the gain is more than chance, by as many blocks as there are."""
        limit = student_t.ppf(1.0 - 0.5 * JUDGING.chance, max(1, self.n_blocks - 1))
        return bool(self.gain > limit)

    @property
    def n_blocks(self) -> int:
        """How many stretches the samples are compared on."""
        return len(_parts(len(self.errors), self.blocks))

    @property
    def hidden(self) -> bool:
        """True if the rates show modes that no law of one mode imitates, and the columns do not."""
        if self.noise is None:
            return self.constant and self.told_share < JUDGING.half
        return self.improvement <= JUDGING.worth and self.told_share < JUDGING.told

    @property
    def told_share(self) -> float:
        """Part of the error of the best rival that modes leave which are told by the samples."""
        told, best = self.told_by_rates, self._size(self.best.errors)
        return self._size(told) / best if told is not None and best > 0.0 else np.inf

    @property
    def predicts_nothing(self) -> bool:
        """Whether the mean predicts as well; of columns at rest, of noise alone, it does."""
        moves = self.spread > (0.0 if self.noise is None else JUDGING.noise_alone * self.noise)
        return (
            bool(moves.any()) and relative_error(self.errors[:, moves], self.spread[moves]) >= 1.0
        )

    @property
    def lacks_something(self) -> bool:
        """True if no law of one mode leaves nothing but noise of measured states."""
        return self.noise is not None and not (self.noise_alone and self.law_stands)

    @property
    def noise_alone(self) -> bool:
        """True if a law of one mode leaves nothing but noise of what is held out."""
        return self.noise is not None and self._size(self.best.errors) <= JUDGING.noise_alone

    @property
    def verdict(self) -> Verdict:
        """What to say about the model."""
        # neighbouring rows may err alike; stretches of recordings each begin anew
        is_told = self.noise is not None and self.improvement > JUDGING.worth and self.is_sure
        if len(self.errors) < JUDGING.fewest_rows and not is_told:
            return Verdict.TOO_FEW
        if self.hidden:
            return Verdict.HIDDEN
        few = self.n_switches < JUDGING.fewest_switches
        if self.improvement <= JUDGING.worth:
            if self.explains and self.lacks_something:
                return Verdict.TOO_FEW if few else Verdict.UNREPEATED
            return Verdict.ONE_MODE if self.best is self.rivals[0] else Verdict.SMOOTH
        if self.predicts_nothing:
            return Verdict.USELESS
        if few:
            return Verdict.TOO_FEW
        return Verdict.SWITCHES if self.is_sure else Verdict.CHANCE

    def _size(self, errors: Array) -> float:
        return relative_error(errors, self.unit)


def relative_error(errors: Array, unit: Array) -> float:
    """Root mean square of errors (n_rows, n_columns), each column in its unit."""
    return float(np.sqrt(np.nanmean((errors / _scale(unit)) ** 2)))


def certainty(
    simple: Array, rich: Array, unit: Array, blocks: NDArray[np.intp] | None = None
) -> float:
    """Gain of a rich model over a simple one, in standard errors over blocks.

    The mean log ratio of the squared errors over its standard error, the blocks being
    independent; by default some contiguous ones. Ratios, because the errors of a decaying
    trajectory differ by decades between its blocks.
    """
    scale, n_rows = _scale(unit), len(simple)
    size = np.array([np.nansum((error / scale) ** 2, axis=1) for error in (simple, rich)])
    parts = _parts(n_rows, blocks)
    if len(parts) < 2:
        return 0.0
    means = np.array([size[:, part].mean(axis=1) for part in parts])
    ratios = np.diff(np.log(means + JUDGING.exact * means.max()), axis=1)[:, 0]
    error = ratios.std(ddof=1) / np.sqrt(len(ratios))
    return float(-ratios.mean() / error) if error > 0 else 0.0


def _parts(n_rows: int, blocks: NDArray[np.intp] | None) -> list[NDArray[np.intp]]:
    """Rows of each block."""
    if blocks is None:
        return np.array_split(np.arange(n_rows), max(1, min(JUDGING.blocks, n_rows)))
    return [np.flatnonzero(blocks == block) for block in np.unique(blocks)]


def count_switches(modes: NDArray[np.intp], groups: NDArray) -> int:
    """Changes of the mode from one row to the next of the same trajectory.

    Examples
    --------
    >>> count_switches(np.array([0, 1, 1, 0, 1]), np.array([1, 1, 1, 1, 2]))
    2
    """
    return int(np.sum((modes[1:] != modes[:-1]) & (groups[1:] == groups[:-1])))


def _scale(unit: Array) -> Array:
    return np.where(unit > 0, unit, 1.0)
