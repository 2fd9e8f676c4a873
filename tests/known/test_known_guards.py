"""Surfaces of which something is known: a threshold, a sum, or monomials."""

import numpy as np
import pandas as pd
import pytest
from sklearn.preprocessing import PolynomialFeatures
from sklearn.svm import SVC

from swsysid import (
    HybridAutomatonRegressor,
    Known,
    PolynomialSurfaceClassifier,
    SwitchingSystemRegressor,
    TrajectoryIdentifier,
    load_model,
    save_model,
)
from swsysid.refinement import StatedModel, StatedSurface

T = np.linspace(0.0, 8.0, 161)
PLANT = StatedModel(  # a spring that is four times as stiff where x > 0.3
    PolynomialFeatures(1), [[[0, 0, 1], [0, -1, -0.1]], [[0, 0, 1], [0, -4, -0.1]]],
    states=["x", "v"], surface=StatedSurface([[-0.3, 1, 0]], 1),
)  # fmt: skip
MODES = np.array([[[0, 1], [-1, -0.1]], [[0, 1], [-4, -0.1]], [[0, 1], [-1, -2]]])


def identified(known, seed=0, offset=0.0, **options):
    rng = np.random.default_rng(seed)
    given = [
        {"t": T, "x": pd.DataFrame(
            PLANT.simulate(start, T).x + 0.02 * rng.standard_normal((len(T), 2)) + [offset, 0.0],
            columns=["x", "v"],
        )}
        for start in ([1, 1], [-2, 0], [1.5, -1])
    ]  # fmt: skip
    estimator = SwitchingSystemRegressor(feature_library=1, random_state=0, **options)
    return TrajectoryIdentifier(estimator, known=known).fit(given)


def rows(n_modes, known, **options):
    rng = np.random.default_rng(0)
    X = rng.uniform(-2, 2, (600, 2))
    modes = (X[:, 0] > -0.7).astype(int) + ((X[:, 0] > 0.8) & (n_modes > 2))
    Xdot = np.einsum("isf,if->is", MODES[modes], X) + 0.02 * rng.standard_normal((600, 2))
    model = SwitchingSystemRegressor(n_modes, known=known, random_state=0, **options)
    return model.fit(pd.DataFrame(X, columns=["x", "v"]), Xdot)


@pytest.mark.parametrize(
    ("written", "printed"),
    [
        ("guard x >= *", "guard x >= *"),
        ("guard x>=0.5", "guard x >= 0.5"),
        ("guard 0.5 = x", "guard -x >= -0.5"),
        ("guard 2 x <= v - 1", "guard 2 x - v >= -1"),
        ("guard `speed, m/s` - x v = *", "guard `speed, m/s` - x v >= *"),
        ("guard has only 1, x^2", "guard has only 1, x^2"),
    ],
)
def test_guards_are_read_and_printed(written, printed):
    known = Known.from_text(written)
    assert str(known) == printed and Known.from_text(printed) == known
    assert Known().guard(written.removeprefix("guard")) == known


@pytest.mark.parametrize(
    "text",
    ["guard", "guard x", "guard 1 >= *", "guard x' >= *", "guard x + 1 >= *", "guard * x >= 1",
     "guard * >= x", "guard x >= * 1", "guard -1 <= x <= 1", "guard has only others"],
)  # fmt: skip
def test_what_is_no_guard_is_refused_in_one_sentence(text):
    with pytest.raises(ValueError, match=r"^known=.*\.$"):
        Known.from_text(text)


def test_surfaces_are_sums_of_the_columns_of_a_span():
    # 1 - x^2 - v^2 on a grid, of x^2 + v^2 and a constant: the circle of the labels
    grid = np.stack(np.meshgrid(*[np.linspace(-2, 2, 41)] * 2), -1).reshape(-1, 2)
    inside = np.square(grid).sum(axis=1) < 1.44
    span = [[0, 1], [0, 0], [0, 0], [1, 0], [0, 0], [1, 0]]
    for offset in (np.zeros(2), [7.0, 0.0]):
        moved = span if not np.any(offset) else [[49, 1], [-14, 0], [0, 0], [1, 0], [0, 0], [1, 0]]
        fit = PolynomialSurfaceClassifier(span=moved).fit(grid + offset, inside)
        assert fit.score(grid + offset, inside) == 1.0
        assert fit.coef_[0, 3] == pytest.approx(fit.coef_[0, 5], rel=1e-12)
        np.testing.assert_allclose(
            fit.surface_values(grid + offset)[:, 0],
            PolynomialFeatures(2).fit_transform(grid + offset) @ fit.coef_[0], atol=1e-11,
        )  # fmt: skip


@pytest.mark.parametrize("span", [[1.0], [[1.0], [2.0]], np.zeros((3, 1))])
def test_a_span_that_is_none_is_refused(span):
    with pytest.raises(ValueError, match="columns of 3 coefficients"):
        PolynomialSurfaceClassifier(1, span=span).fit(np.eye(2), [0, 1])


@pytest.mark.parametrize(
    ("n_modes", "known", "thresholds"),
    [(2, "guard x >= -0.7", [-0.7]), (2, "guard x >= *", [-0.7]), (3, "guard x >= *", [-0.7, 0.8])],
)
def test_rows_are_parted_where_it_is_known(n_modes, known, thresholds):
    coef = rows(n_modes, known).surface_.coef_
    assert (coef[:, [2, 3, 4, 5]] == 0.0).all()
    atol = 1e-12 if "*" not in known else 0.02  # a few of 600 rows between
    np.testing.assert_allclose(sorted(-coef[:, 0] / coef[:, 1]), thresholds, atol=atol)


def test_recordings_switch_where_it_is_known_and_its_error_is_zero():
    found = identified(["guard x >= 0.3", "x' = v"])
    [coef], [errors] = found.estimator_.surface_.coef_, found.surface_errors_
    assert -coef[0] / coef[1] == pytest.approx(0.3, abs=1e-12) and (errors == 0.0).all()
    assert (coef[2:] == 0.0).all()
    threshold, law = found.known_
    assert not threshold.questioned and not law.questioned
    assert threshold.name == "guard x"
    assert threshold.value == pytest.approx(0.3, abs=4.0 * threshold.error)
    # beside a threshold that is found: the data would rather have that, to half an error, since
    # stays are those of the known one
    free = identified(["guard x >= *", "x' = v"])
    [coef], [errors] = free.estimator_.surface_.coef_, free.surface_errors_
    assert -coef[0] / coef[1] == pytest.approx(threshold.value, abs=0.5 * threshold.error)
    assert errors[0] / abs(coef[1]) == pytest.approx(threshold.error, rel=0.2)


def test_columns_far_from_zero_change_nothing():
    near, far = identified("guard x >= 0.3"), identified("guard x >= 300.3", offset=300.0)
    np.testing.assert_array_equal(near.modes_, far.modes_)
    np.testing.assert_allclose(
        near.estimator_.coef_[:, :, 1:], far.estimator_.coef_[:, :, 1:], atol=1e-4
    )
    assert far.known_[0].value == pytest.approx(near.known_[0].value + 300.0, abs=1e-3)


@pytest.mark.parametrize("wrong", ["guard x >= 0.36", "guard x >= 0.6", "guard v >= *"])
def test_a_wrong_guard_is_found(wrong):
    """Seven standard errors off, grossly off, and of another column."""
    found = identified([wrong, "x' = v"])
    guard, law = found.known_
    assert guard.questioned and not law.questioned
    assert guard.name.startswith("guard x") and "would rather have guard x" in str(found.report_)
    assert guard.value == pytest.approx(0.3, abs=4.0 * guard.error)


def test_it_is_saved_and_exported(tmp_path):
    found = identified("guard x >= 0.3")
    save_model(found, tmp_path / "model.json")
    again = load_model(tmp_path / "model.json")
    assert again.known_ == found.known_
    run = found.simulate([1.0, 1.0], T).x
    np.testing.assert_array_equal(again.simulate([1.0, 1.0], T).x, run)
    assert len(found.to_hybrid_system().surfaces.functions) == 1


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: rows(2, ["guard x >= 1", "guard v >= *"]), "all surfaces have one shape"),
        (lambda: rows(2, "guard w >= 1"), "the terms are 1, x, v, x\\^2, x v, v\\^2"),
        (lambda: rows(2, "guard x >= 1", surface=SVC()), "that may be any polynomial"),
        (lambda: rows(3, "guard x >= 1"), "parts two modes and not 3"),
        (lambda: identified("guard x >= 1", n_modes=4), "parts two modes and not 4"),
        (
            lambda: HybridAutomatonRegressor(known="guard x >= 1").fit(
                np.eye(20, 2), np.arange(20)
            ),
            "has a guard of its own",
        ),
    ],
)
def test_what_cannot_be_is_refused(call, said):
    with pytest.raises(ValueError, match=said):
        call()
