"""Nonlinear parameters of an effect in a law: from the values of a scan to those of least error."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
from joblib import Parallel, delayed
from numpy.linalg import LinAlgError
from scipy.optimize import minimize_scalar

from swsysid._journal import resumable
from swsysid._output_error.engines import Engine
from swsysid._output_error.estimate import Courses, Fit, cost
from swsysid._output_error.scan import special_cases, variants
from swsysid._output_error.settings import SETTINGS
from swsysid._output_error.stretches import Stretches
from swsysid._results import Array
from swsysid.effects import Effect, PlacedEffect, RateEffect

# Steps of a candidate at the last tie, before the best are estimated fold by fold. Of 47 candidates
# beside the law of an arm that sticks the best stayed the best, in 20 CPU s instead of 29.
_TURNS_OF_A_LOOK = 8
_TIES_OF_INSTANTS = (1.0,)  # of the nodes, where it is sought when something happens
_TURNS_OF_SCANS = 10  # of what acts once, each of what the one before explains and leaves
# of a value between its neighbours, and how often these move on: over a stretch held out
_TURNS_OF_REFINEMENT = 12
_BRACKETS = 12
# of the distance to its neighbour: there a value is at the end of what is looked for. Twelve
# turns of a golden section end .003 of it away
_AT_AN_END = 0.02


@dataclass(frozen=True)
class Values:
    """Where the values of an effect are looked for: beside all coefficients, on some stretches."""

    engine: Engine
    stretches: Stretches
    n_jobs: int | None = None

    def tried(
        self,
        fit: Fit,
        listed: Sequence[PlacedEffect],
        effects: Sequence[Effect],
        linear: Mapping[int, int],
    ) -> Iterator[Fit]:
        """Effects beside a fit in all their variants, and those that they are general cases of."""
        trials = [resumable(self._tried) for _ in listed]
        pairs = zip(trials, listed, strict=True)
        calls = (delayed(one)(fit, placed, effects, linear) for one, placed in pairs)
        return chain.from_iterable(Parallel(n_jobs=self.n_jobs)(calls))

    def _tried(
        self,
        fit: Fit,
        placed: PlacedEffect,
        effects: Sequence[Effect],
        linear: Mapping[int, int],
    ) -> list[Fit]:
        found, seen = list[Fit](), self.stretches.seen
        for one in (placed, *special_cases(placed, effects, seen)):
            for variant in variants(one, fit.law, linear, seen):
                with suppress(LinAlgError):  # one that nothing tells takes no other along
                    found += self.plausible(self.beside(fit, variant))
        return found

    def beside(self, fit: Fit, more: PlacedEffect) -> Iterator[Fit]:
        """A law with one effect more, and with one that acts ever more often."""
        law = fit.law.beside([more])
        # from rollouts of a law that sticks those of another one are not reached
        near = None if law.breaks else self.courses(fit)
        found = self.engine.fitted(law, self.stretches, near, fit.noise, 2, _TURNS_OF_A_LOOK)
        if isinstance(more.effect, RateEffect):
            found = self.followed(found)
        yield from self.rescanned(found) if more.effect.acts_once else (found,)

    def plausible(self, fits: Iterable[Fit]) -> Iterator[Fit]:
        """Those whose last effect has coefficients that it may have."""
        seen = self.stretches.seen
        # a force that moves a plant and one that it meets have different signs
        signs = (1.0, -1.0) if seen.static else (1.0,)
        for fit in fits:
            coef, effect = fit.law.coefficients(len(fit.law.terms) - 1), fit.law.terms[-1].effect
            if np.isfinite(fit.errors).all() and np.isfinite(coef).all():
                if any(effect.plausible(sign * coef) for sign in signs):
                    yield fit

    def followed(self, fit: Fit) -> Fit:
        """The last effect at ever larger values, each from the fit before, while it fits better.

        Beside a law that lacks it a rate as a whole shows far less than there is.
        """
        place = len(fit.law.terms) - 1
        term = fit.law.terms[place]
        (parameter,) = term.effect.parameters(self.stretches.seen, term.place)
        for value in parameter.values[parameter.values > term.theta[0]]:
            other = self._exchanged(fit, place, (float(value),))
            if not cost(other) < cost(fit):
                break
            fit = other
        return fit

    def rescanned(self, fit: Fit) -> Iterator[Fit]:
        """The last effect where what it explains and leaves shows it, and acting ever more often.

        The law without it has bent to what happens once, and shows only roughly when.
        """
        place, seen = len(fit.law.terms) - 1, self.stretches.seen
        while True:
            fit, left = self._settled(fit)
            yield fit
            term = fit.law.terms[place]
            coef = fit.law.coefficients(place)
            more = term.effect.once_more(seen, term.place, term.theta, coef, left)
            if more is None:
                return
            effect, theta = more
            other = self._with(fit, place, replace(term, effect=effect, theta=theta))
            if 2.0 * (cost(fit) - cost(other)) < SETTINGS.worthwhile:
                return
            fit = other

    def _settled(self, fit: Fit) -> tuple[Fit, Array]:
        """Where a scan of what it leaves moves it no further, and what it leaves there."""
        place, seen = len(fit.law.terms) - 1, self.stretches.seen
        for _ in range(_TURNS_OF_SCANS):
            term, coef = fit.law.terms[place], fit.law.coefficients(place)
            (score,) = self.engine.scores(fit, _TIES_OF_INSTANTS)
            left = score.missed(self.stretches)[:, [term.target]]
            theta = term.effect.rescanned(seen, term.place, term.theta, coef, left)
            other = self._exchanged(fit, place, tuple(theta))
            if not cost(other) < cost(fit):
                break
            fit = other
        return fit, left

    def refined(self, fit: Fit, place: int) -> Fit:
        """All of an effect of least error near those of the scan."""
        term = fit.law.terms[place]
        ranges = term.effect.parameters(self.stretches.seen, term.place)
        for number, parameter in enumerate(ranges):
            values = np.unique(parameter.values)
            if not parameter.exact and len(values) > 1:
                fit = self._refined_one(fit, place, number, values)
        return self.engine.fitted(fit.law, self.stretches, self.courses(fit), fit.noise)

    def are_at_an_end(self, fit: Fit) -> bool:
        """Whether one of the last effect is as far as it is looked for.

        What fits best there has its optimum beyond, where the effect is another one or none. What
        acts once may have acted before a recording begins.
        """
        term = fit.law.terms[-1]
        if term.effect.acts_once:
            return False
        ranges = term.effect.parameters(self.stretches.seen, term.place)
        for value, parameter in zip(term.theta, ranges, strict=True):
            values = np.unique(parameter.values)
            if not parameter.exact and len(values) > 2:
                gaps = np.diff(values)[[0, -1]]
                if (np.abs(value - values[[0, -1]]) < _AT_AN_END * gaps).any():
                    return True
        return False

    def courses(self, fit: Fit) -> Courses | None:
        """Where the states of all stretches are."""
        return fit.courses_of(range(len(self.stretches)))

    def _refined_one(self, fit: Fit, place: int, number: int, values: Array) -> Fit:
        """One of them, between its neighbours among some values and from there on."""
        best = fit

        def tried(value: float) -> float:
            nonlocal best
            theta = list(best.law.terms[place].theta)
            theta[number] = float(value)
            other = self._exchanged(best, place, tuple(theta))
            best = other if cost(other) < cost(best) else best
            return cost(other)

        options = {"maxiter": _TURNS_OF_REFINEMENT}
        for _ in range(_BRACKETS):
            start = best.law.terms[place].theta[number]
            at = int(np.abs(values - start).argmin())
            bounds = values[max(at - 1, 0)], values[min(at + 1, len(values) - 1)]
            minimize_scalar(tried, bounds=bounds, method="bounded", options=options)
            reached = best.law.terms[place].theta[number]
            nearest = int(np.abs(values - reached).argmin())
            if nearest == at:
                break
        return best

    def _exchanged(self, fit: Fit, place: int, theta: tuple[float, ...]) -> Fit:
        """The law with other values of an effect, from where its states are."""
        return self._with(fit, place, replace(fit.law.terms[place], theta=theta))

    def _with(self, fit: Fit, place: int, term: PlacedEffect) -> Fit:
        law = fit.law.exchanged(place, term)
        return self.engine.fitted(law, self.stretches, self.courses(fit), fit.noise, turns=1)
