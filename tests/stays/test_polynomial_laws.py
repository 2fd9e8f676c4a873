"""Affine laws step as all laws do, without asking their features."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from swsysid import FunctionLibrary
from swsysid._data.features import FeatureMap
from swsysid._stays.laws import Laws
from swsysid._stays.polynomial_laws import AffineLaws, PolynomialLaws, laws_of

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


@pytest.mark.parametrize("library", [1, None, 3])
@pytest.mark.parametrize("share_free", [0.0, 0.6])
def test_the_flow_of_one_mode_is_a_step_with_its_own_coefficients(numbers, library, share_free):
    known, plain = laws(numbers, library, share_free)
    modes, x, _, u, after, duration = step_of(numbers, 0)
    modes[:] = 1
    Z = np.zeros((N_ROWS, N_STATES, N_STATES + plain.n_free))
    Z[:, np.arange(N_STATES), np.arange(N_STATES)] = 1.0
    states, Z = plain.varied_step(modes, x, Z, u, after, duration)
    own = N_STATES + plain.columns_of(1)
    for one in (known, plain):
        found, by_state, by_law = one.flow(1, x, u, after, duration)
        np.testing.assert_allclose(found, states, rtol=1e-12)
        # the plain laws take slopes of features as differences: 1e-6 of the largest of a row
        expected = Z.transpose(2, 1, 0)
        largest = np.abs(expected).max(axis=(0, 1))
        assert (np.abs(by_state - expected[:N_STATES]) <= 2e-5 * largest).all()
        assert (np.abs(by_law - expected[own]) <= 2e-5 * largest).all()


@pytest.mark.parametrize("order", [4, 8])
def test_steps_that_last_equally_long_are_those_of_any_length(numbers, order):
    affine = replace(laws(numbers, 1)[0], order=order)
    _, x, _, u, after, duration = step_of(numbers, 0)
    equal = np.full(N_ROWS, 0.3)
    ends, by_state, by_law = affine.flow(1, x, u, after, equal)
    assert by_state.shape[2] == 1
    # beside a step of another length each of them is worked by itself
    wide = (np.concatenate([part, part[:1]]) for part in (x, u, after))
    others = affine.flow(1, *wide, np.append(equal, 0.2))
    np.testing.assert_allclose(ends, others[0][:-1], rtol=1e-12)
    for own, other in ((by_state, others[1]), (by_law, others[2])):
        np.testing.assert_allclose(np.broadcast_to(own, other[..., :-1].shape), other[..., :-1],
                                   rtol=1e-9, atol=1e-13)  # fmt: skip


def test_a_step_of_high_order_is_the_exponential(numbers):
    affine, _ = laws(numbers, 1)
    modes, x, _, u, _, duration = step_of(numbers, 0)
    errors = []
    for own in affine.sharper:
        found = own.step(modes, x, u, u, duration)
        exact = []
        for mode, state, held, h in zip(modes, x, u, duration, strict=True):
            whole = np.zeros((N_STATES + 1, N_STATES + 1))
            whole[:-1] = np.column_stack(
                [own._parts[0][mode], own._parts[1][mode] @ held + own._parts[2][mode]]
            )
            exact.append((expm(h * whole) @ np.append(state, 1.0))[:-1])
        errors.append(np.abs(found - exact).max())
    # two orders more: (A h)^2 / 30 and less, and the products A h are .4 at most
    assert errors[1] < errors[0] / 100.0 and errors[2] < errors[1] / 100.0


def test_other_libraries_keep_their_features(numbers):
    assert isinstance(laws(numbers, 2)[0], PolynomialLaws)
    assert type(laws(numbers, FunctionLibrary([np.sin, np.cos]))[0]) is Laws
