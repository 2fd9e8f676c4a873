"""The rounds: scan, estimate what explains most, compare on unseen stretches, take the best."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import minimize_scalar

from swsysid._output_error.candidates import (
    Candidate,
    candidates,
    is_of_a_sensor,
    is_sought,
    variants,
)
from swsysid._output_error.criterion import Fall, Left, as_good, fall
from swsysid._output_error.estimate import Fitted, fitted, left_over
from swsysid._output_error.law import Law
from swsysid._output_error.scan import of_sensors, shortlist
from swsysid._output_error.settings import SETTINGS
from swsysid._output_error.stretches import Stretches
from swsysid._rendering.progress import progress
from swsysid._results import Array
from swsysid._ties import least_of
from swsysid.effects import Effect, PlacedEffect, UnknownFunction
from swsysid.effects._shapes import shapes


@dataclass(frozen=True, eq=False)
class Model:
    """A law fitted to all stretches, and what laws fitted to some of them leave of the others."""

    fit: Fitted
    unseen: Left

    @property
    def law(self) -> Law:
        """The law with its coefficients."""
        return self.fit.law


@dataclass(frozen=True)
class Finding:
    """An effect that was added, why, and what would have done as well."""

    candidate: PlacedEffect
    p_value: float  # of the fall on stretches that took no part in its fit, times all candidates
    rivals: tuple[PlacedEffect, ...]
    n_candidates: int


@dataclass(frozen=True)
class Search:
    """One search in the searched part of recordings, of those effects of a library that show there.

    `targets` are the states whose equations may lack something, `linear` the features that are
    multiples of channels, `refuted` effects that other stretches have spoken against.
    """

    stretches: Stretches
    library: Sequence[Effect]
    targets: list[int]
    linear: dict[int, int]
    significance: float
    most: int
    verbose: bool = False
    refuted: tuple[PlacedEffect, ...] = ()

    def run(self, declared: Law) -> tuple[list[Model], list[Finding]]:
        """The declared model and those with one effect more each; the effects."""
        models = [self.model(fitted(declared, self.stretches))]
        findings: list[Finding] = []
        with progress(self.most, "rounds of the search", self.verbose) as bar:
            while len(findings) < self.most:
                better = self.round(models[-1], models[0])
                bar.update()
                if better is None:
                    break
                model, finding = better
                models.append(model)
                findings.append(finding)
        return models, findings

    def model(self, fit: Fitted) -> Model:
        """A law fitted to all stretches, and fold by fold."""
        left, stretches, courses = [], [], fit.courses
        for train, test in self.stretches.folds():
            known, unknown = ([courses[number] for number in one] for one in (train, test))
            part = fitted(fit.law, self.stretches.some(train), known, fit.noise, turns=1)
            left.append(left_over(part, self.stretches.some(test), unknown).samples)
            stretches += test
        unseen = Left(np.vstack(left), self.stretches.some(stretches).series)
        return Model(fit, unseen)

    def round(self, now: Model, first: Model) -> tuple[Model, Finding] | None:
        """The best of the candidates beside a model; None if none is worth it.

        Worth it is what takes away a share of the squares that are left, and of those that the
        declared law has left at first.
        """
        listed = self.candidates
        best_of: dict[tuple, Fitted] = {}
        refuted = {_key(one) for one in self.refuted}
        sensors = [effect for effect in self.effects if is_of_a_sensor(effect)]
        asked = of_sensors(now.fit, self.stretches, sensors)
        for placed in (*shortlist(now.fit, self.stretches, listed), *asked):
            for fit in self._estimated(now, placed):
                key = _key(fit.law.terms[-1])
                if key in refuted:
                    continue
                if key not in best_of or self._cost(fit) < self._cost(best_of[key]):
                    best_of[key] = fit
        models = [self.model(fit) for fit in self._likeliest(list(best_of.values()))]
        done = self.gain(first, now).share
        models = [
            one
            for one in models
            if self.gain(now, one).share >= SETTINGS.worthwhile
            and self.gain(first, one).share - done >= SETTINGS.worth_telling
        ]
        found = self._chosen(models, now)
        if found is None:
            return None
        chosen, level = found
        p_value = min(1.0, len(listed) * self.gain(now, chosen).p_value)
        # the other half of the evidence may come from what is held out
        if p_value > np.sqrt(self.significance):
            return None
        own = chosen.law.terms[-1]
        rivals = {
            one.law.terms[-1].effect.kind: one.law.terms[-1]
            for one in reversed(level)
            if self._as_good(one, chosen, now) and one.law.terms[-1].effect.kind != own.effect.kind
        }
        return chosen, Finding(own, p_value, tuple(rivals.values()), len(listed))

    def _likeliest(self, fits: list[Fitted]) -> list[Fitted]:
        """Those of least cost, and of every other kind the best one.

        Ten monomials that bend alike are one explanation, and would be all that is compared.
        """
        fits = sorted(fits, key=self._cost)
        listed = fits[: SETTINGS.n_compared]
        kinds = {fit.law.terms[-1].effect.kind for fit in listed}
        for fit in fits[SETTINGS.n_compared :]:
            kind = fit.law.terms[-1].effect.kind
            if kind not in kinds:
                kinds.add(kind)
                listed.append(fit)
        return listed

    def _estimated(self, now: Model, placed: PlacedEffect) -> Iterator[Fitted]:
        """An effect beside a model in all its variants, and what it is a special case of."""
        seen, place = self.stretches.seen, placed.place
        theta = dict(zip(placed.effect.theta_names(seen, place), placed.theta, strict=True))
        simpler = [
            replace(placed, effect=effect, theta=tuple(theta[name] for name in names))
            for effect in self.effects
            if effect.kind in placed.effect.special_cases
            and set(names := effect.theta_names(seen, place)) <= set(theta)
        ]
        for one in (placed, *simpler):
            for variant in variants(one, now.law, self.linear, seen):
                law, noise = now.law.beside([variant]), now.fit.noise
                # from rollouts without a jump those with it are not reached
                near = now.fit.courses if law.breaks == now.law.breaks else None
                fit = fitted(law, self.stretches, near, noise, turns=2)
                if self._is_plausible(fit):
                    yield fit

    def _chosen(self, models: list[Model], now: Model) -> tuple[Model, list[Model]] | None:
        """The simplest that is as good as any, its nonlinear parameters refined, and its rivals."""
        while models:
            first, _ = self._simplest(models, now)
            # what is simpler may be as good once its parameters are no longer those of a grid
            few = first.law.n_parameters
            models = [
                one if one.law.n_parameters >= few else self._closer(one, now) for one in models
            ]
            first, level = self._simplest(models, now)
            chosen = self._closer(first, now)
            if not self._is_at_an_end(chosen):
                return chosen, level
            models = [one for one in models if one is not first]
        return None

    def _is_at_an_end(self, model: Model) -> bool:
        """Whether a nonlinear parameter of the last effect is as far as it is looked for.

        What fits best there has its optimum beyond, where the effect is another one or none.
        """
        term = model.law.terms[-1]
        ranges = term.effect.parameters(self.stretches.seen, term.place)
        for value, parameter in zip(term.theta, ranges, strict=True):
            values = np.unique(parameter.values)
            if not parameter.exact and len(values) > 2:
                gaps = np.diff(values)[[0, -1]]
                if (np.abs(value - values[[0, -1]]) < SETTINGS.at_an_end * gaps).any():
                    return True
        return False

    def _simplest(self, models: Sequence[Model], now: Model) -> tuple[Model, list[Model]]:
        """Of those that are as good as the best the one with the fewest parameters, and these."""
        shares = {one: self.gain(now, one).share for one in models}
        best = least_of(models, lambda one: -shares[one])
        level = [one for one in models if self._as_good(one, best, now)]
        chosen = min(level, key=lambda one: (one.law.n_parameters, self._rank(one), -shares[one]))
        return chosen, level

    def _closer(self, model: Model, now: Model) -> Model:
        """The same with nonlinear parameters and noise of its own, where that is better."""
        refined = self.model(self._refined(model.fit))
        is_better = self.gain(now, refined).share >= self.gain(now, model).share
        return refined if is_better or not model.law.terms[-1].theta else model

    def gain(self, before: Model, after: Model) -> Fall:
        """By how much the error of unseen stretches falls from one model to another."""
        return fall(before.unseen, after.unseen)

    @cached_property
    def effects(self) -> list[Effect]:
        """What is looked for."""
        return [effect for effect in self.library if is_sought(effect)]

    @cached_property
    def candidates(self) -> list[Candidate]:
        """What may be missing, the simplest explanation first."""
        seen = self.stretches.seen
        named = [effect for effect in self.effects if not isinstance(effect, UnknownFunction)]
        if len(named) < len(self.effects):
            named += [shape for shape in shapes(seen) if len(shape.channels) == 1]
        return list(candidates(named, seen, self.targets))

    @property
    def skipped(self) -> dict[str, str]:
        """Kinds that are not looked for in recordings of one law, and why."""
        seen, reasons = self.stretches.seen, {}
        for effect in self.library:
            missing = effect.missing(seen)
            if missing is not None:
                reasons[effect.kind] = missing
            elif not is_sought(effect):
                reasons[effect.kind] = "is not looked for in recordings of one law"
        return reasons

    def _rank(self, model: Model) -> int:
        """Place of the last effect in the library, the simplest explanation first."""
        kinds = [effect.kind for effect in self.effects]
        return kinds.index(model.law.terms[-1].effect.kind)

    def _cost(self, fit: Fitted) -> float:
        """Log of what is left of the states, in the mean."""
        return float(np.log(np.maximum(fit.errors, 1e-300)).mean())

    def _is_plausible(self, fit: Fitted) -> bool:
        place = len(fit.law.terms) - 1
        coef = fit.law.coefficients(place)
        finite = np.isfinite(fit.errors).all() and np.isfinite(coef).all()
        return bool(finite) and fit.law.terms[place].effect.plausible(coef)

    def _as_good(self, other: Model, best: Model, now: Model) -> bool:
        """Whether the best is not worth it beside another one, or not surely better.

        What explains less than half of it is not as good, however much that scatters.
        """
        if other is best:
            return True
        shares = [self.gain(now, one).share for one in (other, best)]
        return as_good(fall(other.unseen, best.unseen)) and shares[0] >= 0.5 * shares[1]

    def _refined(self, fit: Fitted) -> Fitted:
        """The nonlinear parameters of the last effect of least error near those of the scan."""
        place = len(fit.law.terms) - 1
        term = fit.law.terms[place]
        ranges = term.effect.parameters(self.stretches.seen, term.place)
        for number, parameter in enumerate(ranges):
            values = np.unique(parameter.values)
            if not parameter.exact and len(values) > 1:
                fit = self._refined_one(fit, number, values)
        return fitted(fit.law, self.stretches, fit.courses, fit.noise)

    def _refined_one(self, fit: Fitted, number: int, values: Array) -> Fitted:
        """One of them, between its neighbours among some values and from there on."""
        place, best = len(fit.law.terms) - 1, fit

        def tried(value: float) -> float:
            nonlocal best
            term = best.law.terms[place]
            theta = (*term.theta[:number], float(value), *term.theta[number + 1 :])
            law = best.law.exchanged(place, replace(term, theta=theta))
            other = fitted(law, self.stretches, best.courses, fit.noise, turns=1)
            cost = self._cost(other)
            best = other if cost < self._cost(best) else best
            return cost

        options = {"maxiter": SETTINGS.turns_of_refinement}
        for _ in range(SETTINGS.brackets):
            start = best.law.terms[place].theta[number]
            at = int(np.abs(values - start).argmin())
            bounds = values[max(at - 1, 0)], values[min(at + 1, len(values) - 1)]
            minimize_scalar(tried, bounds=bounds, method="bounded", options=options)
            reached = best.law.terms[place].theta[number]
            nearest = int(np.abs(values - reached).argmin())
            if nearest == at:
                break
        return best


def _key(placed: PlacedEffect) -> tuple:
    """What an effect is, whatever its parameters."""
    return placed.effect.kind, placed.place, placed.target
