"""The answer from velocities does not depend on units, on offsets, or on a factor of weights."""

import numpy as np
import pytest

from swsysid import PolynomialSurfaceClassifier, SwitchingSystemRegressor


def bumper(noise=0.05, seed=0):
    rng = np.random.default_rng(seed)
    x = rng.uniform(-1.5, 1.5, (250, 2))
    force = -x[:, 0] - 0.1 * x[:, 1] - 15.0 * np.maximum(x[:, 0] - 0.4, 0.0)
    velocities = np.column_stack([x[:, 1], force])
    return x, velocities + noise * rng.standard_normal(velocities.shape)


def fitted(X, y, weight=None):
    estimator = SwitchingSystemRegressor(
        2, feature_library=1, sparsity="auto", random_state=0,
        surface=PolynomialSurfaceClassifier(degree=1),
    )  # fmt: skip
    return estimator.fit(X, y, sample_weight=weight)


@pytest.fixture(scope="module")
def usual():
    return fitted(*bumper())


@pytest.mark.parametrize("unit", [2.0**-40, 2.0**40])
def test_terms_and_coefficients_are_the_same_in_any_unit(usual, unit):
    X, y = bumper()
    other = fitted(X * unit, y * unit)
    np.testing.assert_array_equal(other.coef_ != 0.0, usual.coef_ != 0.0)
    np.testing.assert_allclose(other.coef_ / [unit, 1.0, 1.0], usual.coef_, atol=1e-9)
    np.testing.assert_array_equal(other.modes_, usual.modes_)


@pytest.mark.parametrize("offset", [30.0, 1e3, 1e6])
def test_laws_and_surface_are_found_far_from_zero(usual, offset):
    X, y = bumper()
    other, moves = fitted(X + [offset, 0.0], y), np.array([offset, 0.0])
    # rows beside the bumper may fall to either side, as the surface is known to the noise there
    assert (other.predict_modes(X + moves) == usual.predict_modes(X)).mean() > 0.98
    away = np.abs(X[:, 0] - 0.4) > 0.1
    np.testing.assert_allclose(other.predict(X[away] + moves), usual.predict(X[away]), atol=0.05)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("factor", [1e-12, 1e-3, 2.0, 1e6, 1e12])
def test_a_factor_of_all_weights_changes_nothing(usual, factor):
    X, y = bumper()
    other = fitted(X, y, np.full(len(X), factor))
    np.testing.assert_array_equal(other.coef_, usual.coef_)
    np.testing.assert_array_equal(other.surface_.coef_, usual.surface_.coef_)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("factor", [1e-9, 1e6])
def test_neither_does_one_of_blocks_of_different_sizes(usual, factor):
    X, y = (np.split(every, [30, 170]) for every in bumper())
    other = fitted(X, y, [np.full(len(block), factor) for block in X])
    np.testing.assert_array_equal(other.coef_, usual.coef_)


@pytest.mark.parametrize("factor", [2.0**-30, 2.0**30])
def test_such_weights_still_compare_rows(factor):
    X, y = bumper()
    weight = np.where(np.arange(len(X)) % 2, 1.0, 0.25)
    in_counts = weight * (4.0 if factor > 1.0 else 1.0)
    one, other = fitted(X, y, in_counts), fitted(X, y, factor * weight)
    np.testing.assert_array_equal(one.coef_, other.coef_)


@pytest.mark.filterwarnings("error")
def test_inverse_variances_of_any_size_are_weights(usual):
    X, y = bumper()
    weight = np.where(np.arange(len(X)) % 2, 1e9, 1.0)
    other = fitted(X, y, weight)  # as if half of the rows were all
    np.testing.assert_allclose(other.coef_, usual.coef_, atol=0.3)
