"""What a guard is known by: switches at which it is zero, and samples at which it is not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from hashlib import blake2b
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton.columns import CLOCKS
from swsysid._automaton_search.few_columns import known, without_clocks
from swsysid._results import Array


class GuardTerms(NamedTuple):
    """What guards are polynomials of: all columns but some of the inputs, the last."""

    degree: int
    n_unseen: int = 0

    def seen(self, columns: Array) -> Array:
        """Columns that end with the clocks, those that no guard sees unknown."""
        unknown, end = columns.copy(), columns.shape[1] - len(CLOCKS)
        unknown[:, end - self.n_unseen : end] = np.nan
        return unknown


@dataclass(frozen=True)
class Crossed:
    """What one guard is known by."""

    columns: Array  # (n_switches, n_columns): where it is zero
    rates: Array  # of these, in the direction in which it rises
    errors: Array  # (n_switches,): of the instants
    ramps: Array  # (n_switches,): times to both sides at any of which it may be zero as well
    beside: Array  # (n_samples, n_columns): where it is not zero
    beside_rates: Array
    signs: Array  # (n_samples,): -1 where it is below zero, 1 where it is above
    shares: Array  # (n_samples,): by which they count
    stays: NDArray[np.intp]  # (n_samples,): number of the stay of each
    interval: float  # between two samples

    def of(self, some: NDArray[np.intp]) -> Crossed:
        """The same without the rows in which one of some columns is missing."""
        seen, beside = known(self.columns, some), known(self.beside, some)
        return Crossed(
            self.columns[seen],
            self.rates[seen],
            self.errors[seen],
            self.ramps[seen],
            self.beside[beside],
            self.beside_rates[beside],
            self.signs[beside],
            self.shares[beside],
            self.stays[beside],
            self.interval,
        )

    def told_by(self, some: NDArray[np.intp]) -> bytes:
        """A name of all that a guard of some columns is found from."""
        name = blake2b(some.tobytes())
        for part in (self.columns, self.rates, self.beside, self.beside_rates):
            name.update(part[:, some].tobytes())
        for part in (self.errors, self.ramps, self.signs, self.shares):
            name.update(part.tobytes())
        name.update(self.stays.tobytes())
        return name.digest()

    def turned(self, sign: float) -> Crossed:
        """The same of a guard of the other sign, if it is -1."""
        turned = sign * self.rates, sign * self.beside_rates, sign * self.signs
        return replace(self, rates=turned[0], beside_rates=turned[1], signs=turned[2])

    def beside_at(self, own: NDArray[np.bool_]) -> Crossed:
        """The same with some of the samples where it is not zero."""
        parts = self.beside, self.beside_rates, self.signs, self.shares
        beside, rates, signs, shares = (part[own] for part in parts)
        told = replace(self, beside=beside, beside_rates=rates, signs=signs, shares=shares)
        return replace(told, stays=self.stays[own])

    @classmethod
    def joined(cls, parts: Sequence[Crossed]) -> Crossed:
        """That of one surface which all of them cross; it does not see the clocks."""
        return cls(
            without_clocks(np.vstack([one.columns for one in parts])),
            np.vstack([one.rates for one in parts]),
            np.concatenate([one.errors for one in parts]),
            np.concatenate([one.ramps for one in parts]),
            without_clocks(np.vstack([one.beside for one in parts])),
            np.vstack([one.beside_rates for one in parts]),
            np.concatenate([one.signs for one in parts]),
            np.concatenate([one.shares for one in parts]),
            np.concatenate([one.stays for one in parts]),
            parts[0].interval,
        )
