"""The surface of an alternation: what is kept from one iteration to the next."""

from dataclasses import replace

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.linear_model import LogisticRegression

import swsysid._surfaces.mode_books
from swsysid import PolynomialSurfaceClassifier, SwitchingSystemRegressor
from swsysid._identification.problem import SwitchingProblem
from swsysid._losses import get_loss
from swsysid.relaxations import get_relaxation


def sectors(n_samples=600, seed=0):
    """States of the plane and three sectors that meet in a point."""
    X = np.random.default_rng(seed).uniform(-1, 1, (n_samples, 2))
    return X, np.digitize(np.arctan2(X[:, 1], X[:, 0]), [-np.pi / 3, np.pi / 3])


def problem(X, n_modes=3, coupling=100.0, surface=None):
    return SwitchingProblem(
        features=X,
        targets=X,
        coordinates=X,
        weight=np.ones(len(X)),
        n_modes=n_modes,
        loss=get_loss("l1"),
        relaxation=get_relaxation("exact"),
        surface=surface or PolynomialSurfaceClassifier(degree=1),
        coupling=coupling,
        scale=np.ones(X.shape[1]),
        outlying=np.zeros(len(X), dtype=bool),
    )


def test_a_refitted_surface_keeps_the_mode_book(monkeypatch):
    X, modes = sectors()
    given = problem(X)
    first = given.fit_surface(modes)
    monkeypatch.setattr(
        swsysid._surfaces.mode_books, "choose_mode_book", None
    )  # not called any more
    changed = modes.copy()
    changed[:5] = (changed[:5] + 1) % 3
    second = given.refit_surface(changed, first)
    np.testing.assert_array_equal(second.classifier.mode_book_, first.classifier.mode_book_)
    assert given.surface_cost(second, changed) <= given.surface_cost(first, changed)
    assert given.renew_book(changed, second) is second  # five samples are no reason


def test_a_refitted_surface_is_the_one_fitted_anew():
    X, modes = sectors()
    given = problem(X)
    changed = modes.copy()
    changed[:5] = (changed[:5] + 1) % 3
    warm = given.refit_surface(changed, given.fit_surface(modes))
    cold = given.fit_surface(changed)
    assert warm.classifier.objective_ == pytest.approx(cold.classifier.objective_, rel=1e-9)
    assert given.surface_cost(warm, changed) == pytest.approx(warm.classifier.objective_, rel=1e-9)


def test_the_mode_book_is_renewed_where_the_modes_are_others():
    X, modes = sectors()
    given = problem(X)
    separable = np.digitize(X[:, 0], [-0.3, 0.3])  # two surfaces do
    few = given.fit_surface(separable)
    assert few.classifier.mode_book_.shape == (3, 2)
    kept = given.refit_surface(modes, few)
    assert kept.classifier.mode_book_.shape == (3, 2)
    renewed = given.renew_book(modes, kept)
    assert renewed.classifier.mode_book_.shape == (3, 3)
    assert given.surface_cost(renewed, modes) < given.surface_cost(kept, modes)
    assert given.renew_book(modes, renewed) is renewed


def test_the_mode_book_is_chosen_anew_where_a_mode_dies():
    X, modes = sectors()
    given = problem(X)
    merged = np.minimum(modes, 1)
    surface = given.refit_surface(merged, given.fit_surface(modes))
    assert surface.classifier.mode_book_.shape == (2, 1)
    assert surface.penalty.shape == (len(X), 3)


def test_a_start_changes_nothing_but_the_time():
    X, modes = sectors()
    cold = PolynomialSurfaceClassifier(degree=1).fit(X, modes)
    warm = PolynomialSurfaceClassifier(degree=1).fit(X, modes, start=cold)
    assert warm.objective_ == pytest.approx(cold.objective_, rel=1e-9)
    np.testing.assert_allclose(warm.coef_, cold.coef_, rtol=1e-6, atol=1e-9)
    other = PolynomialSurfaceClassifier(degree=2).fit(X, modes)
    with pytest.raises(ValueError, match="start was fitted to other surface features"):
        PolynomialSurfaceClassifier(degree=1).fit(X, modes, start=other)


@pytest.mark.filterwarnings("ignore:Only 2 of 3 modes explain")
@pytest.mark.parametrize("seed", range(3))
def test_the_objective_never_increases_with_several_modes(seed):
    """Refits, kept books and renewed ones, from poor starts."""
    X, modes = sectors(400, seed)
    rng = np.random.default_rng(seed)
    fields = rng.standard_normal((3, 2, 2))
    Xdot = np.einsum("ikl,il->ik", fields[modes], X) + 0.02 * rng.standard_normal(X.shape)
    start = rng.integers(0, 3, len(X))
    surface = PolynomialSurfaceClassifier(degree=1)
    model = SwitchingSystemRegressor(3, surface=surface, init=start, random_state=0).fit(X, Xdot)
    objective = np.array([record.objective for record in model.history_])
    assert (np.diff(objective) <= 1e-9 * objective[:-1]).all()


def test_uncoupled_modes_have_no_surface():
    X, modes = sectors()
    assert problem(X, coupling=0.0, surface=LogisticRegression()).fit_surface(modes) is None


def test_starts_compared_on_some_rows_lead_to_the_same_answer(monkeypatch):
    """The best start goes on with all rows: same answer, whatever the order of the rows."""
    X, modes = sectors(900)
    rng = np.random.default_rng(1)
    fields = rng.standard_normal((3, 2, 2))
    Xdot = np.einsum("ikl,il->ik", fields[modes], X) + 0.01 * rng.standard_normal(X.shape)
    surface = PolynomialSurfaceClassifier(degree=1)
    model = SwitchingSystemRegressor(3, surface=surface, random_state=0)
    whole = clone(model).fit(X, Xdot)
    settings = replace(SwitchingSystemRegressor.settings, deciding=400)
    monkeypatch.setattr(SwitchingSystemRegressor, "settings", settings)
    few = clone(model).fit(X, Xdot)
    np.testing.assert_array_equal(few.modes_, whole.modes_)
    np.testing.assert_allclose(few.coef_, whole.coef_, rtol=1e-9, atol=1e-12)
    assert len(few.history_[-1].modes) == len(X)
    objective = np.array([record.objective for record in few.history_])
    assert (np.diff(objective) <= 1e-9 * objective[:-1]).all()
    order = rng.permutation(len(X))
    shuffled = clone(model).fit(X[order], Xdot[order])
    np.testing.assert_array_equal(shuffled.coef_, few.coef_)
    np.testing.assert_array_equal(shuffled.modes_, few.modes_[order])
