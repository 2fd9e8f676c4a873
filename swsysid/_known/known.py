"""`Known`: what is known of the laws before a fit."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from swsysid._checks.parameters import real, shown
from swsysid._known.grammar import read
from swsysid._known.region import Region
from swsysid._known.sentences import (
    REST,
    Energy,
    Guard,
    Names,
    Only,
    Part,
    Relation,
    Same,
    Sentence,
    Without,
)

OF_TRANSITIONS = "each transition of an automaton has a guard of its own"  # why it takes none


@dataclass(frozen=True, repr=False)
class Known:
    """What is known of the laws before a fit: values, missing terms, bounds, ties, relations.

    An object never changes: every method returns another one, so that they are written in a chain.
    Equations and terms are named as the printed equations have them, ``"v'"`` and ``"x"``; a
    constant is the term ``"1"``. Everything holds in every mode. It can be wrong: after a fit
    `known_` says of each sentence what the data would rather have.

    Parameters
    ----------
    sentences, columns : tuple, default=()
        Left to the methods, `from_text` and `of_columns`.

    See Also
    --------
    TrajectoryIdentifier : Takes it as ``known=``.

    Examples
    --------
    >>> from swsysid import Known
    >>> known = Known().equal("x' = v").fix("v'", "1", -9.81).bound("v'", "v", upper=0)
    >>> known = known.tie("v'", "u").zero("v'", "x v")
    >>> print(known)
    x' = v
    v'[1] = -9.81
    v'[v] <= 0
    v'[u] same in all modes
    v' has no x v
    >>> Known.from_text(str(known).splitlines()) == known
    True
    """

    sentences: tuple[Sentence, ...] = ()
    columns: tuple[str, ...] = ()  # of rows whose columns have no names, () as they have them

    @classmethod
    def from_text(cls, sentences: str | Iterable[str]) -> Known:
        """That of sentences, one or several.

        Parameters
        ----------
        sentences : str or iterable of str
            ``"x' = v"`` (the whole law), ``"v'[x] = -9.81"``, ``"-1 <= v'[v] <= 0"``,
            ``"v'[x] = 2 w'[x]"`` (coefficients), ``"x0' + x1' + x2' = 0"`` (laws),
            ``"v' has no u"``, ``"v' has no other terms"``, ``"v' has only x, v"``,
            ``"v'[u] same in all modes"``, ``"v' same in all modes"``, ``"guard x >= 0.5"``,
            ``"guard x + 2 v >= *"``, ``"guard has only 1, x"``, ``"energy 4 x^2 + v^2 never
            rises"``. A name with a sign or comma in it stands in backquotes.

        Returns
        -------
        Known

        Raises
        ------
        ValueError
            Where a sentence cannot be read.

        Examples
        --------
        >>> Known.from_text(["x'=v", "v' has no u"])
        Known.from_text(["x' = v", "v' has no u"])
        """
        listed = [sentences] if isinstance(sentences, str) else list(sentences)
        return cls(tuple(dict.fromkeys(map(read, listed))))

    def fix(self, equation: str, term: str, value: float) -> Known:
        """A coefficient is `value`; the other terms stay free."""
        level = real("value", value)
        return self._and(Relation((Part(1.0, _law(equation), term),), level, level))

    def zero(self, equation: str, *terms: str) -> Known:
        """A law has none of some terms; ``"*"`` are all that nothing else is known of."""
        return self._and(Without(_law(equation), _some(terms)))

    def terms(self, equation: str, terms: Sequence[str]) -> Known:
        """A law has no other terms than these."""
        listed = [terms] if isinstance(terms, str) else list(terms)
        return self._and(Only(_law(equation), _some(listed)))

    def tie(self, equation: str, *terms: str) -> Known:
        """Terms have one coefficient in all modes; without terms the whole law is the same."""
        return self._and(*(Same(_law(equation), term) for term in terms or (REST,)))

    def bound(
        self, equation: str, term: str, *, lower: float | None = None, upper: float | None = None
    ) -> Known:
        """A coefficient is at least `lower` and at most `upper`."""
        low = -np.inf if lower is None else real("lower", lower)
        high = np.inf if upper is None else real("upper", upper)
        if lower is None and upper is None:
            raise ValueError("bound needs lower or upper, such as upper=0.")
        if low > high:
            raise ValueError(f"bound of {equation}[{term}] excludes everything: {low} > {high}.")
        return self._and(Relation((Part(1.0, _law(equation), term),), low, high))

    def equal(self, *sentences: str) -> Known:
        """What sentences say; as `from_text`, in a chain."""
        return self._and(*map(read, sentences))

    def dissipates(self, energy: str) -> Known:
        """A quadratic energy such as ``"4 x^2 + v^2"`` never rises, in any mode, without inputs.

        Laws are linear in the states; of laws with constants it is the energy of the difference of
        two motions.

        Examples
        --------
        >>> print(Known().dissipates("4 x^2 + v^2"))
        energy 4 x^2 + v^2 never rises
        """
        return self._and(read(f"energy {energy} never rises"))

    def guard(self, sentence: str) -> Known:
        """Where modes change: ``"x >= 0.5"``, ``"x + 2 v >= *"``, ``"has only 1, x"``.

        A threshold of ``*`` is sought, and so is which mode is on which side.
        """
        return self._and(read(f"guard {sentence}"))

    @property
    def of_laws(self) -> Known | None:
        """The same without guards; None if nothing is left."""
        own = tuple(one for one in self.sentences if not isinstance(one, Guard))
        return replace(self, sentences=own) if own else None

    def of_columns(self, names: Sequence[str]) -> Known:
        """The same of rows without names, whose columns are called so here."""
        return replace(self, columns=tuple(names))

    def without(self, left_out: frozenset[int]) -> Known:
        """The same without sentences of some numbers."""
        own = enumerate(self.sentences)
        return replace(self, sentences=tuple(one for k, one in own if k not in left_out))

    def of_guard(self, left_out: frozenset[int] = frozenset()) -> Guard | None:
        """What it says of guards, some sentences left out; ValueError where that is two things."""
        own = [
            one
            for number, one in enumerate(self.sentences)
            if isinstance(one, Guard) and number not in left_out
        ]
        if len(own) > 1:
            raise ValueError(
                f'known says "{own[0]}" and "{own[1]}", and all surfaces have one shape; say it in '
                "one sentence, such as guard has only 1, x, v."
            )
        return own[0] if own else None

    def region(
        self,
        equations: Sequence[str],
        terms: Sequence[str],
        n_modes: int,
        left_out: frozenset[int] = frozenset(),
    ) -> Region:
        """The constraints of the coefficients (n_modes, n_equations, n_terms).

        Sentences of some numbers may be left out.
        """
        return Region.of(self.sentences, Names(equations, terms, n_modes), left_out)

    def _and(self, *sentences: Sentence) -> Known:
        return replace(self, sentences=tuple(dict.fromkeys((*self.sentences, *sentences))))  # once

    def __add__(self, other: Known) -> Known:
        return self._and(*other.sentences)

    def __len__(self) -> int:
        return len(self.sentences)

    def __iter__(self) -> Iterator[str]:
        return iter(map(str, self.sentences))

    def __str__(self) -> str:
        return "\n".join(self)

    def __repr__(self) -> str:
        listed = ", ".join(f'"{one}"' for one in self)
        return f"Known.from_text([{listed}])" if listed else "Known()"


def check_known(known: object) -> Known | None:
    """None, a `Known`, or sentences of one."""
    if known is None or isinstance(known, Known):
        return known if known else None
    if isinstance(known, (str, list, tuple)):
        return Known.from_text(known) if known else None
    raise TypeError(f'known={shown(known)} must be a Known or sentences such as "x\' = v".')


def known_laws(known: object, why: str) -> Known | None:
    """The same of what has no surface between all modes, `why` it has none."""
    found = check_known(known)
    if found is not None and (guard := found.of_guard()) is not None:
        raise ValueError(f'known="{guard}" is of the surfaces of a fit, and {why}; leave it out.')
    return found


def refuse_energies(known: Known) -> None:
    """ValueError where it has an energy, in discrete time."""
    if any(isinstance(one, Energy) for one in known.sentences):
        raise ValueError(
            "An energy that never rises is known of velocities, and maps have none; leave it out."
        )


def both_known(one: Known | None, other: Known | None) -> Known | None:
    """What either says."""
    return one if other is None else other if one is None else one + other


def _law(equation: object) -> str:
    if not isinstance(equation, str) or not equation:
        raise TypeError(f"equation={shown(equation)} must be the left side of a law, such as v'.")
    return equation.removesuffix("[k+1]").removesuffix("'")


def _some(terms: Iterable[object]) -> tuple[str, ...]:
    listed = tuple(terms)
    if not listed or not all(isinstance(one, str) and one for one in listed):
        raise TypeError(f"terms={shown(listed)} must be names of terms, such as 'x'.")
    return tuple(map(str, listed))
