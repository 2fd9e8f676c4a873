"""Affine laws step as all laws do, without asking their features."""

import numpy as np
import pytest

from swsysid._data.features import FeatureMap
from swsysid._stays.affine import AffineLaws, laws_of
from swsysid._stays.laws import Laws

N_STATES, N_INPUTS, N_ROWS = 2, 1, 7


@pytest.fixture
def numbers():
    return np.random.default_rng(0)


def laws(numbers, library, share_free=0.6) -> tuple[Laws, Laws]:
    """Those of the library, and the same by its features."""
    columns = numbers.standard_normal((30, N_STATES + N_INPUTS))
    features = FeatureMap(library, columns, ["x", "v", "u"])
    coef = numbers.standard_normal((3, N_STATES, features.n_features_out))
    free = numbers.uniform(size=coef.shape) < share_free
    found = laws_of(coef, features, np.ones(N_STATES), free)
    return found, Laws(coef, features.at_rows, np.ones(N_STATES), free)


def step_of(numbers, n_free: int) -> tuple:
    """Modes, states, sensitivities, inputs before and after, durations (one of them zero)."""
    n_unknowns = N_STATES + n_free + 2
    duration = numbers.uniform(0.01, 0.4, N_ROWS)
    duration[2] = 0.0
    return (
        numbers.integers(0, 3, N_ROWS),
        numbers.standard_normal((N_ROWS, N_STATES)),
        numbers.standard_normal((N_ROWS, N_STATES, n_unknowns)),
        numbers.standard_normal((N_ROWS, N_INPUTS)),
        numbers.standard_normal((N_ROWS, N_INPUTS)),
        duration,
    )


@pytest.mark.parametrize("library", [1, None])
@pytest.mark.parametrize("share_free", [0.0, 0.6])
def test_a_step_is_that_of_runge_and_kutta(numbers, library, share_free):
    affine, plain = laws(numbers, library, share_free)
    assert isinstance(affine, AffineLaws)
    modes, x, Z, u, after, duration = step_of(numbers, affine.n_free)
    for found, expected in zip(
        affine.varied_step(modes, x, Z, u, after, duration),
        plain.varied_step(modes, x, Z, u, after, duration),
        strict=True,
    ):
        # the plain laws take slopes of features as differences: 1e-6 of them
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-7)
    states = plain.step(modes, x, u, after, duration)
    np.testing.assert_allclose(affine.step(modes, x, u, after, duration), states, rtol=1e-13)
    # a row that takes no time stays where it is
    np.testing.assert_array_equal(affine.step(modes, x, u, after, duration)[2], x[2])


def test_other_libraries_keep_their_features(numbers):
    assert not isinstance(laws(numbers, 2)[0], AffineLaws)
