"""Folds that cannot make a candidate worth it any more are not fitted."""

from dataclasses import replace

import numpy as np
import pytest

from swsysid._data.records import make_records
from swsysid._output_error.criterion import Left, fall, most_share
from swsysid._output_error.engines import RATES, Unseen
from swsysid._output_error.estimate import fitted
from swsysid._output_error.law import Law
from swsysid._output_error.settings import SETTINGS
from swsysid._output_error.stretches import Stretches
from swsysid.effects import Bias, PlacedEffect, QuadraticDrag


@pytest.fixture(scope="module")
def declared():
    """v' = -0.5 v - 0.3 v |v| in closed form from twelve starts, with noise of a hundredth."""
    rng, t = np.random.default_rng(0), np.linspace(0.0, 3.0, 61)
    starts, decay = rng.uniform(-2.0, 2.0, 12)[:, None], np.exp(-0.5 * t)
    v = (starts * decay / (1.0 + 0.6 * np.abs(starts) * (1.0 - decay))).ravel()
    v += 0.01 * rng.standard_normal(len(v))
    groups = np.repeat(np.arange(12), len(t))
    records = make_records(v[:, None], 1, t=np.tile(t, 12), groups=groups, names=["v"])
    stretches = Stretches.of(records, records, np.arange(len(records)))
    law = Law.of(lambda X: X[:, :1], np.ones((1, 1), dtype=bool), np.zeros((1, 1)))
    return stretches, fitted(law, stretches)


def counting(asked, **others):
    """An engine that says which laws are fitted."""

    def counted(law, *args, **options):
        asked.append(law)
        return fitted(law, *args, **options)

    return replace(RATES, fitted=counted, **others)


def test_what_is_worth_it_is_judged_by_all_folds(declared):
    stretches, fit = declared
    asked = []
    folds = Unseen(counting(asked), stretches)
    now = folds.model(fit)
    drag = fit.law.beside([PlacedEffect(QuadraticDrag(), 0, 0)])
    wider = fitted(drag, stretches, fit.courses, fit.noise)
    asked.clear()
    expected, found = folds.model(wider), folds.worthwhile(wider, now)
    assert len(asked) == 2 * SETTINGS.n_folds
    assert fall(now.unseen, expected.unseen).share > 0.5
    np.testing.assert_array_equal(found.unseen.samples, expected.unseen.samples)
    # beside the law that is right a constant is worth nothing
    bias = drag.beside([PlacedEffect(Bias(), "constant", 0)])
    assert folds.worthwhile(fitted(bias, stretches, wider.courses, wider.noise), expected) is None


def test_folds_end_where_one_goes_astray(declared):
    stretches, fit = declared
    now, asked = Unseen(RATES, stretches).model(fit), []

    def astray(_, own, *__):
        return Left(np.full((len(own.rows), 1), np.inf), own.series)

    assert Unseen(counting(asked, left_over=astray), stretches).worthwhile(fit, now) is None
    assert len(asked) == 1


def test_the_share_of_the_first_samples_bounds_that_of_all():
    rng = np.random.default_rng(2)
    series = (np.arange(400),)
    before, after = (Left(size * rng.standard_normal((400, 2)), series) for size in (1.0, 0.7))
    shares = [most_share(before, after.samples[:n]) for n in (0, 100, 200, 400)]
    assert shares[0] == pytest.approx(1.0) and shares == sorted(shares, reverse=True)
    assert shares[-1] == pytest.approx(fall(before, after).share, rel=1e-12)


def test_a_fold_that_goes_astray_ends_it():
    """No more than is left can be won back: a third of the squares lost 25 times."""
    series = (np.arange(300),)
    before = Left(np.ones((300, 1)), series)
    assert most_share(before, np.full((100, 1), np.inf)) < 0.0
