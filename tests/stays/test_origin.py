"""Recordings far from zero, and in any unit: the same laws, surfaces and errors."""

import numpy as np
import pytest

from swsysid import (
    FunctionLibrary,
    PolynomialSurfaceClassifier,
    SwitchingSystemRegressor,
    TrajectoryIdentifier,
)
from swsysid._results import IdentificationWarning
from swsysid._stays.certainty import errors_by, slopes_of
from swsysid._stays.given import read_given
from swsysid._stays.origin import Origin
from swsysid.refinement import StatedModel, StatedSurface

T = np.linspace(0.0, 8.0, 121)


def recordings(model, starts, seed=0, noise=0.01):
    rng = np.random.default_rng(seed)
    runs = [model.simulate(start, T).x for start in starts]
    return [{"t": T, "x": run + noise * rng.standard_normal(run.shape)} for run in runs]


def moved(given, offset=0.0, unit=1.0):
    return [{**one, "x": (one["x"] + offset) * unit} for one in given]


def damped():
    law = [[0.0, 1.0], [-1.0, -0.2]]
    return recordings(StatedModel(None, law, states=["x", "v"]), ([1, 1], [-2, 0]))


def softer_on_one_side():
    laws = [[[0, 1], [-1, -0.1]], [[0, 1], [-4, -0.1]]]
    surface = StatedSurface([[0, 1, 0]], 1)
    plant = StatedModel(None, laws, states=["x", "v"], surface=surface)
    return recordings(plant, ([1, 1], [-2, 0], [1.5, -1]))


def one_mode(degree=1):
    return SwitchingSystemRegressor(1, feature_library=degree, random_state=0)


def test_columns_near_zero_are_not_moved():
    given = read_given(moved(damped(), [3.0, -2.0]), None, None, None)
    assert not Origin.of(given, one_mode()).moves


@pytest.mark.parametrize(
    "library", [None, FunctionLibrary([lambda x: 1 + 0 * x, np.sin])], ids=["no constant", "sines"]
)
def test_columns_are_not_moved_where_no_constant_tells_of_it(library):
    given = read_given(moved(damped(), [1e3, 0.0]), None, None, None)
    assert Origin.of(given, one_mode()).offset[0] == pytest.approx(1e3, rel=1e-3)
    assert not Origin.of(given, SwitchingSystemRegressor(1, feature_library=library)).moves
    bounded = SwitchingSystemRegressor(1, feature_library=1, coef_bound=10.0)
    assert not Origin.of(given, bounded).moves
    given = read_given(moved(damped(), [1e5, 0.0]), None, None, None)
    with pytest.warns(IdentificationWarning, match="subtract a constant"):
        Origin.of(given, bounded)


def test_errors_of_a_law_told_elsewhere():
    # x' = b + a (x - 3) is (b - 3 a) + a x: the variance of the constant is
    # var b - 6 cov(a, b) + 9 var a
    covariance = np.array([[4.0, 1.0], [1.0, 2.0]])
    change = np.array([[1.0, 0.0], [-3.0, 1.0]])
    places = (np.zeros(2, int), np.zeros(2, int), np.arange(2))
    errors = errors_by(slopes_of((1, 1, 2), places, change), covariance)
    np.testing.assert_allclose(errors, np.sqrt([[[4.0 - 6.0 + 18.0, 2.0]]]))


def test_a_law_is_the_same_a_million_deviations_from_zero():
    found, far = (
        TrajectoryIdentifier(one_mode(degree)).fit(moved(damped(), [offset, 0.0]))
        for degree, offset in ((1, 0.0), (1, 1e6))
    )
    np.testing.assert_allclose(
        far.estimator_.coef_[..., 1:], found.estimator_.coef_[..., 1:], atol=1e-6
    )
    rows = np.vstack([one["x"] for one in damped()])
    np.testing.assert_allclose(
        far.predict(rows + [1e6, 0.0]), found.predict(rows), atol=1e-6 * np.abs(rows).max()
    )
    np.testing.assert_allclose(far.states_ - [1e6, 0.0], found.states_, atol=1e-6)
    np.testing.assert_allclose(far.coef_errors_[..., 1:], found.coef_errors_[..., 1:], rtol=1e-3)
    # the constant is as unsure as the law is a million deviations away
    np.testing.assert_allclose(
        far.coef_errors_[0, :, 0], 1e6 * far.coef_errors_[0, :, 1], rtol=1e-3
    )
    assert far.score(moved(damped(), [1e6, 0.0])) == pytest.approx(found.score(damped()), abs=1e-6)


def test_powers_that_double_precision_does_not_hold_are_said():
    given = moved(damped(), [1e6, 0.0])
    with pytest.warns(IdentificationWarning, match="subtract a constant"):
        TrajectoryIdentifier(one_mode(degree=3)).fit(given)


@pytest.mark.parametrize("unit", [2.0**-40, 2.0**40])
def test_a_law_is_the_same_in_any_unit(unit):
    # powers of two: products are exact, so the answer is the same to the last digits
    found, other = (
        TrajectoryIdentifier(one_mode()).fit(moved(damped(), unit=size)) for size in (1.0, unit)
    )
    np.testing.assert_allclose(
        other.estimator_.coef_ / [unit, 1.0, 1.0], found.estimator_.coef_, atol=1e-9
    )
    scores = [one.score(moved(damped(), unit=size)) for one, size in ((found, 1.0), (other, unit))]
    assert scores[0] == pytest.approx(scores[1], abs=1e-9)


def two_modes():
    surface = PolynomialSurfaceClassifier(degree=1)
    return SwitchingSystemRegressor(2, feature_library=1, surface=surface, random_state=0)


@pytest.fixture(scope="module")
def two_laws():
    return TrajectoryIdentifier(two_modes()).fit(softer_on_one_side())


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("offset", "unit"),
    [(100.0, 1.0), (1e4, 1.0), (1e6, 1.0), (0.0, 1e-12), (0.0, 1e12), (1e4, 1e-9)],
)
def test_two_laws_and_their_surface_are_the_same_anywhere_and_in_any_unit(two_laws, offset, unit):
    found, given, moves = two_laws, softer_on_one_side(), np.array([offset, 0.0])
    other = TrajectoryIdentifier(two_modes()).fit(moved(given, moves, unit))
    rows = np.vstack([one["x"] for one in given])
    names = found.predict_modes(rows) == other.predict_modes((rows + moves) * unit)
    agree = max(names.mean(), 1.0 - names.mean())
    # a surface through zero has no constant there and one elsewhere, known to some hundredths
    assert agree > 0.97
    away = np.abs(rows[:, 0]) > 0.05
    # three standard errors of the laws
    np.testing.assert_allclose(
        other.predict((rows + moves)[away] * unit) / unit, found.predict(rows[away]), atol=0.06
    )
    assert other.score(moved(given, moves, unit)) == pytest.approx(found.score(given), abs=1e-4)
