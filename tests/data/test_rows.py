"""Canonical rows: order, merging and the map back."""

import numpy as np
import pytest

from swsysid._data.rows import canonical_rows, check_sample_weight, common_factor


def tied_table(n_samples=300, seed=0):
    rng = np.random.default_rng(seed)
    X = rng.integers(0, 3, size=(n_samples, 4)).astype(float)
    y = rng.integers(0, 2, size=n_samples)
    return X, y


def assert_same_rows(first, second):
    for a, b in zip(first.arrays, second.arrays, strict=True):
        np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(first.weight, second.weight)


def test_hand_case_with_a_dropped_row():
    rows = canonical_rows(
        [[1.0, 2.0], [0.0, 5.0], [1.0, 2.0], [1.0, 0.0]], sample_weight=[1, 0, 2, 1]
    )
    np.testing.assert_array_equal(rows.arrays[0], [[1.0, 0.0], [1.0, 2.0]])
    np.testing.assert_array_equal(rows.weight, [1.0, 3.0])
    np.testing.assert_array_equal(rows.inverse, [1, -1, 1, 0])
    np.testing.assert_array_equal(rows.restore(np.array([7.0, 8.0]), -1.0), [8.0, -1.0, 8.0, 7.0])


def test_agrees_with_numpy_unique():
    X, y = tied_table()
    rows = canonical_rows(X, y)
    table, inverse, counts = np.unique(
        np.column_stack([X, y]), axis=0, return_inverse=True, return_counts=True
    )
    np.testing.assert_array_equal(np.column_stack(rows.arrays), table)
    np.testing.assert_array_equal(rows.inverse, inverse.ravel())
    np.testing.assert_array_equal(rows.weight, counts)
    assert rows.arrays[1].dtype == y.dtype


@pytest.mark.parametrize("seed", range(3))
def test_order_of_rows_is_forgotten_bit_for_bit(seed):
    rng = np.random.default_rng(seed)
    X, y = tied_table(seed=seed)
    weight = rng.uniform(size=len(X))  # sums of such weights depend on their order
    order = rng.permutation(len(X))
    first = canonical_rows(X, y, sample_weight=weight)
    second = canonical_rows(X[order], y[order], sample_weight=weight[order])
    assert_same_rows(first, second)
    np.testing.assert_array_equal(first.inverse[order], second.inverse)


def test_weights_are_repetitions():
    X, y = tied_table()
    counts = np.random.default_rng(1).integers(0, 4, size=len(X))
    repeated = canonical_rows(np.repeat(X, counts, axis=0), np.repeat(y, counts))
    assert_same_rows(canonical_rows(X, y, sample_weight=counts), repeated)


def test_restore_returns_each_row_its_own_value():
    X, y = tied_table()
    rows = canonical_rows(X, y)
    np.testing.assert_array_equal(rows.restore(rows.arrays[0]), X)
    np.testing.assert_array_equal(rows.restore(rows.arrays[1]), y)


def test_signed_zeros_are_one_row():
    rows = canonical_rows([[-0.0, 1.0], [0.0, 1.0]])
    assert len(rows.weight) == 1
    assert not np.signbit(rows.arrays[0]).any()


@pytest.mark.parametrize(
    ("weight", "sentence"),
    [
        ([1.0, 2.0, 3.0], "one weight for each"),
        ([[1.0], [1.0]], "one weight for each"),
        ([1.0, -1.0], "negative"),
        ([1.0, np.nan], "NaN"),
        ([0.0, 0.0], "all sample weights are zero"),
    ],
)
def test_bad_weights_get_a_sentence(weight, sentence):
    with pytest.raises(ValueError, match=sentence):
        check_sample_weight(weight, 2)


def test_weights_on_both_sides_of_one_are_counts():
    assert common_factor(np.array([0.5, 2.0])) == common_factor(np.array([1.0, 9.0])) == 1.0


def test_weights_on_one_side_of_one_have_a_common_factor():
    assert common_factor(np.array([1e-9, 4e-9])) == 4e-9
    assert common_factor(np.array([3e6, 1e6])) == 1e6


def test_a_row_in_parts_is_a_whole_row():
    rows = canonical_rows(np.array([1.0, 1.0, 2.0]), sample_weight=[0.25, 0.75, 0.5])
    assert common_factor(rows.weight) == 1.0
