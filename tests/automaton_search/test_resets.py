"""Resets from states before and after: few terms, and none where the state goes on."""

import numpy as np
import pytest

from swsysid._automaton_search.resets import best_reset

RNG = np.random.default_rng(0)
BEFORE = RNG.normal(size=(25, 3))
ERRORS = np.full(3, 1e-6)
NONE = np.zeros(0, dtype=np.intp)


@pytest.mark.parametrize(
    ("matrix", "offset"),
    [
        (np.eye(3), [0.0, 0.0, 0.0]),
        (np.diag([1.0, -0.8, 1.0]), [0.0, 0.0, 0.0]),
        (np.diag([1.0, 1.0, 0.0]), [0.0, 0.0, 0.3]),
        (np.array([[1.0, 0.0, 0.0], [0.4, 1.0, -0.2], [0.0, 0.0, 1.0]]), [0.0, 0.1, 0.0]),
    ],
)
def test_an_affine_reset_is_found_to_rounding(matrix, offset):
    found = best_reset(BEFORE, BEFORE @ matrix.T + offset, ERRORS, NONE)
    np.testing.assert_allclose(found.reset.matrix, matrix, atol=1e-9)
    np.testing.assert_allclose(found.reset.offset, offset, atol=1e-9)
    changed = (matrix != np.eye(3)).any(axis=1) | (np.array(offset) != 0.0)
    np.testing.assert_array_equal(found.changed, changed)


def test_noise_is_no_reset():
    after = BEFORE + 0.01 * RNG.normal(size=BEFORE.shape)
    assert not best_reset(BEFORE, after, np.full(3, 0.01), NONE).changed.any()


def test_a_false_switch_does_not_count():
    after = BEFORE * [1.0, -0.5, 1.0]
    after[3] = 7.0
    found = best_reset(BEFORE, after, ERRORS, NONE)
    # least absolute deviations go through the other switches
    np.testing.assert_allclose(found.reset.matrix, np.diag([1.0, -0.5, 1.0]), atol=1e-6)


def test_terms_that_are_one_at_all_switches_are_not_taken_together():
    before = BEFORE.copy()
    before[:, 0] = 2.0  # where the guard is zero
    after = before.copy()
    after[:, 1] = 0.6
    found = best_reset(before, after, ERRORS, NONE)
    np.testing.assert_allclose(before @ found.reset.matrix.T + found.reset.offset, after, atol=1e-9)
    terms = np.append(found.reset.matrix[1], found.reset.offset[1])
    assert (np.abs(terms) > 1e-12).sum() == 1


def test_components_that_are_held_go_on():
    found = best_reset(BEFORE, BEFORE + [0.0, 1.0, 1.0], ERRORS, np.array([1]))
    np.testing.assert_array_equal(found.changed, [False, False, True])
