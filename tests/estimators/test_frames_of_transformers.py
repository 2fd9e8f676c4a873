"""Nothing depends on what scikit-learn's transformers are told to make of their output."""

import numpy as np
import pandas as pd
import pytest
import sklearn
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler

from swsysid import (
    FunctionLibrary,
    HybridAutomaton,
    HybridAutomatonRegressor,
    PolynomialSurfaceClassifier,
    SwitchingSystemRegressor,
    TrajectoryIdentifier,
)
from swsysid.__main__ import main
from swsysid.datasets import make_damped_oscillator
from swsysid.diagnosis import EffectSearchCV
from swsysid.effects import Bias

DATA = make_damped_oscillator(300, noise=0.01, random_state=0)
FRAME = pd.DataFrame(DATA.X, columns=["x", "v"])

THERMOSTAT = HybridAutomaton.stated(
    [{"T": "-0.5 (T - 30)"}, {"T": "-0.5 (T - 10)"}],
    [(0, 1, "T >= 22"), (1, 0, "T <= 20")],
    states=["T"],
)
TIMES = np.arange(0.0, 6.0, 0.05)


def _noisy(seed):
    states = THERMOSTAT.simulate([20.0], TIMES, mode=0).x
    return states + 0.01 * np.random.default_rng(seed).standard_normal(states.shape)


def _regressor(library, n_modes=2, **more):
    return SwitchingSystemRegressor(n_modes, feature_library=library, random_state=0, **more)


def _scaled_squares():
    return make_pipeline(StandardScaler(), PolynomialFeatures(2))


def _of_rows(estimator):
    return lambda: estimator.fit(FRAME, DATA.Xdot).predict(FRAME)


def _of_effects():
    search = EffectSearchCV(_regressor(1), effects=[Bias()], random_state=0)
    return search.fit(FRAME, DATA.Xdot).predict(FRAME)


def _of_recordings():
    identifier = TrajectoryIdentifier(_regressor(1))
    return identifier.fit(pd.DataFrame(_noisy(0), columns=["T"]), TIMES).estimator_.coef_


def _of_automata():
    return HybridAutomatonRegressor(random_state=0).fit(_noisy(1), TIMES).automaton_.coef


FITS = {
    "degree": _of_rows(_regressor(2)),
    "number of modes": _of_rows(_regressor(1, n_modes="auto")),
    "functions": _of_rows(_regressor(FunctionLibrary([np.positive, np.sin]))),
    "pipeline": _of_rows(_regressor(_scaled_squares())),
    "surface": _of_rows(
        _regressor(1, surface=PolynomialSurfaceClassifier(feature_library=_scaled_squares()))
    ),
    "effects": _of_effects,
    "recordings": pytest.param(_of_recordings, marks=pytest.mark.nightly),
    "automata": pytest.param(_of_automata, marks=pytest.mark.nightly),
}


@pytest.mark.parametrize("fit", FITS.values(), ids=FITS)
@pytest.mark.filterwarnings("ignore::UserWarning")  # what a fit warns about is not asked here
def test_a_fit_is_the_same_where_transformers_make_frames(fit):
    usual = fit()
    with sklearn.config_context(transform_output="pandas"):
        np.testing.assert_array_equal(fit(), usual)


def test_a_fit_needs_no_package_that_makes_the_frames():
    usual, fit = FITS["pipeline"](), FITS["pipeline"]
    with sklearn.config_context(transform_output="polars"):
        np.testing.assert_array_equal(fit(), usual)


def test_the_command_line_is_the_same_where_transformers_make_frames(tmp_path, capsys):
    pd.DataFrame({"t": TIMES, "T": _noisy(2)[:, 0]}).to_csv(tmp_path / "run.csv", index=False)
    asked = [str(tmp_path / "run.csv"), "--states", "T", "--time", "t", "--quick"]
    told = []
    for kind in ("default", "pandas"):
        with sklearn.config_context(transform_output=kind):
            assert main([*asked, "--output", str(tmp_path / "saved")]) == 0
        told.append(capsys.readouterr().out)
    assert told[0] == told[1]
