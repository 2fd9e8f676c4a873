"""Refinement on rollouts: closed forms, planted truths, hidden states, and what it refuses."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares
from sklearn.base import clone
from sklearn.linear_model import LogisticRegression
from sklearn.svm import SVC

from swsysid import PolynomialSurfaceClassifier, Status, SwitchingSystemRegressor
from swsysid.differentiation import differentiate
from swsysid.refinement import ParametricLibrary, StatedModel, StatedSurface, initial_states, refine

NOISE = 0.02


def _oscillator(damping=(0.1, 0.5), stiffness=1.0, surface=(0.0, -1.0, 0.0), free=None):
    """Damping differs on the two sides of q = 0."""
    coef = [[[0.0, 1.0], [-stiffness, -d]] for d in damping]
    free = [[[0, 0], [1, 1]]] * 2 if free is None else free
    return StatedModel(
        None, coef, states=["q", "v"], surface=StatedSurface([surface]), free=np.array(free, bool)
    )


def _samples(model, starts, times, noise=NOISE, seed=0, columns=slice(None)):
    rng = np.random.default_rng(seed)
    records = []
    for start in starts:
        x = model.simulate(start, times).x[:, columns]
        records.append({"t": times, "x": x + noise * rng.standard_normal(x.shape)})
    return records


STARTS = ((2.0, 0.0), (0.0, -2.0), (-1.5, 1.0), (1.0, 2.0))
COARSE = np.arange(0.0, 12.0, 0.8)  # eight samples a period


# --- hand cases and planted truths ------------------------------------------------------------


def test_a_decay_of_known_rate():
    t = np.linspace(0.0, 3.0, 7)
    model = StatedModel(None, [[-0.5]], states=["x"])
    result = refine(model, {"t": t, "x": 3.0 * np.exp(-2.0 * t)})
    assert result.values == pytest.approx([-2.0], abs=1e-4)  # error of the integration
    assert result.initial_states == pytest.approx(np.array([[3.0]]), abs=1e-4)
    assert result.status is Status.OPTIMAL and result.improved
    assert model.coef_ == pytest.approx(-0.5)  # the start is left alone
    assert result.rmse_after[0, 0] < 1e-4 < result.rmse_before[0, 0]
    assert "x', x" in result.summary() and "Converged" in result.advice


@pytest.mark.parametrize("loss", ["linear", "huber"])
@pytest.mark.parametrize("rate", [0.0, -2.0])
def test_a_start_at_rest_and_residuals_of_zero_have_units(rate, loss):
    """A start without any velocity, on data that move and on data that it fits exactly."""
    t = np.linspace(0.0, 3.0, 7)
    model = StatedModel(None, [[0.0]], states=["x"], free=[[True]])
    result = refine(model, {"t": t, "x": 3.0 * np.exp(rate * t)}, loss=loss)
    assert result.values == pytest.approx([rate], abs=1e-3)  # error of the integration


def test_the_estimate_and_its_error_are_those_of_nonlinear_least_squares():
    """x0 exp(-k t) fitted by scipy: the same numbers, white noise, equal standard errors."""
    rng = np.random.default_rng(0)
    t = np.linspace(0.0, 3.0, 400)
    x = 3.0 * np.exp(-t) + 0.1 * rng.standard_normal(400)
    result = refine(StatedModel(None, [[-0.5]], states=["x"]), {"t": t, "x": x})
    fit = least_squares(lambda p: p[0] * np.exp(p[1] * t) - x, [2.0, -0.5])
    covariance = np.linalg.inv(fit.jac.T @ fit.jac) * 2 * fit.cost / 398
    assert result.values[0] == pytest.approx(fit.x[1], abs=1e-5)
    assert result.initial_states[0, 0] == pytest.approx(fit.x[0], abs=1e-5)
    # Newey and West's estimate of the same number has a spread of its own, some 10 %
    assert result.standard_errors[0] == pytest.approx(np.sqrt(covariance[1, 1]), rel=0.3)


def test_regression_is_biased_where_samples_are_coarse_and_refinement_is_not():
    truth = _oscillator()
    records = _samples(truth, STARTS * 3, COARSE)
    X, Xdot, *_ = differentiate(
        np.vstack([r["x"] for r in records]),
        np.concatenate([r["t"] for r in records]),
        np.repeat(np.arange(12), len(COARSE)),
        method="finite_difference",
    )
    modes = (X[:, 0] < 0).astype(int)  # even with the modes known
    regressed = np.array(
        [np.linalg.lstsq(X[modes == m], Xdot[modes == m], rcond=None)[0].T for m in (0, 1)]
    )
    start = StatedModel(
        None, regressed, states=["q", "v"], surface=StatedSurface([[0.1, -1.0, 0.0]])
    )
    result = refine(start, records, fit_surface=True)
    bias = np.abs(regressed - truth.coef_)
    error = np.abs(result.model.coef_ - truth.coef_)
    assert bias.max() > 0.15
    assert error.max() < 0.04
    deviation = error / result.coef_standard_errors
    assert deviation.max() < 3.5 and np.sqrt(np.mean(deviation**2)) < 1.6  # eight numbers
    assert np.abs(result.model.surface.predict([[0.05, 1.0], [-0.05, 1.0]])).tolist() == [0, 1]
    np.testing.assert_allclose(result.rmse_after, NOISE, rtol=0.5)
    assert (result.rmse_after < result.rmse_before).all()


@pytest.mark.nightly
def test_standard_errors_cover_the_truth():
    """Twenty draws of the noise: standardised errors have the size one within sampling."""
    standardised = []
    for seed in range(20):
        records = _samples(_oscillator(), STARTS, COARSE, seed=100 + seed)
        result = refine(_oscillator((0.2, 0.3)), records)
        error = (result.model.coef_ - _oscillator().coef_)[result.coef_standard_errors > 0]
        standardised.append(error / result.standard_errors)
    size = np.sqrt(np.mean(np.square(standardised)))
    assert 0.7 < size < 1.5


def test_a_fitted_estimator_is_refined_and_stays_one():
    records = _samples(_oscillator(), STARTS * 3, np.arange(0.0, 12.0, 0.25))
    X, Xdot, *_ = differentiate(
        np.vstack([r["x"] for r in records]),
        np.concatenate([r["t"] for r in records]),
        np.repeat(np.arange(12), 48),
    )
    model = SwitchingSystemRegressor(
        surface=PolynomialSurfaceClassifier(degree=1), random_state=0
    ).fit(X, Xdot)
    before = model.coef_.copy()
    result = refine(model, records, fit_surface=True)
    np.testing.assert_array_equal(model.coef_, before)
    order = [model.predict_modes([[side, 0.0]])[0] for side in (1.0, -1.0)]
    errors = [
        np.abs(coef[order] - _oscillator().coef_).max() for coef in (before, result.model.coef_)
    ]
    assert errors[1] < 0.02 < errors[0]
    system = result.model.switching_model
    np.testing.assert_array_equal(result.model.predict(X[:3]), system.predict(X[:3]))
    assert result.model.simulate([1.0, 0.0], [0.0, 5.0]).status is Status.COMPLETED
    assert len(result.model.equations()) == 4 and result.model.surface_equations()


def test_zeros_stay_zero_and_only_free_coefficients_move():
    records = _samples(_oscillator(), STARTS, COARSE)
    start = _oscillator((0.2, 0.2))
    result = refine(start, records)
    kept = ~start.free
    np.testing.assert_array_equal(result.model.coef_[kept], start.coef_[kept])
    chosen = np.zeros_like(start.free)
    chosen[1, 1, 1] = True
    only = refine(start, records, free=chosen)
    assert only.names == ["mode 1: v', v"]
    np.testing.assert_array_equal(only.model.coef_[~chosen], start.coef_[~chosen])


@pytest.mark.parametrize("classifier", [SVC(), LogisticRegression(C=1e4)])
def test_a_surface_may_be_any_classifier(classifier):
    """Three modes of which the classifier, trained beside q = 0, knows two."""
    X = np.random.default_rng(0).uniform(-3.0, 3.0, (600, 2))
    classifier = clone(classifier).fit(X, 2 * (X[:, 0] < 0.0))
    coef = np.array([[[0.0, 1.0], [-1.0, -d]] for d in (0.1, 0.3, 0.5)])
    free = np.array([[[0, 0], [1, 1]]] * 3, bool)
    truth, start = (
        StatedModel(None, given, states=["q", "v"], surface=classifier, free=free)
        for given in (coef, coef * np.array([[1.0, 1.0], [1.1, 1.5]]))
    )
    result = refine(start, _samples(truth, STARTS, COARSE))
    error = np.abs(result.model.coef_ - coef)
    assert error[[0, 2]].max() < 0.05
    np.testing.assert_array_equal(np.isinf(result.standard_errors), [0, 0, 1, 1, 0, 0])
    np.testing.assert_allclose(result.rmse_after, NOISE, rtol=0.5)


# --- hidden states, outputs, parameters inside terms, missing values ----------------------------


def test_a_hidden_velocity():
    records = _samples(_oscillator(), STARTS * 2, COARSE, columns=[0])
    result = refine(_oscillator((0.2, 0.3), 1.2), records, observed=["q"], fit_surface=True)
    deviation = (result.model.coef_ - _oscillator().coef_)[_oscillator().free]
    assert np.abs(deviation / result.standard_errors[:4]).max() < 3.5
    assert np.abs(deviation).max() < 0.05
    np.testing.assert_allclose(result.initial_states, STARTS * 2, atol=0.08)
    same = refine(_oscillator((0.2, 0.3), 1.2), records, observed=[0], fit_surface=True)
    np.testing.assert_array_equal(same.values, result.values)


def test_what_the_data_do_not_determine_is_named():
    """Without the velocity its unit is open: q' = a v and v' = -b q know only a b."""
    free = np.ones((2, 2, 2), bool)
    free[:, 0, 0] = False
    records = _samples(_oscillator(), STARTS, COARSE, columns=[0])
    result = refine(_oscillator((0.2, 0.3), free=free), records, observed=["q"])
    lost = np.isinf(result.standard_errors)
    assert [name for name, inf in zip(result.names, lost, strict=True) if inf] == [
        "mode 0: q', v",
        "mode 0: v', q",
        "mode 1: q', v",
        "mode 1: v', q",
    ]
    assert "do not determine mode 0: q', v" in result.advice


def _tank(level, leak, overflow):
    """A tank that overflows at a level; its gauge has a unit of its own and shows at most 2.9."""
    columns = ["x", "u"]
    terms = {
        "root": lambda x: np.sqrt(np.maximum(x, 0.0)),
        "u": lambda u: u,
        "over": lambda x, L: np.maximum(x - L, 0.0),
    }
    return StatedModel(
        ParametricLibrary(terms, columns=columns, parameters={"L": level}),
        [[leak, 1.0, overflow]],
        states=["x"],
        inputs=["u"],
        free=[[True, False, True]],
        output=ParametricLibrary(
            {"gauge": lambda x, gain: np.minimum(gain * x, 2.9)}, columns, {"gain": 1.5}
        ),
    )


def test_parameters_inside_terms_and_a_clipping_gauge():
    truth = _tank(1.2, -0.5, -1.0)
    truth.output.set_params(parameters={"gain": 2.0})
    t = np.arange(0.0, 60.0, 0.5)
    u = 0.65 + 0.35 * np.sign(np.sin(0.31 * t) + 0.4 * np.sin(0.77 * t))[:, None]
    x = truth.simulate([0.3], t, u).x
    y = truth.measure(x, u)
    assert (y == 2.9).sum() > 10
    y += 0.01 * np.random.default_rng(0).standard_normal(y.shape)
    record = {"t": t, "x": np.minimum(y, 2.9), "inputs": u}
    start = _tank(1.0, -0.4, -0.7)
    result = refine(start, record, initial_states={"x": 0.5}, bounds={"gain": (0.5, 5.0)})
    assert result.names == ["mode 0: x', root", "mode 0: x', over", "L", "gain"]
    # clipped samples have one-sided noise; the estimates are close but not unbiased
    np.testing.assert_allclose(result.values, [-0.5, -1.0, 1.2, 2.0], rtol=0.05)
    assert result.model.feature_map.library.parameters == {"L": result.values[2]}
    assert start.output.parameters == {"gain": 1.5}
    found = initial_states(
        result.model, {"t": t[:20], "x": record["x"][:20], "inputs": u[:20]}, guess=[0.6]
    )
    assert found[0, 0] == pytest.approx(0.3, abs=0.02)


def test_missing_values_and_groups():
    records = _samples(_oscillator(), STARTS, COARSE)
    joint = {name: np.concatenate([record[name] for record in records]) for name in ("t", "x")} | {
        "groups": np.repeat(["a", "b", "c", "d"], len(COARSE))
    }
    apart, together = (refine(_oscillator((0.2, 0.3)), data) for data in (records, joint))
    np.testing.assert_array_equal(apart.values, together.values)
    for record in records:
        record["x"][4:7, 0] = np.nan
    holes = refine(_oscillator((0.2, 0.3)), records)
    assert 0 < np.abs(holes.values - apart.values).max() < 0.05


def test_outliers_are_discounted():
    records = _samples(_oscillator(), STARTS, COARSE)
    rng = np.random.default_rng(3)
    for record in records:
        hit = rng.choice(len(COARSE), 2, replace=False)
        record["x"][hit] += 3.0 * rng.choice([-1, 1], (2, 1))
    errors = {}
    for loss in ("linear", "soft_l1", "huber", "cauchy"):
        result = refine(_oscillator((0.2, 0.3)), records, loss=loss)
        errors[loss] = np.abs(result.model.coef_ - _oscillator().coef_).max()
    assert max(errors[loss] for loss in ("soft_l1", "huber", "cauchy")) < 0.06 < errors["linear"]


def test_discrete_time():
    coef = [[[0.9, 0.2], [-0.2, 0.8]], [[0.7, 0.4], [-0.4, 0.7]]]
    surface = StatedSurface([[0.0, -1.0, 0.0]])
    truth = StatedModel(None, coef, states=["a", "b"], surface=surface, discrete_time=True)
    rng = np.random.default_rng(0)
    records = _samples(truth, 5 * rng.standard_normal((30, 2)), np.arange(12.0), noise=0.01)
    off = np.array(coef) + 0.05 * rng.uniform(-1, 1, (2, 2, 2))
    start = StatedModel(None, off, states=["a", "b"], surface=surface, discrete_time=True)
    result = refine(start, records)
    assert result.substeps == 1
    # the second mode has few samples; its standard errors are up to 0.006
    assert np.abs(result.model.coef_ - coef).max() < 0.015 < 0.03 < np.abs(off - coef).max()


def test_a_chaotic_system_is_refined_segment_by_segment():
    """Lorenz: long rollouts mean nothing, segments of a fifth of a time unit do."""
    names = ["x", "y", "z"]
    terms = {"x": lambda x: x, "y": lambda y: y, "z": lambda z: z}
    terms |= {"xy": lambda x, y: x * y, "xz": lambda x, z: x * z}
    coef = np.array([[-10, 10, 0, 0, 0], [28, -1, 0, 0, -1], [0, 0, -8 / 3, 1, 0.0]])
    t = np.arange(0.0, 8.0, 0.04)
    library = ParametricLibrary(terms, columns=names)
    truth = StatedModel(library, coef, states=names)
    run = solve_ivp(
        lambda _, s: truth.predict(s[None])[0], (0, 8), [1, 2, 20.0], t_eval=t, rtol=1e-9
    )
    noisy = run.y.T + 0.1 * np.random.default_rng(0).standard_normal((len(t), 3))
    start = StatedModel(library, 1.1 * coef, states=names)
    result = refine(start, {"t": t, "x": noisy}, segment_length=5, joined=False)
    np.testing.assert_allclose(result.model.coef_[0], coef, rtol=0.03)
    assert (result.rmse_after < 0.15).all()


# --- invariances, verdicts, refusals ------------------------------------------------------------


def test_units_do_not_matter():
    records = _samples(_oscillator(), STARTS, COARSE)
    plain = refine(_oscillator((0.2, 0.3)), records)
    scaled = [{"t": 1e3 * r["t"], "x": r["x"] * [1e-3, 1e-6]} for r in records]
    factor = np.array([[1e-3, 1.0], [1e-6, 1e-3]])  # of q' by v, v' by q, v' by v
    start = _oscillator((0.2, 0.3))
    model = StatedModel(
        None, start.coef_ * factor, states=["q", "v"], surface=start.surface, free=start.free
    )
    other = refine(model, scaled)
    np.testing.assert_allclose(other.model.coef_ / factor, plain.model.coef_, rtol=1e-4)


def test_never_worse_than_the_start():
    truth = _oscillator()
    records = _samples(truth, STARTS, COARSE, noise=0.0)
    again = refine(truth, records)
    assert again.cost_after <= again.cost_before
    np.testing.assert_allclose(again.model.coef_, truth.coef_, atol=1e-3)
    short = refine(_oscillator((0.4, 0.0)), records, max_nfev=1)
    assert short.cost_after <= short.cost_before
    if not short.improved:
        assert "No progress" in short.advice
        np.testing.assert_array_equal(short.model.coef_, _oscillator((0.4, 0.0)).coef_)


def test_a_poor_start_keeps_its_surface_in_the_data():
    """A minute of slow decay, and a start of 40 % more stiffness: as good as from the truth.

    Fitted by segments, the surface left the data and only one mode was estimated, cost .36 for .32.
    """
    records = _samples(_oscillator((0.01, 0.05)), STARTS[:3], np.arange(0.0, 60.0, 0.25))
    start = _oscillator((0.02, 0.02), 1.4, (0.2, -1.0, 0.0))
    found = refine(start, records, fit_surface=True)
    best = refine(_oscillator((0.01, 0.05)), records, fit_surface=True)
    assert found.cost_after == pytest.approx(best.cost_after, rel=2e-3)
    assert np.abs(found.model.coef_ - _oscillator((0.01, 0.05)).coef_).max() < 0.005
    assert np.abs(found.model.surface.coef_[0, 0]) < 0.1  # of q; the start is 0.2 off


def test_a_diverging_start_is_caught_by_short_segments():
    """The long rollout of the start explodes; segments find their way, and it says which."""
    t = np.linspace(0.0, 20.0, 201)
    record = {"t": t, "x": np.exp(-0.3 * t) + 0.01 * np.random.default_rng(0).standard_normal(201)}
    start = StatedModel(None, [[5.0]], states=["x"])
    result = refine(start, record)
    assert result.segment_length < 20 and np.isinf(result.rmse_before).all()
    assert result.values[0] == pytest.approx(-0.3, abs=0.01)
    with pytest.raises(ValueError, match="diverges within segments of 200 samples; give a shorter"):
        refine(start, record, segment_length=200)
    with pytest.raises(ValueError, match="better coefficients to start from"):
        refine(StatedModel(None, [[1e4]], states=["x"]), record)


BAD_DATA = {
    "trajectory 0 has 3 times and 2 rows of x": {"t": [0, 1, 2], "x": np.ones((2, 2))},
    "times of trajectory 0 do not increase; sort": {"t": [0, 2, 1], "x": np.ones((3, 2))},
    "trajectory 0 has 1 samples": {"t": [0], "x": np.ones((1, 2))},
    "x of trajectory 0 has 1 columns and the model asks for 2": {"t": [0, 1], "x": [1.0, 2.0]},
    "inputs of trajectory 0 has 1 columns and the model asks for 0": {
        "t": [0, 1],
        "x": np.ones((2, 2)),
        "inputs": [1.0, 2.0],
    },
    "trajectory 0 has no x": {"t": [0, 1]},
    "column 1 of x holds no finite value": {"t": [0, 1], "x": [[1, np.nan], [2, np.nan]]},
    "trajectories is empty": [],
}


@pytest.mark.parametrize("sentence", BAD_DATA)
def test_bad_data_are_refused_in_a_sentence(sentence):
    with pytest.raises(ValueError, match=sentence):
        refine(_oscillator(), BAD_DATA[sentence])


BAD_OPTIONS = {
    "observed names 'w', which is no state; choose among q, v": {"observed": ["w"]},
    "name each measured state once": {"observed": ["q", 0]},
    "loss='l3' is unknown": {"loss": "l3"},
    "input_hold='cubic' is unknown": {"input_hold": "cubic"},
    "max_nfev=0 must be a positive integer": {"max_nfev": 0},
    "segment_length=0 must be a positive integer or None": {"segment_length": 0},
    "bounds names 'L', which is no named parameter; choose among: none": {"bounds": {"L": (0, 1)}},
    "initial_states names 'w', which is no state": {"initial_states": {"w": 0.0}},
    r"initial_states has shape \(3,\); give \(2,\) or \(1, 2\)": {"initial_states": [0, 0, 0]},
    r"free has shape \(2, 2\) and the coefficients \(2, 2, 2\)": {"free": np.ones((2, 2))},
    "no parameter is free": {"free": np.zeros((2, 2, 2))},
    "give a positive standard deviation": {"noise": [1.0, 0.0]},
}


@pytest.mark.parametrize("sentence", BAD_OPTIONS)
def test_bad_options_are_refused_in_a_sentence(sentence):
    record = {"t": [0.0, 1.0], "x": np.ones((2, 2))}
    with pytest.raises(ValueError, match=sentence):
        refine(_oscillator(), record, **BAD_OPTIONS[sentence])


def test_bad_models_are_refused_in_a_sentence():
    record = {"t": [0.0, 1.0], "x": [1.0, 2.0]}
    with pytest.raises(TypeError, match="has no coefficients yet; fit it first"):
        refine(SwitchingSystemRegressor(), record)
    with pytest.raises(ValueError, match=r"coef has shape \(1, 2\); give \(n_modes, 1, 1\)"):
        StatedModel(None, [[1.0, 2.0]], states=["x"])
    with pytest.raises(ValueError, match="2 modes and no surface says which"):
        StatedModel(None, [[[1.0]], [[2.0]]], states=["x"])
    with pytest.raises(ValueError, match=r"free has shape"):
        StatedModel(None, [[1.0]], states=["x"], free=np.ones((2, 1, 1)))
    with pytest.raises(ValueError, match="argument 'L', which is neither a column nor a parameter"):
        ParametricLibrary({"over": lambda x, L: x - L}, columns=["x"]).fit(None)
    with pytest.raises(ValueError, match="2 surfaces need a mode_book"):
        StatedSurface([[0.0, 1.0], [1.0, 1.0]])
    with pytest.raises(ValueError, match="3 coefficients for 2 features of 1 columns"):
        StatedSurface([[0.0, 1.0, 2.0]]).predict([[1.0]])
    model = StatedModel(None, [[-1.0]], states=["x"], output=lambda X: 2 * X)
    with pytest.raises(ValueError, match="observed is given for a model with an output"):
        refine(model, record, observed=["x"])
