"""The largest margin, and what a margin certifies."""

import numpy as np
import pytest
from sklearn.preprocessing import PolynomialFeatures

from swsysid import FunctionLibrary, IdentificationWarning, PolynomialSurfaceClassifier
from swsysid._results import Status
from swsysid._solvers.conic import linear_program
from swsysid._surfaces.margin_program import fit_surface
from swsysid._surfaces.margins import certify_margin, max_margin, nonzero_margin


def circle(n_samples, seed=0, gap=0.2):
    """Two classes on both sides of a ring around the unit circle."""
    rng = np.random.default_rng(seed)
    X = rng.uniform(-2.0, 2.0, size=(4 * n_samples, 2))
    radius = np.linalg.norm(X, axis=1)
    X = X[np.abs(radius - 1.0) > gap / 2][:n_samples]
    signs = np.where(np.linalg.norm(X, axis=1) > 1.0, 1.0, -1.0)
    return PolynomialFeatures(2).fit_transform(X), signs


def one_shot(features, signs, bound):
    """The remark's LP as the paper writes it, variables (a, t)."""
    n_samples, n_features = features.shape
    solution = linear_program(
        np.append(np.zeros(n_features), -1.0),
        A_ub=np.column_stack([-signs[:, None] * features, np.ones(n_samples)]),
        b_ub=np.zeros(n_samples),
        bounds=[(-bound, bound)] * n_features + [(-np.inf, np.inf)],
    )
    return -solution.objective


@pytest.mark.parametrize("n_samples", [30, 2000])
def test_largest_margin_agrees_with_the_whole_program(n_samples):
    features, signs = circle(n_samples)
    margin, coef, status = max_margin(features, signs, 10.0)
    assert status is Status.OPTIMAL
    assert margin == pytest.approx(one_shot(features, signs, 10.0), rel=1e-7)
    assert margin == pytest.approx((signs * (features @ coef)).min(), rel=1e-12)
    assert (np.abs(coef) <= 10.0).all()


def test_classes_that_overlap_have_margin_zero():
    features, signs = circle(1000)
    signs[::7] *= -1.0
    margin, _, status = max_margin(features, signs, 10.0)
    assert margin == 0.0
    assert status is Status.OPTIMAL


def test_largest_margin_scales_with_the_box():
    features, signs = circle(500)
    assert max_margin(features, signs, 30.0)[0] == pytest.approx(
        3.0 * max_margin(features, signs, 10.0)[0], rel=1e-9
    )


def test_the_counterexample_to_the_margin_theorem():
    # 999 points at 1 and one at 0.01, all on the positive side. t* = 0.01 * 10 = 0.1 with
    # a^ = 10, so the paper's hypothesis beta |a^| / N = 0.05 < epsilon <= t* needs a smaller
    # certificate: a^ = 1 has t = 0.01 and 5 * 1 / 1000 = 0.005 < 0.01. Yet the optimum is
    # a = 0.01 (slope -999 - 0.01 + 5 before, 5 - 0.01 after), with slack 0.01 - 0.0001.
    features = np.append(np.ones(999), 0.01)[:, None]
    signs, weight = np.ones((1000, 1)), np.ones(1000)
    fit = fit_surface(features, signs[:, 0], weight, margin=0.01, beta=5.0, bound=1.0)
    np.testing.assert_allclose(fit.coef, [0.01], atol=1e-12)
    slack = np.maximum(0.0, 0.01 - features @ fit.coef)
    assert slack.sum() == pytest.approx(0.0099, abs=1e-10)

    certificate = certify_margin(features, signs, weight, 0.01, 5.0, 1.0)
    least, largest = certificate.nonzero_interval[0]
    assert least == pytest.approx(0.005, abs=1e-12)
    assert largest == pytest.approx(0.01, abs=1e-12)
    assert least < 0.01 <= largest + 1e-15  # the hypothesis holds
    assert not certificate.zero_slack[0]  # and the paper's conclusion does not


def corners():
    """Four modes at the corners of a square whose second side is a hundredth of the first."""
    codes = np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]])
    labels = np.repeat(np.arange(4), 250)
    return codes[labels] * [1.0, 0.01], labels, codes


def test_pooled_over_surfaces_not_even_a_nonzero_surface_is_certified():
    # The paper adds up all surfaces: a_1 = (0.01, 0) and a_2 = (0, 1) have the margin t = 0.01,
    # and beta S / (N L) = 15 * 1.01 / 2000 = 0.0076 < eps = t. Yet the slope of the program of
    # the second surface at zero is 15 - 1000 * 0.01 > 0: a_2 = 0 is optimal, and the only optimum.
    X, labels, codes = corners()
    margin, beta = 0.01, 15.0
    certified = np.array([[0.01, 0.0], [0.0, 1.0]])
    assert (codes[labels] * (X @ certified.T)).min() == pytest.approx(margin, rel=1e-12)
    assert beta * np.abs(certified).sum() / (len(X) * 2) < margin
    classifier = PolynomialSurfaceClassifier(
        feature_library=FunctionLibrary([lambda x: x], names=["{}"]),
        standardize=False,
        margin=margin,
        beta=beta,
        coef_bound=1.0,
        mode_book=codes,
    )
    with pytest.warns(IdentificationWarning, match="a surface vanished"):
        classifier.fit(X, labels)
    np.testing.assert_allclose(classifier.coef_, [[0.01, 0.0], [0.0, 0.0]], atol=1e-12)

    certificate = classifier.margin_certificate(X, labels)
    np.testing.assert_allclose(certificate.margin, [1.0, 0.01], rtol=1e-9)
    least, largest = certificate.nonzero_interval.T
    np.testing.assert_allclose(least, 0.015, rtol=1e-9)
    assert least[1] > largest[1]  # no margin certifies the second surface
    assert not certificate.zero_slack[1]
    assert (
        nonzero_margin(X, codes[labels], np.ones(1000), _fits(X, labels, codes), beta, 1.0) is None
    )


def _fits(X, labels, codes):
    return [
        fit_surface(X, signs, np.ones(len(X)), 0.01, 15.0, 1.0)
        for signs in codes[labels].T.astype(float)
    ]


@pytest.mark.parametrize("beta", [1.0, 9.99, 10.01, 15.0, 999.0, 1001.0])
def test_a_surface_is_zero_exactly_if_beta_outweighs_the_summed_features(beta):
    # 0 is a subgradient at a = 0 if and only if |sum_i w_i sigma_i phi_i|_inf <= beta, whatever
    # the margin
    X, labels, codes = corners()
    for surface, signs in enumerate(codes[labels].T.astype(float)):
        size = np.abs(signs @ X).max()
        assert size == pytest.approx([1000.0, 10.0][surface])
        for margin in (1e-3, 1e-2):
            fit = fit_surface(X, signs, np.ones(len(X)), margin, beta, 1.0)
            assert (np.abs(fit.coef).max() > 1e-9) == (size > beta)


@pytest.mark.parametrize("fraction", [1e-3, 0.5, 1.0])
def test_the_lower_end_of_the_interval_is_not_needed(fraction):
    # a^ eps / t has the margin eps and costs beta |a^| eps / t < N eps: any eps up to t will do
    features, signs = circle(300)
    weight, beta = np.ones(300), 20.0
    certificate = certify_margin(features, signs[:, None], weight, 1e-2, beta, 10.0)
    least, largest = certificate.nonzero_interval[0]
    assert 0.0 < least < largest
    margin = fraction * least
    assert (
        np.abs(fit_surface(features, signs, weight, margin, beta, 10.0).coef).max() > 1e-3 * margin
    )


@pytest.mark.parametrize("beta", [0.0, 1e-3, 1.0])
@pytest.mark.parametrize("excess", [1e-2, 1e-5, 1e-7])
def test_zero_slack_needs_a_margin_up_to_the_largest(beta, excess):
    features, signs = circle(200)
    weight, largest = np.ones(200), max_margin(circle(200)[0], signs, 10.0)[0]
    beyond, within = (
        certify_margin(features, signs[:, None], weight, factor * largest, beta, 10.0)
        for factor in (1.0 + excess, 1.0 - excess)
    )
    assert not beyond.zero_slack[0]
    assert within.zero_slack[0] == (beta < 1.0)


def test_zero_slack_certifies_one_optimum_and_not_all():
    # one sample at 1, beta one: the slack saves what the coefficient costs, so that every a
    # between 0 and the margin is optimal, and only a = eps has no slack
    features, signs, weight = np.ones((1, 1)), np.ones((1, 1)), np.ones(1)
    assert certify_margin(features, signs, weight, 0.5, 1.0, 1.0).zero_slack[0]
    values = [max(0.0, 0.5 - a) + a for a in (0.0, 0.2, 0.5)]
    assert values == [0.5, 0.5, 0.5]


def test_stationarity_of_the_counterexample_with_its_active_box():
    # minimise beta a with 0.01 a >= 0.01, a >= 0.01, a <= 1: stationarity is
    # beta - 0.01 alpha_near - sum of the other alpha + nu = 0 with nu >= 0 of the box, which is
    # active at a = 1: the multiplier of the near sample is (5 + nu) / 0.01, at least 500
    x = np.append(np.ones(999), 0.01)
    solution = linear_program(
        np.array([5.0]),
        A_ub=-x[:, None],
        b_ub=np.full(1000, -0.01),
        bounds=[(-1.0, 1.0)],
    )
    assert solution.x[0] == pytest.approx(1.0, abs=1e-9)
    assert solution.objective == pytest.approx(5.0, abs=1e-9)
    for nu in (0.0, 3.0):  # dual value 0.01 alpha_near - nu is the same for all of them
        alpha = (5.0 + nu) / 0.01
        assert 0.01 * alpha - nu == pytest.approx(solution.objective)
        assert alpha >= 500.0


@pytest.mark.parametrize("fraction", [0.02, 0.5, 1.0])
def test_margins_of_the_interval_certify_a_nonzero_surface(fraction):
    features, signs = circle(300)
    weight, beta = np.ones(300), 2.0
    interval = certify_margin(features, signs[:, None], weight, 1e-2, beta, 10.0).nonzero_interval
    least, largest = interval[0]
    assert 0.0 < least < largest
    margin = least + fraction * (largest - least)
    assert np.abs(fit_surface(features, signs, weight, margin, beta, 10.0).coef).max() > 1e-6


@pytest.mark.parametrize("beta", [1e-4, 1e-2, 0.03, 0.3, 10.0, 100.0])
def test_zero_slack_agrees_with_the_hard_margin_program(beta):
    """Slack zero is optimal exactly if forbidding slack costs nothing."""
    features, signs = circle(120, gap=0.3)
    weight, margin, bound = np.ones(len(signs)), 0.05, 10.0
    n_features = features.shape[1]
    eye = np.eye(n_features)
    hard = linear_program(
        np.append(np.zeros(n_features), np.full(n_features, beta)),
        A_ub=np.block(
            [[-signs[:, None] * features, np.zeros_like(features)], [eye, -eye], [-eye, -eye]]
        ),
        b_ub=np.append(np.full(len(signs), -margin), np.zeros(2 * n_features)),
        bounds=[(-bound, bound)] * n_features + [(0.0, np.inf)] * n_features,
    )
    soft = fit_surface(features, signs, weight, margin, beta, bound)
    certificate = certify_margin(features, signs[:, None], weight, margin, beta, bound)
    expected = hard.objective <= soft.objective * (1.0 + 1e-7)
    assert certificate.zero_slack[0] == expected
    assert expected == (beta < 0.1)  # both answers occur


def test_a_margin_beyond_the_largest_has_slack():
    features, signs = circle(200)
    largest = max_margin(features, signs, 10.0)[0]
    certificate = certify_margin(features, signs[:, None], np.ones(200), 1.01 * largest, 0.0, 10.0)
    assert certificate.separable
    assert not certificate.zero_slack[0]
