"""The noise model: densities are densities, scales are scales, weights are repetitions."""

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad

from swsysid._noise import (
    NORMAL,
    STUDENT,
    Outliers,
    mixed_with_outliers,
    robust_regression,
    robust_scale,
    robust_weights,
    weighted_quantile,
)

NOISES = {"normal": NORMAL, "student": STUDENT}


class TestQuantiles:
    def test_by_hand(self):
        values, weights = np.array([30.0, 10.0, 20.0]), np.array([1.0, 2.0, 1.0])
        found = weighted_quantile(values, weights, np.array([0.25, 0.5, 0.6, 0.75, 1.0]))
        assert found.tolist() == [10, 10, 20, 20, 30]
        assert weighted_quantile(values, weights, 0.5) == 10

    def test_columns_by_hand(self):
        values = np.array([[3.0, -1.0], [1.0, 5.0], [2.0, 0.0], [9.0, 7.0]])
        # half of four rows is two: the second smallest
        assert weighted_quantile(values, np.ones(4), 0.5, axis=0).tolist() == [2.0, 0.0]
        # three of six are reached by 1, 1, 1 in the first column and by -1, 0, 5 in the second
        weights = np.array([1.0, 3.0, 1.0, 1.0])
        assert weighted_quantile(values, weights, 0.5, axis=0).tolist() == [1.0, 5.0]

    @pytest.mark.parametrize("n_rows", [1, 2, 7, 400])
    def test_a_weight_is_a_repetition(self, n_rows):
        rng = np.random.default_rng(n_rows)
        values, weight = rng.standard_normal((n_rows, 3)), rng.integers(1, 5, n_rows)
        repeated = np.repeat(values, weight, axis=0)
        expected = weighted_quantile(repeated, np.ones(len(repeated)), 0.5, axis=0)
        found = weighted_quantile(values, weight.astype(float), 0.5, axis=0)
        np.testing.assert_array_equal(found, expected)
        np.testing.assert_array_equal(
            weighted_quantile(values, np.full(n_rows, 0.3), 0.5, axis=0),
            np.quantile(values, 0.5, axis=0, method="inverted_cdf"),
        )


class TestScales:
    def test_normal_errors_have_their_standard_deviation(self):
        errors = [1.0, 1e-3] * np.random.default_rng(0).standard_normal((4001, 2))
        expected = stats.median_abs_deviation(errors, center=lambda x, axis: 0.0, scale="normal")
        np.testing.assert_allclose(robust_scale(errors), expected, rtol=1e-12)
        np.testing.assert_allclose(robust_scale(errors, np.full(4001, 2.0)), expected, rtol=1e-12)
        np.testing.assert_allclose(robust_scale(errors), [1.0, 1e-3], rtol=0.05)

    def test_scale_of_students_errors_is_the_most_likely(self):
        errors = stats.t(4).rvs((500, 1), random_state=1) * 3.0
        scale = STUDENT.scale(errors)
        _, _, expected = stats.t.fit(errors, f0=4, floc=0)
        np.testing.assert_allclose(scale, expected, rtol=1e-3)
        assert STUDENT.scale(errors, floor=100.0) == 100.0


@pytest.mark.parametrize("noise", NOISES.values(), ids=NOISES)
class TestDensities:
    def test_of_one_output(self, noise):
        law = stats.norm(scale=2.0) if noise is NORMAL else stats.t(4, scale=2.0)
        errors = np.linspace(-9, 9, 7)
        np.testing.assert_allclose(noise.cost(errors, 2.0), -law.logpdf(errors), rtol=1e-12)

    def test_of_two_outputs(self, noise):
        shape = np.diag([4.0, 9.0])
        law = (
            stats.multivariate_normal(cov=shape)
            if noise is NORMAL
            else stats.multivariate_t(shape=shape, df=4)
        )
        errors = np.random.default_rng(2).standard_normal((5, 2))
        squares = np.square(errors / [2.0, 3.0]).sum(axis=1)
        found = noise.log_density(squares, np.log(6.0), n_outputs=2)
        np.testing.assert_allclose(found, law.logpdf(errors), rtol=1e-12)

    def test_weights_are_slopes_of_the_density(self, noise):
        squares, step = np.array([0.0, 1.0, 30.0]), 1e-6
        slope = noise.log_density(squares + step, 0.0, 3) - noise.log_density(squares, 0.0, 3)
        np.testing.assert_allclose(noise.weight(squares, 3), -2.0 * slope / step, rtol=1e-5)

    def test_with_outliers_it_is_still_a_density(self, noise):
        targets = np.array([[0.0], [1.0], [2.0], [3.0]])
        outliers = Outliers.among(targets, np.ones(4), breadth=5.0)

        def density(value):
            inside = noise.log_density(np.square(value), 0.0)
            outside = outliers.log_density(np.array([[value]]))[0]
            return np.exp(mixed_with_outliers(inside, outside, 0.1)[0])

        assert quad(density, -np.inf, np.inf)[0] == pytest.approx(1.0, rel=1e-6)


def test_probability_of_an_outlier_by_hand():
    log_density, inlier = mixed_with_outliers(np.log(0.5), np.log(0.1), 0.5)
    assert log_density == pytest.approx(np.log(0.3))
    assert inlier == pytest.approx(5.0 / 6.0)


def test_outliers_are_at_least_as_broad_as_asked():
    outliers = Outliers.among(np.ones((5, 2)), np.ones(5), breadth=5.0, least=np.array([2.0, 3.0]))
    assert outliers.deviation.tolist() == [2.0, 3.0]
    assert outliers.log_density(np.ones((1, 2))) == pytest.approx(-np.log(12.0 * np.pi))


def test_a_regression_bears_gross_errors():
    rng = np.random.default_rng(3)
    design = rng.standard_normal((300, 2)) * [1.0, 1e4]
    target = design @ [1.0, 2e-4] + 0.01 * rng.standard_normal(300)
    target[:30] += 100.0
    np.testing.assert_allclose(robust_regression(design, target), [1.0, 2e-4], rtol=0.01)
    assert np.abs(robust_regression(design, target, robust=False) - [1.0, 2e-4]).max() > 0.1
    residuals = np.column_stack([target - design @ [1.0, 2e-4], np.zeros(300)])
    weights = robust_weights(residuals)
    assert weights[:30].max() < 1e-3 < 0.3 < np.median(weights[30:])
