"""Matrices in the shape of an arrow are what their entries say, and are solved as such."""

import numpy as np
import pytest
from scipy.linalg import LinAlgError

from swsysid._stays.arrow import Arrow

N_BAND, N_CORNER, WIDTH = 12, 3, 4


@pytest.fixture
def blocks():
    """Rows of a Jacobian: places in the band, derivatives there and in the corner."""
    numbers = np.random.default_rng(0)
    places = np.array([[k, k + 1, k + 3, k] for k in range(N_BAND - 3)])  # one place twice
    slopes = numbers.standard_normal((len(places), 5, 4))
    return places, slopes, numbers.standard_normal((len(places), 5, N_CORNER))


@pytest.fixture
def arrow(blocks):
    found = Arrow.zeros(N_BAND, N_CORNER, WIDTH)
    found.add(*blocks)
    return found


def dense(blocks):
    """The same matrix from whole rows."""
    places, slopes, shared = blocks
    rows = np.zeros((*slopes.shape[:2], N_BAND + N_CORNER))
    for block, own in enumerate(places):
        for column, place in enumerate(own):
            rows[block, :, place] += slopes[block, :, column]
    rows[:, :, N_BAND:] = shared
    rows = rows.reshape(-1, N_BAND + N_CORNER)
    return rows.T @ rows


def test_entries_are_sums_of_products(arrow, blocks):
    expected = dense(blocks)
    np.testing.assert_allclose(arrow.toarray(), expected, atol=1e-12)
    np.testing.assert_allclose(arrow.diagonal, np.diag(expected), rtol=1e-12)
    vector = np.arange(1.0, N_BAND + N_CORNER + 1)
    np.testing.assert_allclose(arrow @ vector, expected @ vector, rtol=1e-12)


def test_other_units_and_a_heavier_diagonal(arrow):
    unit = np.linspace(0.5, 2.0, N_BAND + N_CORNER)
    expected = np.outer(unit, unit) * arrow.toarray() + np.diag(unit)
    np.testing.assert_allclose(
        arrow.in_units(unit).with_diagonal(unit).toarray(), expected, atol=1e-12
    )


def test_systems_and_parts_of_the_inverse(arrow):
    whole, factor = arrow.toarray(), arrow.factor()
    right = np.cos(np.arange(N_BAND + N_CORNER))
    np.testing.assert_allclose(factor.solve(right), np.linalg.solve(whole, right), rtol=1e-9)
    inverse = np.linalg.inv(whole)
    np.testing.assert_allclose(factor.inverse_of_corner, inverse[N_BAND:, N_BAND:], rtol=1e-9)
    some = np.array([0, 5, 11])
    np.testing.assert_allclose(factor.diagonal_of_inverse(some), np.diag(inverse)[some], rtol=1e-9)


def test_a_matrix_that_is_not_positive_has_no_factor(arrow):
    with pytest.raises(LinAlgError):
        arrow.with_diagonal(-2.0 * arrow.diagonal).factor()
    corner = np.append(np.zeros(N_BAND), arrow.diagonal[N_BAND:])
    with pytest.raises(LinAlgError):
        arrow.with_diagonal(-corner).factor()


def test_a_band_alone_has_no_corner(blocks):
    places, slopes, shared = blocks
    found = Arrow.zeros(N_BAND, 0, WIDTH)
    found.add(places, slopes, shared[:, :, :0])
    right = np.random.default_rng(1).standard_normal(N_BAND)
    matrix = dense(blocks)[:N_BAND, :N_BAND]
    np.testing.assert_allclose(found.toarray(), matrix, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(
        found.factor().solve(right), np.linalg.solve(matrix, right), rtol=1e-8
    )
