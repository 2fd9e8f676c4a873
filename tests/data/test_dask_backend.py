"""Searches on the workers of a Dask cluster give what they give in one process, bit for bit."""

from contextlib import contextmanager

import numpy as np
import pytest
from dask_cluster import executed, two_workers
from joblib import parallel_config
from sklearn.base import clone
from sklearn.model_selection import GridSearchCV
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from swsysid import EffectSearchCV, PolynomialSurfaceClassifier, SwitchingSystemRegressor
from swsysid.datasets import make_damped_oscillator, make_undeclared
from swsysid.effects import CoulombFriction, QuadraticDrag


@pytest.fixture(scope="module")
def client():
    with (
        two_workers() as cluster,
        pytest.importorskip("dask.distributed").Client(cluster) as client,
    ):
        yield client


@contextmanager
def on_every_worker(client):
    """joblib sends its tasks to the cluster; at the end each worker must have run some."""
    before = executed(client)
    with parallel_config("dask"):
        yield
    assert (executed(client) > before).all()


def in_one_process_and_on(client, search, *arguments, **options):
    """The same search fitted twice."""
    alone = clone(search).fit(*arguments, **options)
    with on_every_worker(client):
        spread = clone(search).fit(*arguments, **options)
    return alone, spread


def test_grid_search(client):
    data = make_damped_oscillator(400, noise=0.05, random_state=0)
    surface = PolynomialSurfaceClassifier(degree=2)
    model = SwitchingSystemRegressor(2, surface=surface, n_init=4, random_state=0)
    grid = {
        "switchingsystemregressor__surface__degree": [1, 2],
        "switchingsystemregressor__relaxation": ["exact", "simplex"],
    }
    search = GridSearchCV(make_pipeline(StandardScaler(), model), grid, cv=3)
    alone, spread = in_one_process_and_on(client, search, data.X, data.Xdot)
    names = [name for name in alone.cv_results_ if name.endswith("_test_score")]
    assert len(names) == 3 + 3  # of every fold; mean, standard deviation and rank
    for name in names:
        assert np.array_equal(spread.cv_results_[name], alone.cv_results_[name]), name
    assert spread.best_params_ == alone.best_params_
    X = alone.best_estimator_[:-1].transform(data.X)
    one, two = alone.best_estimator_[-1], spread.best_estimator_[-1]
    for attribute in ("coef_", "modes_", "membership_", "objective_"):
        assert np.array_equal(getattr(one, attribute), getattr(two, attribute)), attribute
    assert np.array_equal(one.predict_mode_proba(X), two.predict_mode_proba(X))


@pytest.mark.nightly
def test_effect_search(client):
    data = make_undeclared("coulomb_friction", system="oscillator", random_state=1)
    search = EffectSearchCV(data.estimator, effects=[CoulombFriction(), QuadraticDrag()])
    record = {"t": data.t, "groups": data.groups}
    alone, spread = in_one_process_and_on(client, search, data.X, data.Xdot, **record)
    assert [effect.kind for effect in spread.effects_] == ["coulomb_friction"]
    assert spread.report_.to_dict() == alone.report_.to_dict()
    assert np.array_equal(spread.predict(data.X, **record), alone.predict(data.X, **record))
