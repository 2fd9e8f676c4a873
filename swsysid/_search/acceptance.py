"""What may enter: significance, worth, and which of several explanations is preferred.

Every record has an endless rest that is significant and small, and a structure that bends to
anything explains whatever the first effect with a name leaves over. An addition must be more than
chance over all candidates would give *and* worth its terms.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from swsysid._noise import exact_below
from swsysid._results import Array
from swsysid._search.joint_fit import JointFit
from swsysid._search.workshop import TIE, Finding, Structure, Workshop

__all__ = ["Acceptance"]

_SHARE, _SHARE_OF_A_MODE = 0.01, 0.1  # of the squares that the declared model leaves over
_WORTH = 0.05  # nats a row, which is a held-out error smaller by five per cent
_CATCH_ALL = 0.25  # nats a row by which one more mode must be better than an effect with a name


@dataclass(frozen=True)
class Acceptance(Workshop):
    """Rules for additions to the declared model.

    Attributes
    ----------
    declared : JointFit
        The declared model, fitted to the rows of the search.
    significance : float
        Largest probability of an addition by chance.
    """

    declared: JointFit
    significance: float = 0.01

    @cached_property
    def _declared_squares(self) -> Array:
        exact = exact_below(self.targets) ** 2
        return np.asarray(np.maximum(self.squared_errors(self.declared), exact))

    def confirmed(self, structure: Structure) -> tuple[Structure, tuple[Finding, ...]]:
        """Without the terms that chance explains in the light of the others, the likeliest first.

        What is left, and a finding for each of its terms.
        """
        while terms := structure.fit.terms:
            findings = tuple(self.finding(structure, place) for place in range(len(terms)))
            worst = max(range(len(terms)), key=lambda place: findings[place].p_value)
            if findings[worst].p_value <= self.significance:
                return structure, findings
            structure = self.without(structure, worst)
        return self.priced(self.declared), ()

    def is_promising(self, current: Structure, best: Structure, n_candidates: int) -> bool:
        """True for a gain that chance over all candidates would not give, and worth its terms."""
        gain = current.cost - best.cost
        if gain < np.log(n_candidates / self.significance) or best.price >= current.price:
            return False
        shown = best.last.effect.shows_in_velocities
        return not shown or self._is_worth_it(current, best, gain)

    def _is_worth_it(self, current: Structure, best: Structure, gain: float) -> bool:
        """False for a gain that is real and small: every record has some of these.

        It must lower the error, and explain a share of what the declared model left over; one
        more mode, which can bend to anything, a larger one. A guard that remembers concerns the
        few rows inside its band.
        """
        effect = best.last.effect
        if effect.remembers:
            return True
        before, after = (self.squared_errors(one.fit, current.fit) for one in (current, best))
        explained = np.max((before - after) / self._declared_squares)
        needed = _SHARE_OF_A_MODE if effect.n_more_modes else _SHARE
        return gain >= _WORTH * len(self.rows) and bool(explained >= needed)

    def named(
        self, current: Structure, options: list[Structure], n_candidates: int
    ) -> list[Structure]:
        """Promising structures whose last term is more than one more mode, the cheapest first."""
        named = [
            option
            for option in options
            if not option.last.effect.n_more_modes
            and self.is_promising(current, option, n_candidates)
        ]
        return sorted(named, key=lambda option: option.price)

    def without_catch_all(
        self, options: list[Structure], named: list[Structure]
    ) -> list[Structure]:
        """Without one more mode, unless it is far better than every effect that has a name."""
        best = min((option.price for option in named), default=np.inf)
        limit = best - _CATCH_ALL * len(self.rows)
        return [
            option
            for option in options
            if not option.last.effect.n_more_modes or option.price < limit
        ]

    def preferred(self, options: list[Structure]) -> Structure:
        """The cheapest structure; of those as cheap, the simplest explanation."""
        least = min(option.price for option in options)
        ties = [option for option in options if option.price <= least + TIE]
        rank = {effect.kind: place for place, effect in enumerate(self.effects)}
        return min(ties, key=lambda option: (rank[option.last.effect.kind], option.price))
