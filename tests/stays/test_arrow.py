"""Matrices in the shape of an arrow are what their blocks say, and are solved as such."""

import numpy as np
import pytest
from scipy.linalg import LinAlgError

from swsysid._known.program import Steps
from swsysid._stays.arrow import Arrow, CornerWithin, covariance_of

SIZE, N_BLOCKS, N_CORNER = 2, 6, 3
N_BAND = SIZE * N_BLOCKS


def blocks(n_corner=N_CORNER):
    """Blocks of a positive matrix, and the matrix."""
    numbers = np.random.default_rng(0)
    root = np.zeros((60, N_BAND + n_corner))
    root[:, N_BAND:] = numbers.standard_normal((60, n_corner))
    for k in range(N_BLOCKS):  # rows that meet a block and the next one
        rows = slice(10 * k, 10 * k + 10)
        last = min(N_BAND, SIZE * (k + 2))
        root[rows, SIZE * k : last] = numbers.standard_normal((10, last - SIZE * k))
    whole = root.T @ root
    band = whole[:N_BAND, :N_BAND].reshape(N_BLOCKS, SIZE, N_BLOCKS, SIZE)
    diagonal = np.stack([band[k, :, k] for k in range(N_BLOCKS)], axis=2)
    below = np.zeros((SIZE, SIZE, N_BLOCKS))
    for k in range(N_BLOCKS - 1):
        below[:, :, k] = band[k + 1, :, k]
    border = whole[N_BAND:, :N_BAND].reshape(n_corner, N_BLOCKS, SIZE)
    return Arrow.of_blocks(diagonal, below, border, whole[N_BAND:, N_BAND:]), whole


@pytest.mark.parametrize("n_corner", [0, N_CORNER])
def test_systems_are_solved(n_corner):
    arrow, whole = blocks(n_corner)
    right = np.cos(np.arange(len(whole)))
    np.testing.assert_allclose(
        arrow.factor().solve(right), np.linalg.solve(whole, right), rtol=1e-9
    )


def test_parts_of_the_inverse():
    arrow, whole = blocks()
    factor, inverse = arrow.factor(), np.linalg.inv(whole)
    np.testing.assert_allclose(factor.inverse_of_corner, inverse[N_BAND:, N_BAND:], rtol=1e-9)
    numbers, places = np.random.default_rng(1), np.array([[0, 1, 2, 3], [8, 9, 10, 11]])
    own, shared = numbers.standard_normal((2, 4)), numbers.standard_normal((2, N_CORNER))
    vectors = np.zeros((2, len(whole)))
    vectors[np.arange(2)[:, None], places] = own
    vectors[:, N_BAND:] = shared
    expected = np.einsum("vi,ij,vj->v", vectors, inverse, vectors)
    np.testing.assert_allclose(factor.quadratic_form(places, own, shared), expected, rtol=1e-9)


def test_other_units_of_the_corner():
    arrow, whole = blocks()
    unit = np.array([0.5, 2.0, 10.0])
    inverse = np.linalg.inv(whole)[N_BAND:, N_BAND:]
    found = arrow.in_units(unit).factor().inverse_of_corner
    np.testing.assert_allclose(found * unit[:, None] * unit, inverse, rtol=1e-9)


def test_damping_adds_to_what_is_known_of_the_corner_alone():
    arrow, whole = blocks()
    known = np.linalg.inv(np.linalg.inv(whole)[N_BAND:, N_BAND:])  # without the band
    damped = np.linalg.inv(arrow.factor(0.5, least=1.0).inverse_of_corner)
    np.testing.assert_allclose(damped, known + np.diag(0.5 * np.diag(known) + 1.0), rtol=1e-9)


def test_a_matrix_that_is_not_positive_has_no_factor():
    arrow, whole = blocks()
    with pytest.raises(LinAlgError):
        arrow.factor(least=-2.0 * np.diag(whole)[N_BAND:])


def test_what_is_positive_but_for_the_steps_it_is_within_is_said_at_once():
    # three unknowns of one sum, a matrix of rank one but for rounding: which of many such matrices
    # have a factor as a whole and none within a step is a matter of the machine
    nothing, told_late = (np.zeros((0, 3)), np.zeros(0)), 0
    for seed in range(3000):
        rng = np.random.default_rng(seed)
        row = rng.integers(1, 9, (1, 3)).astype(float) / rng.integers(1, 9)
        matrix = row.T @ row
        matrix[np.diag_indices(3)] *= 1.0 + 4e-16 * rng.integers(0, 3, 3)
        held = Steps(rng.integers(1, 5, (1, 3)).astype(float), np.zeros(1), *nothing)
        try:
            corner = CornerWithin(matrix, held)
        except LinAlgError:
            continue
        try:
            corner.check()
        except LinAlgError:
            told_late += 1
        else:
            assert np.isfinite(corner.over(np.eye(3))).all()
    assert told_late


def test_the_determinant_of_the_band():
    arrow, whole = blocks()
    expected = np.linalg.slogdet(whole[:N_BAND, :N_BAND])[1]
    assert arrow.log_det_of_band == pytest.approx(expected, rel=1e-10)


def test_what_a_right_side_says_of_the_corner():
    arrow, whole = blocks()
    right = np.cos(np.arange(len(whole)))
    np.testing.assert_allclose(
        np.linalg.solve(arrow.schur, arrow.pull(right)),
        np.linalg.solve(whole, right)[N_BAND:],
        rtol=1e-9,
    )
    factor = arrow.factor()
    z = factor.solve(right)[N_BAND:]
    np.testing.assert_allclose(factor.held_back(right, z), 0.0, atol=1e-10)


@pytest.mark.parametrize("size", [1.0, 1e-6])
def test_a_covariance_is_an_inverse_in_any_units_and_infinite_where_nothing_is_told(size):
    root = np.random.default_rng(2).standard_normal((9, 4)) * [1.0, size, 1.0, 1.0 / size]
    information = np.zeros((6, 6))
    information[:4, :4] = root.T @ root
    information[4, 4], information[4, 0], information[0, 4] = 4.0, 0.0, 0.0
    covariance = covariance_of(information)
    unit = np.sqrt(np.diag(information)[:5])
    expected = np.linalg.inv(information[:5, :5] / unit / unit[:, None])
    np.testing.assert_allclose(covariance[:5, :5] * unit * unit[:, None], expected, rtol=1e-9)
    assert covariance[5, 5] == np.inf and (covariance[5, :5] == 0.0).all()


def test_equalities_make_an_inverse_smaller():
    root = np.random.default_rng(3).standard_normal((9, 3))
    information, row = root.T @ root, np.array([[1.0, -2.0, 0.0]])
    held = Steps(row, np.zeros(1), np.zeros((0, 3)), np.zeros(0))
    free = np.linalg.inv(information)
    expected = free - free @ row.T @ row @ free / (row @ free @ row.T)
    np.testing.assert_allclose(covariance_of(information, held), expected, atol=1e-12)
