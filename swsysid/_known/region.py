"""Coefficients that what is known allows: the rows lower <= A c <= upper, and cones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from swsysid._known.program import Cone, Steps
from swsysid._known.sentences import Energy, Names, Row, Sentence
from swsysid._results import Array

_INFEASIBLE = 2  # as HiGHS says it through SciPy
_NEAR = 1e-6  # of the size of a matrix, by which it is on the border of a cone
_MET = 1e-7  # of the sizes in a row, by which fixed coefficients may miss it


@dataclass(frozen=True)
class Region:
    """Linear constraints of coefficients (n_modes, n_equations, n_terms), and who says each.

    They hold in every mode alike, so that to rename modes changes nothing.
    """

    sentences: tuple[Sentence, ...]
    names: Names
    rows: Array  # (n_rows, n_modes, n_equations, n_terms): A as the sentences say
    lower: Array  # (n_rows,)
    upper: Array
    owner: NDArray[np.intp]  # (n_rows,): number of the sentence
    change: Array  # (n_terms, n_terms): coefficients times it are those of the sentences
    left_out: frozenset[int] = frozenset()  # numbers of sentences that are not held
    # matrices that must not be positive, (k, k, n_modes, n_equations, n_terms), of sentences
    cones: tuple[tuple[int, Array], ...] = ()

    @classmethod
    def of(
        cls, sentences: tuple[Sentence, ...], names: Names, left_out: frozenset[int] = frozenset()
    ) -> Region:
        """That of sentences; ValueError where names are unknown or nothing meets all of them."""
        named = {one for sentence in sentences for one in sentence.named(names)}
        rows: list[Row] = []
        owner: list[int] = []
        for number, sentence in enumerate(sentences):
            own = [] if number in left_out else list(sentence.rows(names, named))
            rows += own
            owner += [number] * len(own)
        matrix = np.array([row.matrix for row in rows]).reshape(-1, *names.shape)
        lower, upper = np.array([row[1:] for row in rows]).reshape(-1, 2).T
        change = np.eye(len(names.terms))
        numbers = np.array(owner, dtype=np.intp)
        region = cls(sentences, names, matrix, lower, upper, numbers, change, left_out)
        for number, sentence in enumerate(sentences):
            if isinstance(sentence, Energy) and number not in left_out:
                modes = range(names.n_modes)
                cones = tuple((number, sentence.cone(names, mode)) for mode in modes)
                region = replace(region, cones=region.cones + cones)
                region = region.faced()
                fixed, values = region.fixed
                bent = sentence.bent(names) & ~(fixed & (values == 0.0))
                if bent.any():
                    term = names.terms[bent.any(axis=(0, 1)).argmax()]
                    raise ValueError(
                        f'known="{sentence}" is of laws that are linear in states; one may have '
                        f"{term}: say which terms there are, or use feature_library=1."
                    )
        region.check(np.zeros(names.shape), np.ones(names.shape, dtype=bool))
        return region

    def faced(self) -> Region:
        """The same with what cones say in rows: nothing on their diagonal is positive.

        Where other rows keep it at zero all of its row of the matrix is zero: with x' = v an energy
        tells the stiffness, and of the damping the sign.
        """
        region = self
        for number, cone in self.cones:
            diagonal = np.einsum("kkmsf->kmsf", cone)
            region = region.with_rows(number, diagonal, -np.inf)
        while (one := region.zero_diagonal()) is not None:
            place, zero = one
            number, cone = region.cones[place]
            cones = [*region.cones]
            cones[place] = number, cone[~zero][:, ~zero]
            faces = cone[zero].reshape(-1, *region.names.shape)
            region = replace(region, cones=tuple(cones)).with_rows(number, faces, 0.0)
        return replace(region, cones=tuple(one for one in region.cones if len(one[1]) > 1))

    def zero_diagonal(self) -> tuple[int, NDArray[np.bool_]] | None:
        """Which cone has zeros on its diagonal that rows tell, and which they are."""
        told, values = self.fixed
        for place, (_, cone) in enumerate(self.cones):
            diagonal = np.einsum("kkmsf->kmsf", cone)
            size = _MET * np.abs(cone).max(initial=0.0)
            small = np.abs(np.tensordot(diagonal, values, 3)) <= size
            zero = small & ~(diagonal != 0.0)[:, ~told].any(axis=1)
            if zero.any():
                return place, zero
        return None

    def with_rows(self, number: int, rows: Array, lower: float) -> Region:
        """With rows lower <= rows c <= 0 of a sentence, those that say something."""
        rows = rows[(rows != 0.0).any(axis=(1, 2, 3))]
        return replace(
            self, rows=np.concatenate([self.rows, rows]),
            lower=np.append(self.lower, np.full(len(rows), lower)),
            upper=np.append(self.upper, np.zeros(len(rows))),
            owner=np.append(self.owner, np.full(len(rows), number)),
        )  # fmt: skip

    def tangent(self, coef: Array) -> Region:
        """With rows for the cones that coefficients reach or miss, in the directions of both."""
        region = self
        for number, cone in self.cones:
            reached = self.reached(cone, coef)
            rows = np.einsum("ik,ijmsf,jk->kmsf", reached, cone, reached)
            region = region.with_rows(number, rows, -np.inf)
        return region

    def n_bent(self, number: int, coef: Array) -> int:
        """Directions in which cones of a sentence hold coefficients."""
        counts = [self.reached(cone, coef).shape[1] for own, cone in self.cones if own == number]
        return sum(count * (count + 1) // 2 for count in counts)

    def reached(self, cone: Array, coef: Array, within: float = _NEAR) -> Array:
        """Directions in which coefficients are on the border of a cone or beyond, in columns."""
        values, vectors = np.linalg.eigh(np.tensordot(cone @ self.change.T, coef, 3))
        size = np.abs(cone).max() * np.abs(coef).max()
        return np.asarray(vectors[:, values > -within * size])

    def of_modes(self, n_modes: int) -> Region:
        """The same sentences of another number of modes."""
        if n_modes == self.names.n_modes:
            return self
        names = Names(self.names.equations, self.names.terms, n_modes)
        return Region.of(self.sentences, names, self.left_out).by(self.change)

    @property
    def whole(self) -> Region:
        """The same with no sentence left out."""
        return Region.of(self.sentences, self.names).by(self.change)

    def by(self, change: Array) -> Region:
        """The same of coefficients that times `change` (n_terms, n_terms) are these."""
        return replace(self, change=change @ self.change)

    def in_units(self, unit: Array) -> Region:
        """The same of coefficients that times `unit` (n_equations, n_terms) are these."""
        cones = tuple((number, cone * unit) for number, cone in self.cones)
        return replace(self, rows=self.rows * unit, cones=cones)

    def beside_columns(self, n_columns: int) -> Region:
        """The same with so many terms more, of which nothing is known."""
        names = self.names.terms + [f"column {k}" for k in range(n_columns)]
        more = [(0, 0)] * (self.rows.ndim - 1) + [(0, n_columns)]
        change = np.eye(len(names))
        change[: len(self.change), : len(self.change)] = self.change
        cones = tuple((number, np.pad(cone, [(0, 0), *more])) for number, cone in self.cones)
        return replace(
            self, names=Names(self.names.equations, names, self.names.n_modes),
            rows=np.pad(self.rows, more), change=change, cones=cones,
        )  # fmt: skip

    def without(self, *sentences: int) -> Region:
        """The same with some sentences less."""
        other = self._of_rows(~np.isin(self.owner, sentences))
        return replace(other, left_out=self.left_out.union(sentences))

    def beside(self, sentence: int, coef: Array, free: NDArray[np.bool_]) -> tuple[int, ...]:
        """Other sentences that say the same in part, as few as can be.

        Without them all that one says of the free coefficients is said by itself alone.
        """
        others = set(range(len(self.sentences))) - self.left_out - {sentence}
        if self._says_alone(sentence, others, coef, free):
            return ()
        beside = sorted(others)
        for one in sorted(others):
            fewer = [other for other in beside if other != one]
            if self._says_alone(sentence, others.difference(fewer), coef, free):
                beside = fewer
        return tuple(beside)

    def _says_alone(
        self, sentence: int, others: set[int], coef: Array, free: NDArray[np.bool_]
    ) -> bool:
        """True if others tell no sum of what it tells, and let its bounds be passed."""
        own, rest, both = (
            self._of_rows(np.isin(self.owner, list(some))).steps(coef, free)
            for some in ({sentence}, others, others | {sentence})
        )
        if both.rank < own.rank + rest.rank:
            return False
        reached = own.room <= _MET * np.maximum(1.0, np.abs(own.most).sum(axis=1))
        return all(
            rest.passes(*one) for one in zip(own.most[reached], own.room[reached], strict=True)
        )

    def _of_rows(self, some: NDArray[np.bool_]) -> Region:
        return replace(
            self, rows=self.rows[some], lower=self.lower[some], upper=self.upper[some],
            owner=self.owner[some],
            cones=tuple(one for one in self.cones if one[0] in self.owner[some]),
        )  # fmt: skip

    @cached_property
    def matrix(self) -> Array:
        """A, of the shape of `rows`."""
        return np.asarray(self.rows @ self.change.T)

    @property
    def equal(self) -> NDArray[np.bool_]:
        """Rows that are equalities."""
        return self.lower == self.upper

    @cached_property
    def fixed(self) -> tuple[NDArray[np.bool_], Array]:
        """Coefficients that rows tell one after the other, and their values."""
        flat = self.matrix.reshape(len(self.matrix), int(np.prod(self.names.shape)))
        told, values = np.zeros(flat.shape[1], dtype=bool), np.zeros(flat.shape[1])
        while True:
            left = (flat != 0.0) & ~told
            alone = np.flatnonzero(self.equal & (left.sum(axis=1) == 1))
            if not alone.size:
                return told.reshape(self.names.shape), values.reshape(self.names.shape)
            row, places = alone[0], left[alone].argmax(axis=1)
            place = places[0]
            values[place] = (self.lower[row] - flat[row][told] @ values[told]) / flat[row, place]
            told[place] = True

    @property
    def touched(self) -> NDArray[np.bool_]:
        """Coefficients of which anything is known."""
        told = (self.matrix != 0.0).any(axis=0)
        for _, cone in self.cones:
            told |= (cone @ self.change.T != 0.0).any(axis=(0, 1))
        return np.asarray(told)

    @property
    def related(self) -> NDArray[np.bool_]:
        """Coefficients, not fixed, that equalities tell by others."""
        left = (self.matrix != 0.0) & ~self.fixed[0]
        return np.asarray(left[self.equal & (left.sum(axis=(1, 2, 3)) > 1)].any(axis=0))

    @property
    def told_apart(self) -> NDArray[np.bool_]:
        """Coefficients, not fixed, that cannot all be zero."""
        told, values = self.fixed
        beside = np.einsum("rmsf,msf->r", self.matrix, values)
        apart = (self.lower > beside) | (self.upper < beside)
        return np.asarray(((self.matrix != 0.0) & ~told)[apart].any(axis=0))

    def closed(self, support: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """A choice of terms, those that equalities join to a chosen one chosen as well."""
        chosen = (support | self.told_apart) & ~self.fixed[0]
        joined = ((self.matrix != 0.0) & ~self.fixed[0])[self.equal]
        joined = joined[joined.sum(axis=(1, 2, 3)) > 1]
        while True:
            some = (joined & chosen).any(axis=(1, 2, 3))
            more = chosen | joined[some].any(axis=0)
            if (more == chosen).all():
                return chosen | self.fixed[0] & (self.fixed[1] != 0.0)
            chosen = more

    def sought(self, free: NDArray[np.bool_], possible: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Coefficients that are sought, of those `possible`, where without it these are `free`."""
        return ((self.related | self.told_apart) & possible | free) & ~self.fixed[0]

    @cached_property
    def box(self) -> tuple[Array, Array]:
        """Bounds of single coefficients."""
        low, high = np.full(self.names.shape, -np.inf), np.full(self.names.shape, np.inf)
        alone = (self.matrix != 0.0).sum(axis=(1, 2, 3)) == 1
        for row, *bounds in zip(
            self.matrix[alone], self.lower[alone], self.upper[alone], strict=True
        ):
            place = np.unravel_index(np.abs(row).argmax(), row.shape)
            ends = sorted(bound / row[place] for bound in bounds)
            low[place], high[place] = max(low[place], ends[0]), min(high[place], ends[1])
        return low, high

    @property
    def is_of_one_law(self) -> bool:
        """True if all modes, of which there are several, have the same coefficients."""
        every = np.ones(self.names.shape, dtype=bool)
        basis = self.steps(np.zeros(every.shape), every).basis.T.reshape(-1, *every.shape)
        _, values = self.fixed
        alike = np.abs(basis - basis[:, :1]).max(initial=0.0) < _MET
        return len(every) > 1 and bool(alike) and bool((values == values[0]).all())

    def steps(self, coef: Array, free: NDArray[np.bool_]) -> Steps:
        """What steps of free coefficients, in the order of their places, may be."""
        rows, now = self.matrix[:, free], np.einsum("rmsf,msf->r", self.matrix, coef)
        cones = tuple(
            Cone(np.tensordot(one, coef, 3), np.moveaxis(one[:, :, free], 2, 0))
            for one in (cone @ self.change.T for _, cone in self.cones)
        )
        return replace(_steps(rows, self.lower - now, self.upper - now), cones=cones)

    def check(self, coef: Array, free: NDArray[np.bool_]) -> None:
        """ValueError where no values of the free coefficients meet it beside the others.

        It names the fewest sentences that contradict each other.
        """
        every = range(len(self.sentences))
        if self._is_met(every, coef, free):
            return
        kept = list(every)
        for one in every:  # as few as can be, which are not the fewest of all
            fewer = [other for other in kept if other != one]
            if not self._is_met(fewer, coef, free):
                kept = fewer
        smaller = (some for size in range(1, len(kept)) for some in combinations(every, size))
        kept = next((list(some) for some in smaller if not self._is_met(some, coef, free)), kept)
        said = " and ".join(f'"{self.sentences[one]}"' for one in kept)
        if not free.all():
            raise ValueError(f"known={said} contradicts order=2, by which positions have speeds.")
        if len(kept) == 1:
            raise ValueError(f"known={said} excludes every law.")
        raise ValueError(f"known contradicts itself: {said} cannot hold together; leave one out.")

    def _is_met(self, sentences: Sequence[int], coef: Array, free: NDArray[np.bool_]) -> bool:
        own = self._of_rows(np.isin(self.owner, sentences))
        beside = np.einsum("rmsf,msf->r", own.matrix, np.where(free, 0.0, coef))
        rows, lower, upper = own.matrix[:, free], own.lower - beside, own.upper - beside
        sizes = np.abs(own.matrix).sum(axis=(1, 2, 3)) * max(1.0, np.abs(coef).max())
        alone = ~(rows != 0.0).any(axis=1)
        if ((lower > _MET * sizes) | (upper < -_MET * sizes))[alone].any():
            return False
        used = (rows != 0.0).any(axis=0)
        steps = _steps(rows[:, used], lower, upper)
        if used.any():
            answer = linprog(
                np.zeros(used.sum()), steps.most, steps.room, steps.equal, steps.gap,
                bounds=(None, None), method="highs",
            )  # fmt: skip
            if answer.status == _INFEASIBLE:
                return False
        begin, n_free = np.where(free, 0.0, coef), int(free.sum())
        nearest = own.nearest(begin, free, np.eye(n_free)) if own.cones else begin
        return not any(own.reached(cone, nearest, -_NEAR).size for _, cone in own.cones)

    def nearest(self, coef: Array, free: NDArray[np.bool_], metric: Array) -> Array:
        """The coefficients nearest to given ones that it allows, those that are not free kept.

        `metric` (n_free, n_free) is a positive matrix of the free ones.
        """
        moved = coef.copy()
        moved[free] += self.steps(coef, free).least(metric, np.zeros(len(metric)))
        return moved.clip(*self.box)


def _steps(rows: Array, lower: Array, upper: Array) -> Steps:
    """Those with lower <= rows z <= upper, rows without an entry left out."""
    some = (rows != 0.0).any(axis=1)
    equal, bounded = some & (lower == upper), some & (lower != upper)
    above, below = bounded & np.isfinite(upper), bounded & np.isfinite(lower)
    return Steps(
        rows[equal], lower[equal],
        np.vstack([rows[above], -rows[below]]), np.append(upper[above], -lower[below]),
    )  # fmt: skip
