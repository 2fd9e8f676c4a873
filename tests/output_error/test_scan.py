"""The score test promises what an estimate then keeps."""

from dataclasses import replace

import numpy as np
import pytest

from swsysid._data.records import make_records
from swsysid._output_error.engines import RATES
from swsysid._output_error.estimate import fitted
from swsysid._output_error.law import Law
from swsysid._output_error.rounds import started
from swsysid._output_error.scan import Candidate, RolloutScore, scores, shortlist
from swsysid._output_error.search import Search
from swsysid._output_error.stretches import Stretches
from swsysid.effects import Bias, PlacedEffect, Polynomial, QuadraticDrag


def decays(drag=0.03, seed=0):
    """v' = -0.5 v - drag v |v| from twelve starts, with noise of a hundredth."""
    rng, t = np.random.default_rng(seed), np.linspace(0.0, 3.0, 61)
    parts = []
    for start in rng.uniform(-2.0, 2.0, 12):
        # closed form of v' = -a v - b v |v|
        decay = np.exp(-0.5 * t)
        parts.append(start * decay / (1.0 + drag / 0.5 * abs(start) * (1.0 - decay)))
    v = np.concatenate(parts)
    groups = np.repeat(np.arange(12), len(t))
    noisy = v + 0.01 * rng.standard_normal(len(v))
    return make_records(noisy[:, None], 1, t=np.tile(t, 12), groups=groups, names=["v"])


@pytest.fixture(scope="module")
def declared():
    records = decays()
    stretches = Stretches.of(records, records, np.arange(len(records)))
    law = Law.of(lambda X: X[:, :1], np.ones((1, 1), dtype=bool), np.zeros((1, 1)))
    return stretches, fitted(law, stretches)


def test_one_step_promises_the_squares_that_the_estimate_takes_away(declared):
    stretches, fit = declared
    drag = Candidate(PlacedEffect(QuadraticDrag(), 0, 0), np.zeros((1, 0)))
    [found] = shortlist(fit.law, scores(fit), stretches, [drag])
    score = RolloutScore.of(fit, 0.0055)
    columns = found.effect.columns(stretches.seen, 0)[stretches.rows]
    promised = float(score.gains([found], [score.response(columns)])[0])
    after = fitted(fit.law.beside([found]), stretches, fit.courses, fit.noise, turns=1)
    kept = (np.sum(fit.left**2) - np.sum(after.left**2)) / fit.noise[0] ** 2
    assert promised == pytest.approx(kept, rel=0.1)
    # .03, and what 732 samples of that noise leave open
    assert after.law.coefficients(0)[0] == pytest.approx(0.03, abs=0.006)


def test_what_explains_nothing_is_not_estimated(declared):
    stretches, fit = declared
    with_drag = fitted(fit.law.beside([PlacedEffect(QuadraticDrag(), 0, 0)]), stretches)
    bias = Candidate(PlacedEffect(Bias(), "constant", 0), np.zeros((1, 0)))
    assert shortlist(with_drag.law, scores(with_drag), stretches, [bias]) == []


def test_every_kind_is_as_likely_as_any_other(declared):
    """Two disturbances, three kinds, and of one kind as many as there are places for it."""
    stretches, fit = declared
    library = [Bias(), QuadraticDrag(), Polynomial()]
    search = Search(RATES, stretches, library, [0], {}, significance=0.01, most=1)
    now = search.model(fit)
    count = sum(one.placed.effect.kind == "polynomial" for one in search.candidates)
    assert count > 1
    for effect, place, own in ((QuadraticDrag(), 0, 1), (Polynomial(), (0, 0, 0), count)):
        law = fit.law.beside([PlacedEffect(effect, place, 0)])
        model = search.model(fitted(law, stretches, fit.courses, fit.noise, turns=1))
        chance = search.gain(now, model).p_value
        assert search.p_value(now, model) == pytest.approx(min(1.0, 2 * 3 * own * chance))


def test_what_was_estimated_is_not_estimated_again_after_a_refutation(declared):
    """The second search has its answers from the first one, but for what was refuted."""
    stretches, fit = declared
    fits = []

    def counted(law, *args, **options):
        fits.append(law)
        return fitted(law, *args, **options)

    engine = replace(RATES, fitted=counted)
    library = [Bias(), QuadraticDrag(), Polynomial()]
    search = Search(engine, stretches, library, [0], {}, significance=0.01, most=1)
    first = started(search, fit.law)
    count, found = len(fits), first.findings[0].candidate
    again = started(search, fit.law)
    assert again.models[0] is first.models[0]
    assert again.findings[0].candidate == found
    fits.clear()
    other = started(replace(search, refuted=(found,)), fit.law)
    assert all(one.candidate.effect.kind != found.effect.kind for one in other.findings)
    alone = Search(engine, stretches, library, [0], {}, significance=0.01, most=1, refuted=(found,))
    assert len(fits) < 0.5 * count  # of further candidates fold by fold, and of values
    expected = started(alone, fit.law)
    free = np.zeros_like(fit.law.declared)
    told = started(search, Law.of(fit.law.library, free, np.full(free.shape, -0.4)))
    assert told.models[0].law.coef[0, 0] == -0.4  # another law is asked anew
    assert [one.p_value for one in other.findings] == [one.p_value for one in expected.findings]


def test_what_explains_less_than_is_worth_it_is_not_asked_of_other_stretches(declared):
    stretches, fit = declared
    search = Search(RATES, stretches, [QuadraticDrag(), Bias()], [0], {}, 0.01, most=1)
    placed = [PlacedEffect(QuadraticDrag(), 0, 0), PlacedEffect(Bias(), "constant", 0)]
    fits = [fitted(fit.law.beside([one]), stretches, fit.courses, fit.noise) for one in placed]
    kinds = [one.law.terms[-1].effect.kind for one in search._models(search.model(fit), fits)]
    assert kinds == ["quadratic_drag"]
