"""One more mode begins beyond a threshold: regressions on both sides of it, and planted ones."""

import numpy as np
import pytest

from swsysid import EffectSearchCV, SwitchingSystemRegressor
from swsysid._effect_search.restarts import best_cut
from swsysid.effects import ExtraMode, Polynomial

NO_FLOOR = np.zeros(2)


def _rows(n_rows=240, seed=0):
    rng = np.random.default_rng(seed)
    X = rng.uniform(-1.0, 1.0, (n_rows, 2))
    features = np.column_stack([np.ones(n_rows), X])
    return X, features, 0.1 * rng.standard_normal((n_rows, 2))


def _squares(features, targets):
    coef = np.linalg.lstsq(features, targets, rcond=None)[0]
    return np.sum((targets - features @ coef) ** 2, axis=0)


def test_the_gain_is_that_of_two_regressions_at_the_best_of_all_thresholds():
    X, features, targets = _rows()
    x = X[:, 0]
    cut = best_cut(features, targets, x, 30, 400, NO_FLOOR)
    by_hand = []
    for level in np.sort(x)[29:-30]:  # thirty rows on each side at least
        two = sum(_squares(features[side], targets[side]) for side in (x <= level, x > level))
        by_hand.append(0.5 * len(x) * np.log(_squares(features, targets) / two).sum())
    assert cut.gain == pytest.approx(max(by_hand), rel=1e-9)


def test_a_law_that_changes_beyond_a_threshold_is_cut_there():
    X, features, targets = _rows()
    beyond = X[:, 1] > 0.5
    targets[beyond, 0] += 1.0 - X[beyond, 0]
    cuts = [best_cut(features, targets, values, 24, 400, NO_FLOOR) for values in X.T]
    assert cuts[1].gain > 5.0 * cuts[0].gain
    # a row next to the threshold may be on the wrong side
    assert len(np.setxor1d(cuts[1].rows, np.flatnonzero(beyond))) <= 2


def test_equal_values_stay_together_and_few_rows_are_not_cut():
    X, features, targets = _rows()
    steps = np.round(X[:, 0])  # an input with three values
    cut = best_cut(features, targets, steps, 24, 17, NO_FLOOR)
    inside = np.zeros(len(steps), dtype=bool)
    inside[cut.rows] = True
    assert all(len(set(inside[steps == value])) == 1 for value in np.unique(steps))
    assert best_cut(features[:40], targets[:40], steps[:40], 24, 17, NO_FLOOR) is None


def test_what_is_exact_is_not_explained_better():
    X, features, _ = _rows()
    targets = features @ np.ones((3, 2))
    cut = best_cut(features, targets, X[:, 0], 24, 17, np.full(2, 1e-6))
    assert cut.gain == pytest.approx(0.0, abs=1e-9)


def test_a_mode_that_few_rows_have_is_found():
    rng = np.random.default_rng(1)
    X = rng.uniform(-1.0, 1.0, (900, 2))
    law = np.column_stack([X[:, 1], -2.0 * X[:, 0] - 0.5 * X[:, 1]])
    stop = X[:, 0] > 0.9  # one row in twenty; chance starts find it in three seeds of six
    law[stop, 1] -= 3.0 * X[stop, 0]
    Xdot = law + 0.05 * rng.standard_normal(law.shape)
    groups = np.repeat(np.arange(12), 75)
    search = EffectSearchCV(SwitchingSystemRegressor(1), effects=[Polynomial(), ExtraMode()])
    search.fit(X, Xdot, groups=groups)
    (found,) = search.effects_
    assert found.kind == "extra_mode"
    assert found.parameters["share_of_rows"] == pytest.approx(stop.mean(), abs=0.01)
