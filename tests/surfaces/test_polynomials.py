"""Bases of a surface: the same function in fitting coordinates and in the user's."""

import numpy as np
import pytest
from sklearn.preprocessing import FunctionTransformer, PolynomialFeatures

from swsysid._data.coordinates import shifted_monomials
from swsysid._surfaces.polynomials import LibraryBasis, PolynomialBasis


def sample(n_features=2, seed=0):
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(40, n_features)) * [3.0, 0.2, 1.0][:n_features] + 1.5
    return X, rng.uniform(0.5, 2.0, size=40)


@pytest.mark.parametrize("standardize", [True, False])
@pytest.mark.parametrize("degree", [0, 1, 3, 5])
def test_polynomials_keep_their_values(degree, standardize):
    X, weight = sample()
    basis = PolynomialBasis(degree, X, weight, standardize)
    plain = PolynomialFeatures(degree).fit_transform(X)
    coef = np.random.default_rng(1).normal(size=(2, plain.shape[1]))
    values = basis(X) @ coef.T
    np.testing.assert_allclose(
        plain @ basis.to_user(coef).T, values, rtol=1e-9, atol=1e-9 * np.abs(values).max()
    )
    if not standardize:
        np.testing.assert_array_equal(basis.to_user(coef), coef)


def test_shifts_compose():
    powers = PolynomialFeatures(4).fit(np.zeros((1, 2))).powers_
    centre, scale = np.array([0.3, -2.0]), np.array([2.0, 0.5])
    there = shifted_monomials(powers, centre, scale)
    back = shifted_monomials(powers, -centre / scale, 1.0 / scale)
    np.testing.assert_allclose(there @ back, np.eye(len(powers)), atol=1e-9)


def test_standardised_columns_have_mean_zero_and_size_one():
    X, weight = sample()
    linear = PolynomialBasis(1, X, weight, True)(X)[:, 1:]
    np.testing.assert_allclose(np.average(linear, axis=0, weights=weight), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.average(linear**2, axis=0, weights=weight), 1.0, atol=1e-12)


def test_a_constant_column_is_not_blown_up():
    X = np.column_stack([np.linspace(0.0, 1.0, 9), np.full(9, 0.1)])
    assert np.abs(PolynomialBasis(2, X, np.ones(9), True)(X)).max() < 10.0


@pytest.mark.parametrize("constant", [True, False])
def test_library_columns_keep_their_values(constant):
    X, weight = sample()

    def columns(X):
        varying = [np.sin(X[:, 0]), 100.0 + X[:, 1]]
        return np.column_stack(varying + [np.full(len(X), 4.0)] * constant)

    basis = LibraryBasis(FunctionTransformer(columns), X, weight, True)
    coef = np.random.default_rng(2).normal(size=(3, 2 + constant))
    np.testing.assert_allclose(
        columns(X) @ basis.to_user(coef).T, basis(X) @ coef.T, rtol=1e-10, atol=1e-10
    )
    centred = np.abs(np.average(basis(X)[:, :2], axis=0, weights=weight)) < 1e-10
    assert centred.all() == constant


def test_overflow_gets_a_sentence():
    with pytest.raises(ValueError, match="overflow"):
        PolynomialBasis(3, np.ones((2, 1)), np.ones(2), False)(np.array([[1e200]]))
