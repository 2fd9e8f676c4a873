"""`SwitchingSystemRegressor`: planted truth, optimality, equivariance, and what it refuses."""

import warnings

import many_rows
import numpy as np
import pandas as pd
import pytest
from many_rows import A
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning
from sklearn.linear_model import LogisticRegression
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler

from swsysid import (
    FunctionLibrary,
    IdentificationWarning,
    PolynomialSurfaceClassifier,
    SolverError,
    SwitchingSystemRegressor,
    solve_mip,
)
from swsysid.datasets import make_quartic_oscillator
from swsysid.metrics import match_modes, mode_accuracy
from swsysid.relaxations import ExactRelaxation, Relaxation

# Searches of a few random starts, and systems without an answer, find their best only once.
pytestmark = pytest.mark.filterwarnings("ignore:The best answer was found by only")


def oscillator(n_samples=400, noise=0.0, seed=0):
    """Uniform states of the paper's damped oscillator, and which mode each is in."""
    return many_rows.oscillator(n_samples, noise, seed, guard=0.0)


def fitted(X, Xdot, **parameters):
    return SwitchingSystemRegressor(**{"random_state": 0} | parameters).fit(X, Xdot)


def sorted_fields(coef):
    return coef[np.lexsort(coef.reshape(len(coef), -1).round(6).T)]


# -- right answers -------------------------------------------------------------------------------


def test_absolute_value_by_hand():
    """xdot = |x| is two lines through the origin, with the surface at x = 0."""
    X = np.array([[-3.0], [-2.0], [-1.0], [1.0], [2.0], [3.0], [4.0]])
    model = fitted(X, np.abs(X))
    assert np.allclose(model.coef_.ravel(), [1.0, -1.0], atol=1e-12)  # four samples on the right
    assert list(model.modes_) == [1, 1, 1, 0, 0, 0, 0]
    assert model.objective_ == pytest.approx(0.0, abs=1e-12)
    assert model.predict([[-1.5], [2.5]]).ravel() == pytest.approx([1.5, 2.5], abs=1e-12)


@pytest.mark.parametrize("loss", ["l1", "l2", "squared"])
@pytest.mark.parametrize("relaxation", ["exact", "simplex"])
def test_planted_oscillator_is_recovered(loss, relaxation):
    X, Xdot, modes = oscillator()
    model = fitted(X, Xdot, loss=loss, relaxation=relaxation)
    assert np.abs(sorted_fields(model.coef_) - sorted_fields(A)).max() < 1e-6
    assert mode_accuracy(modes, model.modes_) == 1.0
    X_test, Xdot_test, modes_test = oscillator(seed=1)
    assert mode_accuracy(modes_test, model.predict_modes(X_test)) > 0.98
    assert model.score(X_test, Xdot_test) > 0.99


def test_moment_relaxation_identifies_too():
    X, Xdot, modes = oscillator(n_samples=60)
    model = fitted(X, Xdot, relaxation="moment", coupling=0)
    assert np.abs(sorted_fields(model.coef_) - sorted_fields(A)).max() < 1e-6
    assert mode_accuracy(modes, model.modes_) == 1.0


def test_paper_recipe():
    """coupling=0, the simplex relaxation and the raw margin LP: the paper's own algorithm."""
    X, Xdot, modes = oscillator()
    surface = PolynomialSurfaceClassifier(standardize=False, beta=1e-2)
    model = fitted(X, Xdot, coupling=0, relaxation="simplex", surface=surface)
    assert mode_accuracy(modes, model.modes_) == 1.0
    line = model.surface_.coef_[0] / np.abs(model.surface_.coef_[0]).max()
    assert np.abs(line - [0, np.sign(line[1]), 0, 0, 0, 0]).max() < 0.05  # x = 0


def test_three_modes_with_noise():
    rng = np.random.default_rng(3)
    X = rng.uniform(-1, 1, (900, 2))
    modes = np.digitize(np.hypot(*X.T), [0.5, 0.8])
    fields = np.array([[[1.0, 0], [0, 1]], [[-2.0, 1], [0, -1]], [[0.0, -3], [2, 0]]])
    Xdot = np.einsum("ikl,il->ik", fields[modes], X)
    Xdot += 0.03 * rng.standard_normal(X.shape)
    model = fitted(X, Xdot, n_modes=3)
    assert mode_accuracy(modes, model.predict_modes(X)) > 0.97


def test_number_of_modes_is_chosen():
    X, Xdot, _ = oscillator(noise=0.02)
    model = fitted(X, Xdot, n_modes="auto", max_modes=4)
    assert model.n_modes_ == 2
    assert [candidate.n_modes for candidate in model.mode_selection_][:3] == [1, 2, 3]
    single = fitted(
        X,
        X @ A[0].T + 0.02 * np.random.default_rng(0).standard_normal(X.shape),
        n_modes="auto",
        max_modes=3,
    )
    assert single.n_modes_ == 1


def test_gross_outliers_do_not_move_the_fields():
    X, Xdot, modes = oscillator(n_samples=800)
    rows = np.random.default_rng(5).choice(800, 40, replace=False)
    Xdot[rows] += 20 * np.random.default_rng(6).standard_normal((40, 2))
    model = fitted(X, Xdot)
    assert np.abs(sorted_fields(model.coef_) - sorted_fields(A)).max() < 1e-6
    X_test, _, modes_test = oscillator(seed=1)
    assert mode_accuracy(modes_test, model.predict_modes(X_test)) > 0.98


def test_sparsity_removes_what_is_not_there():
    X, Xdot, _ = oscillator(noise=0.01, n_samples=1000)
    truth = np.zeros((2, 2, 10), dtype=bool)
    truth[:, 0, 2] = truth[:, 1, 1] = truth[:, 1, 2] = True
    auto = fitted(X, Xdot, feature_library=3, sparsity="auto")
    assert np.array_equal(auto.coef_ != 0, truth)
    threshold = fitted(X, Xdot, feature_library=3, sparsity=0.05)
    assert np.array_equal(threshold.coef_ != 0, truth)


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_a_library_two_degrees_too_rich_keeps_the_true_terms(noise):
    data = make_quartic_oscillator(2000, noise=noise, random_state=0)
    model = SwitchingSystemRegressor(
        feature_library=5,
        surface=PolynomialSurfaceClassifier(degree=4),
        sparsity="auto",
        random_state=0,
    ).fit(data.X, data.Xdot)
    truth = np.zeros((2, 2, 21))
    matched = match_modes(data.modes, model.modes_)
    truth[:, :, :10] = data.coef[[matched[0], matched[1]]]
    assert np.array_equal(model.coef_ != 0, truth != 0)
    # 90 samples in the rarer mode: 0.006 under noise when written, rounding without.
    assert np.abs(model.coef_ - truth).max() < max(1e-9, noise)


def test_more_than_four_modes_do_not_depend_on_numpys_global_state():
    x = np.random.default_rng(0).uniform(-5, 5, (400, 1))
    slopes = np.array([1.0, -1.0, 2.0, -2.0, 3.0])[np.digitize(x[:, 0], [-3, -1, 1, 3])]
    surfaces = []
    for state in range(2):
        np.random.seed(state)
        model = fitted(x, slopes[:, None] * x, n_modes=5, surface=PolynomialSurfaceClassifier(1))
        surfaces.append(model.surface_.coef_)
    assert np.array_equal(*surfaces)


def test_single_mode_is_one_regression():
    X, Xdot, _ = oscillator(noise=0.1)
    model = fitted(X, Xdot, n_modes=1, loss="squared")
    expected = np.linalg.lstsq(X, Xdot, rcond=None)[0].T
    assert np.abs(model.coef_[0] - expected).max() < 1e-10
    assert np.array_equal(model.predict_modes(X), np.zeros(len(X)))
    assert np.array_equal(model.predict_mode_proba(X), np.ones((len(X), 1)))


# -- optimality ----------------------------------------------------------------------------------


def test_objective_is_that_of_the_answer_and_certified():
    X, Xdot, _ = oscillator(noise=0.1)
    model = fitted(X, Xdot, coupling=0)
    residuals = Xdot - model.mode_velocities(X)[model.modes_, np.arange(len(X))]
    assert model.objective_ == pytest.approx(np.abs(residuals).sum(), rel=1e-12)
    certificate = model.certificate(X, Xdot)
    assert certificate.objective == pytest.approx(model.objective_, rel=1e-12)
    assert certificate.dynamics_gap <= 1e-8 * model.objective_
    assert certificate.lower_bound <= certificate.objective


def test_never_better_than_the_mixed_integer_optimum_and_reaches_it():
    X, Xdot, _ = oscillator(n_samples=16, noise=0.2, seed=4)
    exact = solve_mip(X, Xdot, 2, coef_bound=5.0, time_limit=60.0)
    model = fitted(X, Xdot, coupling=0, coef_bound=5.0, init="random", n_init=100)
    assert model.objective_ >= exact.bound - 1e-6
    assert model.objective_ == pytest.approx(exact.objective, rel=1e-6)


def test_history_keeps_the_labels_in_the_order_of_the_answer():
    X, Xdot, _ = oscillator(noise=0.1)
    weight = np.ones(len(X))
    weight[3] = 0
    model = SwitchingSystemRegressor(random_state=0, coupling=0).fit(X, Xdot, sample_weight=weight)
    last = model.history_[-1]
    assert last.mode_changes == 0  # so its labels are the answer
    assert np.array_equal(last.modes[weight > 0], model.modes_[weight > 0])
    assert last.modes[3] == -1


@pytest.mark.parametrize("coupling", [0, "auto"])
def test_objective_never_increases(coupling):
    X, Xdot, _ = oscillator(noise=0.3)
    model = fitted(X, Xdot, coupling=coupling, init="random", n_init=3)
    objective = np.array([record.objective for record in model.history_])
    assert len(objective) >= 2
    assert (np.diff(objective) <= 1e-9 * objective[:-1]).all()


def test_relaxed_value_never_increases_with_the_simplex():
    """The soft memberships and the joint regression are the paper's monotone pair."""
    X, Xdot, _ = oscillator(noise=0.3)
    model = fitted(X, Xdot, coupling=0, relaxation="simplex", init="random", n_init=3, tol=0)
    relaxed = np.array([record.lower_bound for record in model.history_])
    assert len(relaxed) >= 3
    assert (np.diff(relaxed) <= 1e-7 * relaxed[:-1]).all()


def test_reference_solver_gives_the_same_answer():
    X, Xdot, _ = oscillator(n_samples=150, noise=0.05)
    fast, reference = fitted(X, Xdot, coupling=0), fitted(X, Xdot, coupling=0, solver="clarabel")
    assert fast.objective_ == pytest.approx(reference.objective_, rel=1e-6)
    assert np.array_equal(fast.modes_, reference.modes_)


def test_coefficient_bound_holds():
    X, Xdot, _ = oscillator()
    model = fitted(X, Xdot, coef_bound=0.7)
    assert np.abs(model.coef_).max() <= 0.7 + 1e-12


# -- equivariance --------------------------------------------------------------------------------


def test_row_order_does_not_matter():
    X, Xdot, _ = oscillator(noise=0.1)
    order = np.random.default_rng(1).permutation(len(X))
    model, shuffled = fitted(X, Xdot), fitted(X[order], Xdot[order])
    assert np.array_equal(model.coef_, shuffled.coef_)
    assert np.array_equal(model.modes_[order], shuffled.modes_)


def test_weights_are_repetitions():
    X, Xdot, _ = oscillator(noise=0.1)
    counts = np.random.default_rng(2).integers(0, 4, len(X))
    weighted = SwitchingSystemRegressor(random_state=0).fit(X, Xdot, sample_weight=counts)
    repeated = fitted(np.repeat(X, counts, axis=0), np.repeat(Xdot, counts, axis=0))
    assert np.array_equal(weighted.coef_, repeated.coef_)
    assert np.array_equal(np.repeat(weighted.modes_, counts), repeated.modes_)
    assert weighted.modes_.shape == (len(X),)


def test_units_do_not_matter():
    """Millimetres and milliseconds give the same modes and the converted coefficients."""
    X, Xdot, _ = oscillator(noise=0.1)
    units = np.array([1e3, 1.0])
    model, scaled = fitted(X, Xdot), fitted(X * units, Xdot * units)
    assert np.array_equal(model.modes_, scaled.modes_)
    converted = model.coef_ * units[:, None] / units[None, :]
    assert np.allclose(scaled.coef_, converted, rtol=1e-6, atol=1e-9)


def test_modes_come_in_canonical_order():
    X, Xdot, _ = oscillator(n_samples=401)
    model = fitted(X, Xdot)
    size = np.bincount(model.modes_)
    assert size[0] >= size[1]
    reversed_start = 1 - model.modes_
    assert np.array_equal(fitted(X, Xdot, init=reversed_start).coef_, model.coef_)


@pytest.mark.parametrize("seed", range(6))
def test_modes_of_equal_size_come_in_an_order_that_rounding_does_not_decide(seed):
    # both laws have x0' = x1, whose coefficients 0 and 1 are found but for rounding
    x = np.abs(np.random.default_rng(seed).standard_normal((100, 2))) * [1.0, -1.0]
    x = np.vstack([x, -x])
    damping = np.where(x[:, 0] > 0, 0.5, 0.1)
    model = fitted(x, np.column_stack([x[:, 1], -x[:, 0] - damping * x[:, 1]]))
    assert np.bincount(model.modes_).tolist() == [100, 100]
    # by the first coefficient that differs
    assert np.allclose(model.coef_[:, 1, 1], [-0.5, -0.1], atol=1e-9)


def test_number_of_jobs_does_not_matter():
    X, Xdot, _ = oscillator(noise=0.1)
    serial = fitted(X, Xdot, init="random", n_init=4)
    parallel = fitted(X, Xdot, init="random", n_init=4, n_jobs=2)
    assert np.array_equal(serial.coef_, parallel.coef_)
    assert np.array_equal(serial.modes_, parallel.modes_)


# -- starts --------------------------------------------------------------------------------------


def test_starts_from_labels_and_from_coefficients():
    X, Xdot, modes = oscillator()
    for init in (modes, A + 0.05):
        model = fitted(X, Xdot, init=init)
        assert np.abs(sorted_fields(model.coef_) - sorted_fields(A)).max() < 1e-9


def test_empty_mode_is_dropped_with_a_warning():
    X, Xdot, _ = oscillator()
    with pytest.warns(IdentificationWarning, match="Only 1 of 2 modes"):
        model = fitted(X, X @ A[0].T, init=np.zeros(len(X), dtype=int))
    assert model.n_modes_ == 1
    assert np.isfinite(model.coef_).all()


@pytest.mark.filterwarnings("ignore::swsysid.IdentificationWarning")
def test_more_modes_than_samples_are_dropped():
    model = fitted(np.array([[1.0], [2.0], [3.0]]), np.array([2.0, -1.0, 5.0]), n_modes=10**6)
    assert model.n_modes_ <= 3
    assert np.isfinite(model.coef_).all()


def test_too_few_samples_is_a_warning_and_a_finite_answer():
    X, Xdot, _ = oscillator(n_samples=5)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model = fitted(X, Xdot, feature_library=2)
    assert any("smallest norm" in str(w.message) for w in caught)
    assert np.isfinite(model.coef_).all()


def test_iteration_limit_is_a_warning_with_advice():
    X, Xdot, _ = oscillator(noise=0.3)
    with pytest.warns(ConvergenceWarning, match="Increase max_iter"):
        fitted(X, Xdot, init="random", n_init=1, max_iter=1)


# -- libraries, inputs, discrete time ------------------------------------------------------------


def pysindy_libraries():
    import pysindy

    polynomial, fourier = pysindy.PolynomialLibrary(2), pysindy.FourierLibrary(1)
    return [polynomial, fourier, polynomial + fourier]


# Sines and cosines do not span the laws: several partitions explain them equally badly.
@pytest.mark.filterwarnings("ignore:The answer is not stable")
@pytest.mark.parametrize("index", range(3))
def test_pysindy_libraries(index):
    library = pysindy_libraries()[index]
    X, Xdot, _ = oscillator(n_samples=300)
    model = fitted(X, Xdot, feature_library=library)
    features = np.asarray(clone(library).fit(X).transform(X))
    assert model.coef_.shape[2] == features.shape[1] == len(model.feature_names_out_)
    expected = np.matmul(features, model.coef_.transpose(0, 2, 1))
    assert np.allclose(model.mode_velocities(X), expected, atol=1e-10)
    assert type(model.predict(X)) is np.ndarray
    clone(model)
    assert "library" in repr(model).lower()


def test_degree_transformer_and_pipeline_agree():
    X, Xdot, _ = oscillator(noise=0.05)
    degree = fitted(X, Xdot, feature_library=2)
    for library in (PolynomialFeatures(2), make_pipeline(PolynomialFeatures(2))):
        assert np.array_equal(fitted(X, Xdot, feature_library=library).coef_, degree.coef_)
    assert list(degree.feature_names_out_) == ["1", "x0", "x1", "x0^2", "x0 x1", "x1^2"]


def test_function_library_finds_a_pendulum():
    rng = np.random.default_rng(0)
    X = rng.uniform(-3, 3, (500, 2))
    friction = np.where(X[:, 1] > 0, 0.2, 0.9)
    Xdot = np.column_stack([X[:, 1], -4 * np.sin(X[:, 0]) - friction * X[:, 1]])
    library = FunctionLibrary([np.sin, lambda x: x], names=["sin({})", "{}"])
    model = fitted(X, Xdot, feature_library=library)
    assert list(model.feature_names_out_) == ["sin(x0)", "sin(x1)", "x0", "x1"]
    expected = [[[0, 0, 0, 1], [-4, 0, 0, -0.2]], [[0, 0, 0, 1], [-4, 0, 0, -0.9]]]
    assert np.allclose(sorted_fields(model.coef_), sorted_fields(np.array(expected)), atol=1e-9)


def test_features_of_an_earlier_pipeline_step():
    X, Xdot, modes = oscillator()
    pipeline = make_pipeline(StandardScaler(), SwitchingSystemRegressor(random_state=0))
    pipeline.fit(X - X.mean(axis=0), Xdot)
    assert mode_accuracy(modes, pipeline[-1].modes_) > 0.98
    features = make_pipeline(PolynomialFeatures(2), SwitchingSystemRegressor(random_state=0))
    assert features.fit(X, Xdot).score(X, Xdot) > 0.99


def test_inputs_are_further_columns():
    rng = np.random.default_rng(1)
    X = rng.uniform(-2, 2, (400, 2))  # one state, one input
    decay = np.where(X[:, 0] > 0.5, 2.0, 0.5)
    xdot = -decay * X[:, 0] + 3 * X[:, 1]
    model = fitted(X, xdot)
    assert model.predict(X).shape == (400,)
    assert np.allclose(sorted_fields(model.coef_).ravel(), [-2, 3, -0.5, 3], atol=1e-9)
    t = np.linspace(0, 2, 21)
    rollout = model.simulate([-1.0], t, np.full((21, 1), 0.1))
    closed_form = 0.6 - 1.6 * np.exp(-0.5 * t)  # stays in x <= 0.5 up to t = 2
    reached = closed_form < 0.45
    assert np.abs(rollout.x[reached, 0] - closed_form[reached]).max() < 1e-6


def test_discrete_time_iterates_the_map():
    rng = np.random.default_rng(2)
    X = rng.uniform(-2, 2, (300, 1))
    following = np.where(X > 0.25, 0.5 * X, -0.9 * X)
    model = fitted(X, following, discrete_time=True)
    rollout = model.simulate([1.6], np.arange(5))
    assert np.allclose(rollout.x.ravel(), [1.6, 0.8, 0.4, 0.2, -0.18], atol=1e-9)
    assert model.equations(1)[0].startswith("mode 0: x0[k+1] = ")


def test_simulation_switches_on_the_surface():
    X, Xdot, _ = oscillator(n_samples=4000)
    model = fitted(X, Xdot)
    rollout = model.simulate([1.0, 0.0], np.linspace(0, 5, 101))
    assert rollout.status.ok
    damping, frequency = 0.05, np.sqrt(1 - 0.05**2)  # crossing of x = 0 in the first mode
    crossing = (np.pi / 2 + np.arctan(damping / frequency)) / frequency
    assert rollout.events[0].time == pytest.approx(crossing, abs=0.01)  # surface from samples


# -- surfaces and relaxations of one's own ---------------------------------------------------------


def test_any_classifier_is_a_surface():
    X, Xdot, modes = oscillator()
    surface = make_pipeline(StandardScaler(), LogisticRegression(C=1e4, max_iter=1000))
    model = fitted(X, Xdot, surface=surface)
    assert mode_accuracy(modes, model.predict_modes(X)) > 0.98
    probability = model.predict_mode_proba(X)
    assert np.allclose(probability.sum(axis=1), 1, atol=1e-12)
    with pytest.raises(ValueError, match="coupling=1.0 needs a surface with mode_penalty"):
        fitted(X, Xdot, surface=surface, coupling=1.0)


def test_probabilities_agree_with_modes_and_are_calibrated():
    X, Xdot, _ = oscillator(noise=0.1, n_samples=2000)
    model = fitted(X, Xdot)
    X_test, _, modes_test = oscillator(seed=1, n_samples=4000)
    probability = model.predict_mode_proba(X_test)
    assert np.allclose(probability.sum(axis=1), 1, atol=1e-12)
    predicted = model.predict_modes(X_test)
    assert np.array_equal(probability.argmax(axis=1), predicted)
    # mode names are arbitrary: a prediction is right where it is in the matched mode
    matched = match_modes(modes_test, predicted)
    right = np.array([matched[mode] for mode in predicted]) == modes_test
    confidence = probability.max(axis=1)
    bins = np.digitize(confidence, [0.6, 0.7, 0.8, 0.9, 0.95])
    error = sum(
        abs(right[bins == b].mean() - confidence[bins == b].mean()) * (bins == b).mean()
        for b in np.unique(bins)
    )
    assert error < 0.03


def test_relaxation_of_the_user():
    class Cheapest(Relaxation):
        def assign(self, candidates, targets):
            return ExactRelaxation().assign(candidates, targets)

    X, Xdot, _ = oscillator(noise=0.1)
    assert np.array_equal(
        fitted(X, Xdot, relaxation=Cheapest()).coef_, fitted(X, Xdot, relaxation="exact").coef_
    )


@pytest.mark.parametrize("answer", [None, np.zeros(3)])
def test_relaxation_that_answers_something_else_gets_a_sentence(answer):
    class Careless(Relaxation):
        def assign(self, candidates, targets):
            return answer

    X, Xdot, _ = oscillator(n_samples=20)
    with pytest.raises(TypeError, match="Careless.assign must return a swsysid.Assignment"):
        fitted(X, Xdot, relaxation=Careless())


def test_nested_parameters_of_defaults():
    model = SwitchingSystemRegressor(relaxation="moment")
    model.set_params(surface__degree=3, surface__beta=1e-4, relaxation__order=2)
    assert (model.surface.degree, model.surface.beta, model.relaxation.order) == (3, 1e-4, 2)
    assert clone(model).surface.degree == 3


# -- refusals --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("parameters", "sentence"),
    [
        ({"n_modes": 0}, "n_modes=0 must be a positive integer"),
        ({"n_modes": "many"}, "n_modes='many' must be a positive integer or 'auto'"),
        ({"n_init": 0}, "n_init=0 must be"),
        ({"max_iter": 0}, "max_iter=0 must be"),
        ({"tol": -1.0}, "tol=-1.0 must be a non-negative number"),
        ({"coef_bound": 0.0}, "coef_bound=0.0 must be a positive number or None"),
        ({"sparsity": -1}, "sparsity=-1 must be a non-negative number or None or 'auto'"),
        ({"coupling": "strong"}, "coupling='strong' must be"),
        ({"loss": "huber"}, "loss='huber' is unknown"),
        ({"relaxation": "magic"}, "relaxation='magic' is unknown"),
        ({"init": "magic"}, "init='magic' is unknown"),
        ({"init": np.zeros(3)}, r"init has shape \(3,\)"),
        ({"init": np.zeros((2, 2, 9))}, "n_modes, n_states, n_features_out"),
        ({"feature_library": -1}, "a polynomial degree is at least 0"),
    ],
)
def test_bad_parameters_get_a_sentence(parameters, sentence):
    X, Xdot, _ = oscillator(n_samples=20)
    with pytest.raises(ValueError, match=sentence):
        fitted(X, Xdot, **parameters)


def test_bad_data_get_a_sentence():
    X, Xdot, _ = oscillator(n_samples=20)
    with pytest.raises(ValueError, match="NaN"):
        fitted(np.where(X == X[3], np.nan, X), Xdot)
    with pytest.raises(ValueError, match="inconsistent numbers of samples"):
        fitted(X, Xdot[:-1])
    with pytest.raises(ValueError, match="groups has shape"):
        SwitchingSystemRegressor().fit(X, Xdot, groups=[1, 2])
    with pytest.raises(ValueError, match="features, but SwitchingSystemRegressor is expecting 2"):
        fitted(X, Xdot).predict(X[:, :1])


def test_custom_library_of_pysindy_gets_a_sentence():
    import pysindy

    X, Xdot, _ = oscillator(n_samples=20)
    raw = pysindy.CustomLibrary([lambda x: x**2])
    for library in (raw, raw + pysindy.PolynomialLibrary(1)):
        with pytest.raises(TypeError, match="swsysid.FunctionLibrary"):
            SwitchingSystemRegressor(feature_library=library).fit(X, Xdot)


def test_library_with_wrong_rows_gets_a_sentence():
    from sklearn.preprocessing import FunctionTransformer

    X, Xdot, _ = oscillator(n_samples=20)
    with pytest.raises(ValueError, match="one row of features for each sample"):
        fitted(X, Xdot, feature_library=FunctionTransformer(lambda x: x[:-1]))


def test_surface_and_solver_that_are_none_get_a_sentence():
    X, Xdot, _ = oscillator(n_samples=20)
    with pytest.raises(TypeError, match="is not a classifier"):
        fitted(X, Xdot, surface="polynomial")
    with pytest.raises(SolverError, match="not installed"):
        fitted(X, Xdot, solver="mosek")


def test_simulate_needs_states():
    X, Xdot, _ = oscillator()
    model = fitted(X[:, :1], Xdot)
    with pytest.raises(ValueError, match="2 velocities but only 1 columns"):
        model.simulate([1.0], [0, 1])


def test_simulate_refuses_missing_and_surplus_inputs():
    X = np.random.default_rng(0).uniform(-1, 1, (60, 3))
    driven = fitted(X, X[:, :2] @ A[0].T + X[:, 2:], n_modes=1)
    with pytest.raises(ValueError, match="inputs hold 0 columns; give 2 and 1"):
        driven.simulate([1.0, 0.0], [0.0, 1.0])
    free = fitted(X[:, :2], X[:, :2] @ A[0].T, n_modes=1)
    with pytest.raises(ValueError, match="inputs hold 1 columns; give 2 and 0"):
        free.simulate([1.0, 0.0], [0.0, 1.0], np.ones(2))
    with pytest.raises(ValueError, match="x0 holds 3 states"):
        free.simulate([1.0, 0.0, 0.0], [0.0, 1.0])


def test_no_term_of_a_law_vanishes_from_the_text_in_small_units():
    X, Xdot, _ = oscillator(60)
    model = fitted(1e-9 * X, 1e-9 * (X @ A[0].T + 0.1 * X**3), n_modes=1, feature_library=3)
    assert "1.000 x1" in model.equations()[0]


def test_automatic_number_of_modes_of_one_sample():
    X, Xdot, _ = oscillator(1)
    with pytest.warns(IdentificationWarning, match="smallest norm"):
        assert fitted(X, Xdot, n_modes="auto").n_modes_ == 1


def test_certificate_needs_the_velocities_of_the_model():
    X, Xdot, _ = oscillator(40)
    model = fitted(X, Xdot, n_modes=1)
    with pytest.raises(ValueError, match="y has 1 columns; the model has 2 velocities"):
        model.certificate(X, Xdot[:, :1])


@pytest.mark.parametrize("solver", [None, 3])
def test_a_solver_is_a_name(solver):
    X, Xdot, _ = oscillator(20)
    with pytest.raises(ValueError, match="must be 'auto' or the name of a solver"):
        fitted(X, Xdot, n_modes=1, solver=solver)


def test_a_surface_without_equations_says_so():
    X, Xdot, _ = oscillator(100)
    model = fitted(X, Xdot, surface=LogisticRegression())
    with pytest.raises(TypeError, match="LogisticRegression is a surface without equations"):
        model.surface_equations()


def test_what_has_a_name_of_its_own_is_no_rate():
    """A gear box: revolutions are a multiple of the speed, which is not what changes the speed."""
    speed = np.random.default_rng(0).uniform(1.0, 10.0, 200)
    x, y = pd.DataFrame({"speed": speed}), pd.Series(70.0 * speed, name="rpm")
    fitted = SwitchingSystemRegressor(1).fit(x, y)
    assert fitted.equations() == ["mode 0: rpm = 70.000 speed"]
    assert fitted.fit(x, y.rename("speed")).equations() == ["mode 0: speed' = 70.000 speed"]
    assert fitted.fit(x, y.to_numpy()).equations() == ["mode 0: speed' = 70.000 speed"]
