"""Many rows: a fit on a sample, then passes over all rows, is as good as a fit of all rows."""

import pickle

import numpy as np
import pytest
from many_rows import A, cut, fitted, oscillator, take_for_many, three_stripes
from sklearn.base import clone
from sklearn.linear_model import LogisticRegression

from swsysid import PolynomialSurfaceClassifier
from swsysid._identification import identify as passes
from swsysid._surfaces.margin_program import MarginProgram, fit_surface
from swsysid.metrics import mode_accuracy
from swsysid.relaxations._certificates import certify

LOSSES = ["l1", "l2", "squared"]
COUPLINGS = [0, "auto"]
each_loss = pytest.mark.parametrize("loss", LOSSES)
each_coupling = pytest.mark.parametrize("coupling", COUPLINGS)


@pytest.fixture(autouse=True)
def many(monkeypatch):
    """More than 1500 rows are many; two samples and all rows are passed over."""
    take_for_many(monkeypatch)


def fit_of_all(monkeypatch, *arguments, **options):
    """A fit that takes no sample."""
    with monkeypatch.context() as patched:
        take_for_many(patched, 10**9)
        return fitted(*arguments, **options)


def dynamics_gap(model, X, Xdot, weight=None):
    """Relative duality gap of the vector fields at the labels found."""
    certificate = certify(
        model.switching_model.feature_map(X),
        Xdot.reshape(len(X), -1),
        model.coef_,
        model.loss,
        coef_bound=model.coef_bound,
        labels=model.modes_,
        sample_weight=weight,
    )
    return certificate.dynamics_gap / model.objective_


def assert_sound(model, n_samples):
    """What holds of every fit of many rows."""
    objectives = [record.objective for record in model.history_]
    assert (np.diff(objectives) <= 0.0).all()
    assert model.n_iter_ == len(objectives)
    assert model.modes_.shape == (n_samples,)
    assert model.membership_.shape == (n_samples, model.n_modes_)
    assert np.array_equal(model.membership_.argmax(axis=1), model.modes_)
    sizes = np.bincount(model.modes_, minlength=model.n_modes_)
    assert len(sizes) == model.n_modes_ and (np.diff(sizes) <= 0).all()


def assert_as_good(model, whole, X, Xdot, *, apart=1e-3, objective=1e-4, gap=1e-6):
    """Optimal for its labels, and with the labels of the fit of all rows.

    Both are local optima of one alternation from near starts, in units of slightly different
    residuals: a row between two modes may go either way.
    """
    assert_sound(model, len(X))
    assert np.mean(model.modes_ != whole.modes_) <= apart
    assert model.objective_ == pytest.approx(whole.objective_, rel=objective)
    assert dynamics_gap(model, X, Xdot) <= gap
    if np.array_equal(model.modes_, whole.modes_):  # a stop of the simplex leaves 1e-6 of it
        assert model.objective_ <= whole.objective_ * (1 + 1e-8)


# -- the answer of all rows ----------------------------------------------------------------------


@each_loss
@each_coupling
@pytest.mark.parametrize("relaxation", ["exact", "simplex"])
@pytest.mark.filterwarnings("ignore:The alternation stopped")  # as that of all rows does
def test_two_modes(monkeypatch, loss, coupling, relaxation):
    X, Xdot, modes = oscillator()
    options = {"loss": loss, "coupling": coupling, "relaxation": relaxation}
    model = fitted(X, Xdot, **options)
    assert_as_good(model, fit_of_all(monkeypatch, X, Xdot, **options), X, Xdot)
    # of the rows on which the modes differ by more than the noise
    assert mode_accuracy(modes, model.modes_) > (0.995 if coupling else 0.9)
    assert np.abs(model.coef_ - A[[1, 0]]).max() < 0.01


@each_loss
@each_coupling
def test_coefficients_at_the_bound(monkeypatch, loss, coupling):
    X, Xdot, _ = oscillator()
    options = {"loss": loss, "coupling": coupling, "coef_bound": 0.9}
    model = fitted(X, Xdot, **options)
    assert (
        np.abs(model.coef_).max() <= 0.9 and np.isclose(np.abs(model.coef_), 0.9, 1e-12).sum() == 4
    )
    assert_as_good(model, fit_of_all(monkeypatch, X, Xdot, **options), X, Xdot)


@each_loss
@each_coupling
def test_three_modes_of_different_terms(monkeypatch, loss, coupling):
    """Every mode keeps its own terms, in the order in which the modes come out."""
    X, Xdot, _ = three_stripes()
    options = {"n_modes": 3, "loss": loss, "coupling": coupling}
    options |= {"feature_library": 2, "sparsity": 0.3}
    model, whole = fitted(X, Xdot, **options), fit_of_all(monkeypatch, X, Xdot, **options)
    assert_sound(model, len(X))
    assert np.array_equal(model.coef_ != 0, whole.coef_ != 0)
    assert len({tuple(row) for row in (model.coef_ != 0).reshape(3, -1)}) == 3
    assert np.array_equal(model.modes_, whole.modes_)
    # Newton's method of the Euclidean norms ends within 1e-10 of the objective
    assert np.abs(model.coef_ - whole.coef_).max() < 1e-5
    assert model.objective_ == pytest.approx(whole.objective_, rel=1e-8)


@each_loss
@each_coupling
def test_one_mode(monkeypatch, loss, coupling):
    X, Xdot, _ = oscillator()
    options = {"n_modes": 1, "loss": loss, "coupling": coupling}
    model, whole = fitted(X, Xdot, **options), fit_of_all(monkeypatch, X, Xdot, **options)
    assert_as_good(model, whole, X, Xdot)
    assert model.objective_ == pytest.approx(whole.objective_, rel=1e-9)


@pytest.mark.nightly
def test_number_of_modes_is_chosen(monkeypatch):
    X, Xdot, _ = oscillator()
    groups = np.repeat(np.arange(40), 100)
    for given in (None, groups):
        options = {"n_modes": "auto", "max_modes": 3, "groups": given}
        model = fitted(X, Xdot, **options)
        assert model.n_modes_ == 2 and len(model.mode_selection_) == 3
        assert_as_good(model, fit_of_all(monkeypatch, X, Xdot, **options), X, Xdot)


@each_loss
def test_one_velocity_without_a_column(monkeypatch, loss):
    X, Xdot, _ = oscillator()
    model = fitted(X, Xdot[:, 1], loss=loss)
    assert_as_good(model, fit_of_all(monkeypatch, X, Xdot[:, 1], loss=loss), X, Xdot[:, 1])
    assert model.predict(X).shape == (len(X),)
    assert model.score(X, Xdot[:, 1]) > 0.99


@each_loss
@each_coupling
def test_known_equations_stay_exact(monkeypatch, loss, coupling):
    """q' = v holds to the last digit; only the other equation is estimated."""
    X, Xdot, _ = oscillator()
    Xdot[:, 0] = X[:, 1]
    options = {"loss": loss, "coupling": coupling}
    model = fitted(X, Xdot, **options)
    assert np.abs(model.coef_[:, 0] - [0.0, 1.0]).max() < 1e-9
    assert_as_good(model, fit_of_all(monkeypatch, X, Xdot, **options), X, Xdot)


@each_loss
@each_coupling
def test_data_without_noise(loss, coupling):
    X, Xdot, modes = oscillator(noise=0.0)
    model = fitted(X, Xdot, loss=loss, coupling=coupling)
    assert np.abs(model.coef_ - A[[1, 0]]).max() < 1e-9
    assert np.array_equal(model.modes_, 1 - modes)


@each_loss
def test_gross_outliers_do_not_move_the_fields(monkeypatch, loss):
    X, Xdot, modes = oscillator()
    rng = np.random.default_rng(5)
    wrong = rng.choice(len(X), 200, replace=False)
    Xdot[wrong] += 20 * rng.standard_normal((200, 2))
    model, whole = fitted(X, Xdot, loss=loss), fit_of_all(monkeypatch, X, Xdot, loss=loss)
    assert_sound(model, len(X))
    assert np.mean(model.modes_ != whole.modes_) < 1e-3
    assert np.abs(model.coef_ - whole.coef_).max() < 1e-4
    assert np.abs(model.coef_ - A[[1, 0]]).max() < 0.01
    assert mode_accuracy(modes, model.predict_modes(X)) > 0.99


@each_loss
@pytest.mark.parametrize("seed", [2, 4])
@pytest.mark.filterwarnings("ignore:Of .* samples whose residuals decide")
def test_rows_next_to_the_limit_of_outliers(monkeypatch, loss, seed):
    """Tails so heavy that rows change sides with every step: the others are fitted all the same."""
    take_for_many(monkeypatch, 2000, 1000)
    rng = np.random.default_rng(seed)
    X = rng.uniform(-3, 3, (20_000, 2))
    modes = (X[:, 0] <= 0.3).astype(int)
    Xdot = np.einsum("ikl,il->ik", A[modes], X) + 0.05 * rng.standard_t(1.5, X.shape)
    kept, descend = [], passes.descend_over_all_rows

    def watched(*arguments, **options):
        kept.append(descend(*arguments, **options))
        return kept[-1]

    monkeypatch.setattr(passes, "descend_over_all_rows", watched)
    model = fitted(X, Xdot, loss=loss)
    explained = kept[-1][0].last.result.labels >= 0
    assert 100 < np.sum(~explained) < 700
    options = {"labels": model.modes_[explained]}
    certificate = certify(X[explained], Xdot[explained], model.coef_, loss, **options)
    assert certificate.dynamics_gap <= 1e-5 * certificate.objective


@each_loss
def test_weight_is_repetition(loss):
    X, Xdot, _ = oscillator()
    weight = np.random.default_rng(9).integers(0, 4, len(X)).astype(float)
    rows = np.repeat(np.arange(len(X)), weight.astype(int))
    one = fitted(X, Xdot, sample_weight=weight, loss=loss)
    two = fitted(X[rows], Xdot[rows], loss=loss)
    assert np.array_equal(one.modes_[rows], two.modes_)
    assert one.objective_ == pytest.approx(two.objective_, rel=1e-9)
    assert np.abs(one.coef_ - two.coef_).max() < 1e-6
    assert dynamics_gap(one, X, Xdot, weight) < 1e-6


@pytest.mark.parametrize("start", ["labels", "other labels", "coefficients"])
def test_given_start(monkeypatch, start):
    X, Xdot, modes = oscillator()
    init = {"labels": modes, "other labels": 1 - modes, "coefficients": A + 0.05}[start]
    model = fitted(X, Xdot, init=init)
    assert_as_good(model, fit_of_all(monkeypatch, X, Xdot, init=init), X, Xdot)
    with pytest.raises(ValueError, match="init has shape"):
        fitted(X, Xdot, init=modes[:1000])


def test_another_classifier_as_surface(monkeypatch):
    X, Xdot, modes = oscillator()
    options = {"surface": LogisticRegression(), "coupling": 0}
    model = fitted(X, Xdot, **options)
    assert_as_good(model, fit_of_all(monkeypatch, X, Xdot, **options), X, Xdot)
    assert isinstance(model.surface_, LogisticRegression)
    assert mode_accuracy(modes, model.predict_modes(X)) > 0.95


@each_coupling
@pytest.mark.parametrize("n_modes", [2, 3])
def test_surfaces_are_those_of_all_rows(coupling, n_modes):
    """The margin LP of all rows, in the coordinates of the surface found, has no better ones."""
    X, Xdot, _ = oscillator() if n_modes == 2 else three_stripes()
    model = fitted(X, Xdot, n_modes=n_modes, coupling=coupling)
    surfaces = model.surface_.fitted_surfaces
    features, signs = surfaces.basis(X), surfaces.book[model.modes_]
    for coef, sign in zip(surfaces.coef, signs.T, strict=True):
        rows = features[sign != 0], sign[sign != 0].astype(float), np.ones(np.sum(sign != 0))
        options = surfaces.margin, surfaces.beta, surfaces.bound
        program = MarginProgram(rows[0] * rows[1][:, None], rows[2], *options)
        best = fit_surface(*rows, *options).objective
        assert program.objective(coef, program.signed @ coef) <= best * (1 + 1e-6)


# -- what does not matter ------------------------------------------------------------------------


@each_loss
def test_order_and_blocks_of_rows(loss):
    X, Xdot, _ = oscillator()
    order = np.random.default_rng(1).permutation(len(X))
    model = fitted(X, Xdot, loss=loss)
    ends = (1, 700, 3500)
    for places, other in (
        (order, fitted(X[order], Xdot[order], loss=loss)),
        (np.arange(len(X)), fitted(cut(X, *ends), cut(Xdot, *ends), loss=loss)),
    ):
        assert np.array_equal(other.modes_, model.modes_[places])
        assert np.abs(other.coef_ - model.coef_).max() < 1e-9
        assert other.objective_ == pytest.approx(model.objective_, rel=1e-12)


def test_random_state_and_workers():
    X, Xdot, _ = oscillator()
    one, two, three = (fitted(X, Xdot, n_jobs=n_jobs) for n_jobs in (None, None, 2))
    for other in (two, three):
        for name in ("coef_", "modes_", "objective_", "membership_"):
            assert np.array_equal(getattr(one, name), getattr(other, name)), name


def test_modes_that_change_places():
    """A mode that is the larger one in the sample only is the second one of all rows."""
    X, Xdot, _ = oscillator()
    found = {}
    for cutoff in np.linspace(-0.03, 0.03, 13):
        modes = (X[:, 0] <= cutoff).astype(int)
        noise = 0.01 * np.random.default_rng(2).standard_normal(X.shape)
        model = fitted(X, np.einsum("ikl,il->ik", A[modes], X) + noise)
        assert_sound(model, len(X))
        first = int(np.abs(model.coef_[0] - A[1]).max() < 0.05)
        assert np.abs(model.coef_ - A[[first, 1 - first]]).max() < 0.01
        found[first] = True
    assert len(found) == 2


# -- the estimator -------------------------------------------------------------------------------


def test_estimator_is_complete():
    X, Xdot, modes = oscillator()
    model = fitted(X, Xdot)
    copy = pickle.loads(pickle.dumps(model))
    X_test, Xdot_test, modes_test = oscillator(500, seed=1)
    for each in (model, copy):
        assert each.score(X_test, Xdot_test) > 0.99
        assert mode_accuracy(modes_test, each.predict_modes(X_test)) > 0.98
        assert each.predict_mode_proba(X_test).shape == (500, 2)
        assert each.guard_score_ > 0.95 and each.converged_
    assert np.array_equal(model.predict(X_test), copy.predict(X_test))
    again = clone(model).fit(X, Xdot)
    assert np.array_equal(again.coef_, model.coef_)
    assert len(model.equations()) == 4 and len(model.surface_equations()) == 1
    assert model.certificate(X, Xdot).objective <= model.objective_
    path = model.simulate([2.0, 0.0], np.linspace(0.0, 1.0, 5))
    assert path.status.ok


def test_rows_up_to_the_limit_are_fitted_as_a_whole(monkeypatch):
    X, Xdot, _ = oscillator(1500)
    model, whole = fitted(X, Xdot), fit_of_all(monkeypatch, X, Xdot)
    for name in ("coef_", "modes_", "membership_", "objective_"):
        assert np.array_equal(getattr(model, name), getattr(whole, name)), name
    assert len(model.history_[-1].modes) == 1500  # kept for so few only


@pytest.mark.parametrize("degree", [1, 3])
def test_degree_of_the_surface(monkeypatch, degree):
    X, Xdot, _ = oscillator()
    surface = PolynomialSurfaceClassifier(degree=degree)
    model = fitted(X, Xdot, surface=surface)
    assert_as_good(model, fit_of_all(monkeypatch, X, Xdot, surface=surface), X, Xdot)


def test_weight_zero_everywhere_is_refused():
    X, Xdot, _ = oscillator()
    with pytest.raises(ValueError, match="give at least one sample a positive weight"):
        fitted(X, Xdot, sample_weight=np.zeros(len(X)))


@each_loss
def test_passes_that_keep_few_rows_are_prepared_by_passes_over_fewer(monkeypatch, loss):
    """Of 9000 rows a pass may keep 600: then 2250 come before, and the answer is the same."""
    X, Xdot, _ = oscillator(9000)
    expected = fitted(X, Xdot, loss=loss)
    made, known = [], passes.stages

    def watched(*arguments):
        made.append(known(*arguments))
        return made[-1]

    monkeypatch.setattr(passes, "stages", watched)
    take_for_many(monkeypatch, most_kept=600)
    model = fitted(X, Xdot, loss=loss)
    assert made == [[9000] if loss == "squared" else [2250, 9000]]
    assert model.objective_ == pytest.approx(expected.objective_, rel=1e-6)
    assert np.mean(model.modes_ != expected.modes_) < 1e-3
    assert dynamics_gap(model, X, Xdot) <= 1e-6
