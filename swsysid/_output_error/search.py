"""A round: scan, estimate what explains most, compare on unseen stretches, take the best."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np
from numpy.linalg import LinAlgError

from swsysid._journal import is_open, step
from swsysid._output_error import scan
from swsysid._output_error.criterion import Fall, Left, as_good, fall, price
from swsysid._output_error.engines import (
    Engine,
    Finding,
    Model,
    Unseen,
    as_likely,
    of_other_kinds,
)
from swsysid._output_error.estimate import Fit, cost
from swsysid._output_error.law import Law
from swsysid._output_error.likeness import names_for
from swsysid._output_error.scan import Candidate, of_sensors, shortlist
from swsysid._output_error.settings import SETTINGS
from swsysid._output_error.stretches import Stretches
from swsysid._output_error.values import Values
from swsysid._remembered import Answer, Remembered
from swsysid._stays.nodes import Rows
from swsysid._ties import least_of
from swsysid.effects import Effect, PlacedEffect

_N_COMPARED = 6  # on stretches that they were not fitted to
_LATELY = 64  # answers that are kept, all of them of about five rounds


@dataclass(frozen=True)
class Search:
    """One search in the searched part of recordings, of those effects of a library that show there.

    `targets` are the states whose equations may lack something, `linear` the features that are
    multiples of channels, `refuted` effects that other stretches have spoken against,
    `held_out_rows` those of stretches that take part in no choice, if there are any.
    """

    engine: Engine
    stretches: Stretches
    library: Sequence[Effect]
    targets: list[int]
    linear: dict[int, int]
    significance: float
    most: int
    n_jobs: int | None = None
    verbose: bool = False
    refuted: tuple[PlacedEffect, ...] = ()
    held_out_rows: Rows = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    lately: Remembered = field(default_factory=lambda: Remembered(_LATELY), repr=False)

    def disturbed(self, disturbance: float) -> Search:
        """The same search for a law with another disturbance."""
        return replace(self, stretches=replace(self.stretches, disturbance=disturbance))

    def declared(self, law: Law) -> Model:
        """The declared law, fitted to all stretches and fold by fold."""
        own = self.stretches
        asked = own.disturbance, law.declared.tobytes(), law.known.tobytes()
        return self.known(own.parts, asked, lambda: self.model(self.engine.fitted(law, own)))

    def model(self, fit: Fit) -> Model:
        """A law fitted to all stretches, and fold by fold."""
        return self.known(fit, "by folds", partial(self.folds.model, fit))

    @step
    def round(self, now: Model, first: Model) -> tuple[Model, Finding] | None:
        """The best of the candidates beside a model; None if none is worth it.

        Worth it is what takes away a share of the squares that are left, and of those that the
        declared law has left at first.
        """
        refuted = {self._key(one) for one in self.refuted}
        fits = self.known(now, tuple(self.library), partial(self._beside, now))
        fits = [fit for fit in fits if self._key(fit.law.terms[-1]) not in refuted]
        models = [*self._models(now, self._likeliest(fits))]
        done = self.gain(first, now).share
        models = [
            one
            for one in models
            if self.gain(now, one).share >= SETTINGS.worthwhile
            and self.gain(first, one).share - done >= self._least(one)
            and self._pays(now, one, 1.0)
        ]
        # what acts once pays for its choices, and is no simpler or harder than another time
        happened = [one for one in models if one.law.terms[-1].effect.acts_once]
        if happened:
            likeliest = least_of(happened, lambda one: self._log_p_value(now, one))
            models = [one for one in models if one is likeliest or one not in happened]
        found = self._chosen(models, now)
        if found is None:
            return None
        chosen, level = found
        own, gained = chosen.law.terms[-1], self.gain(now, chosen)
        level = [one for one in level if self._as_good(one, chosen, now)]
        models = [one for one in models if self.gain(now, one).share >= 0.5 * gained.share]
        rivals, behind = (of_other_kinds(own, some) for some in (level, models))
        # evidence grows as the record does
        log_p = self._log_p_value(now, chosen)
        longer = 1.0 + max(0.0, log_p - np.log(self.significance)) / gained.nats
        count, p_value = len(self.candidates), self.p_value(now, chosen)
        return chosen, Finding(own, p_value, rivals, behind, count, gained.share, float(longer))

    def is_likely(self, finding: Finding) -> bool:
        """Whether chance hardly explains it; half of the evidence may be in what is held out."""
        return bool(finding.p_value <= np.sqrt(self.significance))

    def _beside(self, now: Model) -> list[Fit]:
        """Candidates beside a model, the best values of each."""
        best_of: dict[tuple, Fit] = {}
        sensors = [effect for effect in self.effects if scan.is_of_a_sensor(effect)]
        left = self.engine.left_of(now.fit, self.stretches) if sensors else np.zeros((0, 0))
        asked = of_sensors(now.law, left, self.stretches, sensors)
        corrected = self.stretches.corrected(now.law.terms)
        try:
            scores = self.engine.scores(now.fit)
        except LinAlgError:  # no step from here says anything
            return []
        listed = [*shortlist(now.law, scores, corrected, self.candidates), *asked]
        tried = partial(self.values.tried, now.fit, effects=self.effects, linear=self.linear)
        fits = [*tried(listed)]
        count = self.gain(now, now).count
        for fit in [*fits, *tried(names_for(fits, self.candidates, self.stretches, count))]:
            own = fit.law.terms[-1]
            # beside a channel's own term it always fits better: whether surely, is asked later
            key = (*self._key(own), own.replaced, len(own.theta), len(own.effect.terms))
            best_of[key] = min(best_of.get(key, fit), fit, key=cost)
        return list(best_of.values())

    def _models(self, now: Model, fits: Sequence[Fit]) -> Iterator[Model]:
        """Laws that fit best, fold by fold, if every fold tells all of their coefficients.

        Not what explains less of its own than half of what is worth it, or a name does of unseen.
        """
        series, most = self.stretches.series, SETTINGS.worthwhile
        for fit in sorted(fits, key=cost):
            own = fall(Left(now.fit.left, series), Left(fit.left, series)).share
            if own < 0.5 * most:
                continue
            with suppress(LinAlgError):
                model = self.known(fit, "worthwhile", partial(self.folds.worthwhile, fit, now))
                if model is None:
                    continue
                is_sure = self._pays(now, model, self.significance)
                if is_sure and not (model.is_nameless or self.values.are_at_an_end(fit)):
                    most = max(most, self.gain(now, model).share)
                yield model

    def known(self, about: object, question: Hashable, answer: Callable[[], Answer]) -> Answer:
        """An answer that searches without one more refuted effect ask for again.

        Steps of a journal are numbered: where one is kept the work is done anew.
        """
        return answer() if is_open() else self.lately.of(about, (question,), answer)

    def _likeliest(self, fits: list[Fit]) -> list[Fit]:
        """Those of least cost, and the best one of each of the best kinds.

        Ten monomials that bend alike are one explanation, and would be all that is compared.
        """
        fits = sorted(fits, key=cost)
        listed = fits[:_N_COMPARED]
        best_of: dict[tuple[str, int | None], Fit] = {}
        for fit in fits:
            own = fit.law.terms[-1]
            best_of.setdefault((own.effect.kind, own.replaced), fit)
        others = list(best_of.values())[:_N_COMPARED]
        return listed + [fit for fit in others if all(fit is not one for one in listed)]

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
            is_inside = not self.values.are_at_an_end(chosen.fit)
            if is_inside and self._pays(now, chosen, self.significance):
                return chosen, level
            models = [one for one in models if one is not first]
        return None

    def _simplest(self, models: Sequence[Model], now: Model) -> tuple[Model, list[Model]]:
        """Of those that are as good as the best the one with the fewest parameters, and these.

        What happens rarely unseen stretches hardly tell: all samples may surely tell more.
        """
        shares = {one: self.gain(now, one).share for one in models}
        best = self._best_name(models, shares)
        level = [one for one in models if self._as_good(one, best, now)]
        # a function without a name that is no better says less than any name
        named = [one for one in level if one.is_nameless <= best.is_nameless]
        likely = as_likely(named, self.gain(now, best).count, self.significance)
        level = [one for one in level if one in likely or one not in named]
        chosen = min(likely, key=lambda one: (one.law.n_parameters, self._rank(one), -shares[one]))
        return chosen, level

    def _best_name(self, models: Sequence[Model], shares: dict[Model, float]) -> Model:
        """The best; in the place of a function without a name the best name that is about as good.

        That function can be any: a name that explains nearly all of it says more, and so does one
        beside which further evidence does not pay for further parameters.
        """
        best = least_of(models, lambda one: -shares[one])
        named = [one for one in models if not one.is_nameless]
        if not named or not best.is_nameless:
            return best
        name = least_of(named, lambda one: -shares[one])
        lost = self.gain(name, best)
        more = price(best.law.n_parameters - name.law.n_parameters, lost.count)
        nearly_all = shares[name] >= (1.0 - SETTINGS.worthwhile) * shares[best]
        return name if nearly_all or as_good(lost, 0.0) or lost.nats < more else best

    def _closer(self, model: Model, now: Model) -> Model:
        """The same with nonlinear parameters and noise of its own, where that is better."""
        refined_fit = partial(self.values.refined, model.fit, len(model.law.terms) - 1)
        try:
            refined = self.model(self.known(model.fit, "refined", refined_fit))
        except LinAlgError:
            return model
        is_better = self.gain(now, refined).share >= self.gain(now, model).share
        return refined if is_better or not model.law.terms[-1].theta else model

    def gain(self, before: Model, after: Model) -> Fall:
        """By how much the error of unseen stretches falls from one model to another."""
        return fall(before.unseen, after.unseen)

    def p_value(self, now: Model, model: Model) -> float:
        """Of a last effect, for all that could have been chosen in its place."""
        return float(np.exp(min(0.0, self._log_p_value(now, model))))

    def _log_p_value(self, now: Model, model: Model) -> float:
        """Its logarithm, or more than 0.

        Every kind is as likely as any other, and one of sixty monomials less than one lag.
        """
        gained, own = self.gain(now, model), model.law.terms[-1].effect
        kinds = Counter(one.placed.effect.kind for one in self.candidates)
        *compared, _ = self.engine.disturbances  # the last one is asked if these show nothing
        asked = len(compared) + (self.stretches.disturbance not in compared)
        count = asked * len(kinds) * max(1, kinds[own.kind])
        return float(np.log(count * own.choices(self.stretches.seen, gained.count)) - gained.nats)

    def _least(self, model: Model) -> float:
        """Share of what the declared law has left that is worth telling.

        Of what acts once, and predicts nothing of other times, as much as of what is left now.
        """
        acts_once = model.law.terms[-1].effect.acts_once
        return SETTINGS.worthwhile if acts_once else SETTINGS.worth_telling

    def _pays(self, now: Model, model: Model, most: float) -> bool:
        """Whether the evidence for what acts once is worth its choice, up to a p-value.

        Where it is not, it hides nothing that predicts.
        """
        return not model.law.terms[-1].effect.acts_once or self.p_value(now, model) < most

    @cached_property
    def held_out(self) -> Stretches:
        """The stretches that took part in no choice, as long as they are."""
        return self.stretches.of_rows(self.held_out_rows, fewest=1)

    def held_out_left(self, model: Model) -> Left:
        """What a model leaves of them."""
        left = partial(self.engine.left_over, model.fit, self.held_out)
        return self.known(model.fit, "held out", left)

    @property
    def folds(self) -> Unseen:
        """Parts of the stretches, of which each is predicted by a fit to the others."""
        return Unseen(self.engine, self.stretches, self.n_jobs)

    @property
    def values(self) -> Values:
        """Nonlinear parameters are looked for on the same stretches."""
        return Values(self.engine, self.stretches, self.n_jobs)

    @cached_property
    def effects(self) -> list[Effect]:
        """What is looked for."""
        return [effect for effect in self.library if scan.is_sought(effect)]

    @cached_property
    def candidates(self) -> list[Candidate]:
        """What may be missing, the simplest explanation first."""
        seen = self.stretches.seen
        listed = partial(scan.all_candidates, self.effects, seen, self.targets)
        return self.known(seen, (*self.library, *self.targets), listed)

    def _key(self, placed: PlacedEffect) -> tuple:
        """What an effect is, whatever its parameters."""
        return placed.effect.kind, placed.label(self.stretches.seen.names), placed.target

    def _rank(self, model: Model) -> int:
        """Place of the last effect in the library, the simplest explanation first."""
        kinds = [effect.kind for effect in self.effects]
        return kinds.index(model.law.terms[-1].effect.kind)

    def _as_good(self, other: Model, best: Model, now: Model) -> bool:
        """Whether the best is not worth it beside another one, or not surely better.

        What explains less than half of it is not as good, however much that scatters.
        """
        if other is best:
            return True
        explained = self.gain(now, other).share / self.gain(now, best).share
        return explained >= 0.5 and as_good(fall(other.unseen, best.unseen), self.significance)
