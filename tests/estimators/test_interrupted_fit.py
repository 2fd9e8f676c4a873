"""A fit that is interrupted or fails leaves its estimator as it was; failures are told in words."""

import re
import signal
import sys
from concurrent.futures.process import BrokenProcessPool
from copy import copy

import numpy as np
import pytest
from joblib import Parallel, delayed
from sklearn.base import clone

from swsysid import (
    EffectRegressor,
    EffectSearchCV,
    HybridAutomaton,
    HybridAutomatonRegressor,
    IdentificationWarning,
    PolynomialSurfaceClassifier,
    SolverError,
    SwitchingSystemRegressor,
    TrajectoryIdentifier,
)
from swsysid._whole_or_nothing import failures_in_words
from swsysid.effects import CoulombFriction, PlacedEffect

RNG = np.random.default_rng(0)
X = RNG.uniform(-1.0, 1.0, (120, 2))
XDOT = np.column_stack([X[:, 1], -X[:, 0] - np.where(X[:, 0] > 0.0, 0.1, 0.5) * X[:, 1]])
T = np.arange(120) * 0.1
RELAY = HybridAutomaton.stated(
    [{"T": "-0.1 (T - 30)"}, {"T": "-0.1 (T - 10)"}],
    [(0, 1, "T >= 22"), (1, 0, "T <= 18")],
    states=["T"],
)
TIMES = np.arange(0.0, 12.0, 0.2)
RECORDINGS = [{"t": TIMES, "x": RELAY.simulate([start], TIMES, mode=0).x} for start in (17.0, 19.0)]
SWITCHING = SwitchingSystemRegressor(2, n_init=1, random_state=0)
FITS = {
    "SwitchingSystemRegressor": (SWITCHING, (X, XDOT), {}),
    "PolynomialSurfaceClassifier": (PolynomialSurfaceClassifier(1), (X, X[:, 0] > 0.0), {}),
    "EffectRegressor": (
        EffectRegressor(SWITCHING, [PlacedEffect(CoulombFriction(), place=1, target=1)]),
        (X, XDOT),
        {},
    ),
    "EffectSearchCV": (
        EffectSearchCV(SwitchingSystemRegressor(1), effects=[CoulombFriction()]),
        (X, XDOT),
        {"t": T},
    ),
    "TrajectoryIdentifier": (
        TrajectoryIdentifier(SwitchingSystemRegressor(1, feature_library=1, random_state=0)),
        ([{"t": part["t"][:15], "x": part["x"][:15]} for part in RECORDINGS],),
        {},
    ),
    "HybridAutomatonRegressor": (
        HybridAutomatonRegressor(2, random_state=0),
        (RECORDINGS,),
        {},
    ),
}
PARTS = (0.05, 0.5, 0.95)  # of the calls of a fit, at which it is interrupted
LAST = (100, 20, 5)  # calls before its end


class Interrupted:
    """Calls of Python functions are counted; after so many the user presses Ctrl-C."""

    def __init__(self, after=None):
        self.after, self.count = after, 0

    def __enter__(self):
        sys.setprofile(self._called)
        return self

    def __exit__(self, *_):
        sys.setprofile(None)

    def _called(self, frame, event, argument):
        if event == "call":
            self.count += 1
            if self.count == self.after:
                raise KeyboardInterrupt


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", FITS)
def test_an_interrupted_fit_leaves_the_estimator_as_it_was(name):
    unfitted, data, options = FITS[name]
    fitted = clone(unfitted).fit(*data, **options)
    again = clone(unfitted)
    with Interrupted() as whole:
        again.fit(*data, **options)
    places = {int(part * whole.count) for part in PARTS} | {whole.count - k for k in LAST}
    n_interrupted = 0
    for place in sorted(places):
        for estimator in (clone(unfitted), copy(fitted)):
            before = dict(vars(estimator))
            try:
                with Interrupted(place):
                    estimator.fit(*data, **options)
            except KeyboardInterrupt:
                n_interrupted += 1
                after = vars(estimator)
                assert after.keys() == before.keys()
                assert all(after[key] is value for key, value in before.items()), place
    # caches make the number of calls vary, so that the last places may lie after the end
    assert n_interrupted >= 2 * len(PARTS)


@pytest.mark.filterwarnings("ignore")
def test_a_search_stopped_on_other_data_answers_as_the_first_one():
    """The effects, the equations and the report of one fit, never of two."""
    search, data, options = FITS["EffectSearchCV"]
    search = clone(search).fit(*data, **options)
    told = search.equations(), str(search.report_), search.effects_
    with pytest.raises(ValueError, match="contains NaN"):
        search.fit(X, np.where(X > 0.9, np.nan, 3.0 * XDOT), **options)
    other = clone(search)
    with Interrupted() as whole:
        other.fit(X, 3.0 * XDOT, **options)
    with pytest.raises(KeyboardInterrupt), Interrupted(whole.count // 2):
        search.fit(X, 3.0 * XDOT, **options)
    assert (search.equations(), str(search.report_), search.effects_) == told


# -- failures from below ---------------------------------------------------------------------------


def test_a_killed_worker_is_a_sentence():
    with pytest.raises(SolverError, match="a smaller n_jobs") as caught, failures_in_words():
        Parallel(n_jobs=2)(delayed(signal.raise_signal)(signal.SIGKILL) for _ in range(2))
    assert isinstance(caught.value.__cause__, BrokenProcessPool)
    assert str(caught.value).count(". ") == 0


def test_a_refinement_that_fails_does_not_lose_what_was_found(monkeypatch):
    def fails(*_, **__):
        raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setattr("swsysid._automaton_search.continuous.refined", fails)
    noise = np.random.default_rng(0)
    recordings = [
        one | {"x": one["x"] + 0.02 * noise.standard_normal(one["x"].shape)} for one in RECORDINGS
    ]
    with pytest.warns(IdentificationWarning, match="could not be refined together") as told:
        found = HybridAutomatonRegressor(2, random_state=0).fit(recordings)
    assert {one.filename for one in told} == {__file__}
    assert found.refinement_ is None and found.n_modes_ == 2 and found.transitions_


@pytest.mark.parametrize("name", FITS)
def test_linear_algebra_that_fails_is_a_sentence(name, monkeypatch):
    def fails(*_, **__):
        raise np.linalg.LinAlgError("SVD did not converge in Linear Least Squares")

    for room in ("swsysid._regressor", "swsysid._classifier", "swsysid._effect_regressor"):
        monkeypatch.setattr(sys.modules[room], "column_names", fails)
    unfitted, data, options = FITS[name]
    with pytest.raises(SolverError, match=re.escape("(SVD did not converge")):
        clone(unfitted).fit(*data, **options)
