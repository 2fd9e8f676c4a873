"""The weighted median: by hand, by repetition, and against NumPy's."""

import numpy as np
import pytest

from swsysid._identification.scale import weighted_median


def test_by_hand():
    values = np.array([[3.0, -1.0], [1.0, 5.0], [2.0, 0.0], [9.0, 7.0]])
    # half of four rows is two: the second smallest
    assert weighted_median(values, np.ones(4)).tolist() == [2.0, 0.0]
    # three of six are reached by 1, 1, 1 in the first column and by -1, 0, 5 in the second
    assert weighted_median(values, np.array([1.0, 3.0, 1.0, 1.0])).tolist() == [1.0, 5.0]


@pytest.mark.parametrize("n_rows", [1, 2, 7, 400])
def test_a_weight_is_a_repetition(n_rows):
    rng = np.random.default_rng(n_rows)
    values, weight = rng.standard_normal((n_rows, 3)), rng.integers(1, 5, n_rows)
    repeated = np.repeat(values, weight, axis=0)
    expected = weighted_median(repeated, np.ones(len(repeated)))
    np.testing.assert_array_equal(weighted_median(values, weight.astype(float)), expected)
    np.testing.assert_array_equal(
        weighted_median(values, np.full(n_rows, 0.3)),
        np.quantile(values, 0.5, axis=0, method="inverted_cdf"),
    )
