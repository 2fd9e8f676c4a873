"""The one verdict about a switching model: is switching there, and how sure is that."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from swsysid._cli.held_out import certainty, relative_error
from swsysid._cli.laws import Terms
from swsysid._results import Array

__all__ = ["Comparison", "Rival", "Verdict", "count_switches"]

WORTH = 0.05  # a richer model must lower the error by this fraction to be worth having
CERTAIN = 2.0  # standard errors from which on a gain is called certain
HALF = 0.5  # of the error of a smooth law: modes that leave less are no imitation of a curve
FEWEST_ROWS = 50  # held-out rows that allow a verdict
FEWEST_SWITCHES = 5  # changes of the mode that allow one


class Verdict(Enum):
    """What the held-out samples say about a model of several modes."""

    SWITCHES = "several modes predict clearly better than any smooth law that was tried"
    SMOOTH = "a smooth law with more terms is as good"
    ONE_MODE = "one mode with the same terms is as good"
    CHANCE = "several modes predict better, which may be chance"
    TOO_FEW = "too few rows or switches to judge"
    USELESS = "nothing predicts better than the mean"
    HIDDEN = "the surface is constant: the columns do not say which mode is active"


@dataclass(frozen=True)
class Rival:
    """A law of a single mode and its errors on the held-out rows.

    Attributes
    ----------
    terms : Terms
    errors : ndarray of shape (n_rows, n_rates)
    """

    terms: Terms
    errors: Array


@dataclass(frozen=True)
class Comparison:
    """A model of several modes against laws of one mode, on rows that none of them has seen.

    Attributes
    ----------
    errors : ndarray of shape (n_rows, n_rates)
        Of the model of several modes.
    rivals : tuple of Rival
        Laws of one mode: with the same terms first, then with more of them.
    spread : ndarray of shape (n_rates,)
        Standard deviation of the held-out rates.
    n_switches : int
        Changes of the mode along the trajectories.
    constant : bool
        The surface gives one mode to all samples.
    told_by_rates : ndarray of shape (n_rows, n_rates), or None
        Errors where each sample has the mode that its own rates tell; None if they do not tell.
    untested : tuple of int
        Modes that are (nearly) absent from the training part; the held-out rows of these are left
        out.
    """

    errors: Array
    rivals: tuple[Rival, ...]
    spread: Array
    n_switches: int
    constant: bool
    told_by_rates: Array | None
    untested: tuple[int, ...]

    @property
    def best(self) -> Rival:
        """The rival of the smallest error; of laws that hardly differ the one of fewest terms."""
        least = min(self._size(rival.errors) for rival in self.rivals)
        return next(r for r in self.rivals if self._size(r.errors) <= (1.0 + WORTH) * least)

    @property
    def improvement(self) -> float:
        """Fraction by which several modes lower the held-out error of the best rival."""
        single = self._size(self.best.errors)
        return 1.0 - self._size(self.errors) / single if single > 0.0 else 0.0

    @property
    def gain(self) -> float:
        """The same in standard errors over contiguous blocks."""
        return certainty(self.best.errors, self.errors, self.spread)

    @property
    def hidden(self) -> bool:
        """True if the rates show modes that no law of one mode imitates, and the columns do not."""
        if not self.constant or self.told_by_rates is None:
            return False
        return self._size(self.told_by_rates) < HALF * self._size(self.best.errors)

    @property
    def verdict(self) -> Verdict:
        """What to say about the model."""
        if len(self.errors) < FEWEST_ROWS:
            return Verdict.TOO_FEW
        if self.hidden:
            return Verdict.HIDDEN
        if self.improvement <= WORTH:
            return Verdict.ONE_MODE if self.best is self.rivals[0] else Verdict.SMOOTH
        if self._size(self.errors) >= 1.0:
            return Verdict.USELESS
        if self.n_switches < FEWEST_SWITCHES:
            return Verdict.TOO_FEW
        return Verdict.SWITCHES if self.gain > CERTAIN else Verdict.CHANCE

    def _size(self, errors: Array) -> float:
        return relative_error(errors, self.spread)


def count_switches(modes: NDArray[np.intp], groups: NDArray) -> int:
    """Changes of the mode from one row to the next of the same trajectory.

    Examples
    --------
    >>> count_switches(np.array([0, 1, 1, 0, 1]), np.array([1, 1, 1, 1, 2]))
    2
    """
    return int(np.sum((modes[1:] != modes[:-1]) & (groups[1:] == groups[:-1])))
