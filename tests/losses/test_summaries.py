"""Summaries of many rows lead to the coefficients that all rows would lead to."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from swsysid._losses import get_loss
from swsysid._losses.base import TrustRegion
from swsysid._losses.l1 import SignSummary
from swsysid._losses.l2 import NormSummary
from swsysid._losses.squared import GramSummary
from swsysid._solvers.lad import least_absolute_deviations

SUMMARIES = [SignSummary, GramSummary, NormSummary]
EVERYWHERE = np.ones((2, 4), dtype=bool)


def regression(n_samples=3000, seed=0, spread=0.3):
    """Features with a constant, two outputs with heavy tails, weights, and near coefficients."""
    rng = np.random.default_rng(seed)
    design = np.column_stack([np.ones(n_samples), rng.standard_normal((n_samples, 3))])
    coef = rng.uniform(-1, 1, (2, 4))
    targets = design @ coef.T + spread * rng.standard_t(3, (n_samples, 2))
    weight = rng.integers(1, 4, n_samples).astype(float)
    return design, targets, weight, coef + 0.02 * rng.standard_normal(coef.shape)


def reaching(design, size):
    """A reach by the Gram matrix of the rows, for changes of the given size in its norm."""
    metric = np.linalg.inv(np.linalg.cholesky(design.T @ design)).T
    most = np.linalg.norm(design @ metric, axis=1).max()
    return TrustRegion(metric, np.broadcast_to(size, 2).astype(float), float(most))


def reach_to(design, coef, aim):
    """A reach just wide enough for a change from some coefficients to others."""
    return reaching(design, 1.001 * np.linalg.norm(design @ (aim - coef).T, axis=0))


def absolute(design, targets, weight, coef):
    return weight @ np.abs(targets - design @ coef.T)


def assert_joined(cls, design, targets, weight, coef, reach):
    """Summaries of three blocks, joined, lead to the coefficients of one block."""
    whole = cls.of(design, targets, weight, coef, reach)
    blocks = [slice(None, 10), slice(10, 2000), slice(2000, None)]
    parts = [cls.of(design[b], targets[b], weight[b], coef, reach) for b in blocks]
    joined = cls.joined(parts)
    one, two = (each.fit(coef, np.inf, EVERYWHERE) for each in (whole, joined))
    assert np.abs(one - two).max() < 1e-10
    return whole, joined


# -- absolute deviations -------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_signs_lead_to_the_least_absolute_deviations(seed):
    design, targets, weight, coef = regression(seed=seed)
    exact = least_absolute_deviations(design, targets, sample_weight=weight)
    reach = reach_to(design, coef, exact.coef)
    summary = SignSummary.of(design, targets, weight, coef, reach)
    assert max(map(len, summary.near)) < 0.5 * len(design)
    found = summary.fit(coef, np.inf, EVERYWHERE)
    objective = absolute(design, targets, weight, found)
    assert objective == pytest.approx(exact.objective, rel=1e-9)


def test_signs_bound_the_deviations_from_below():
    design, targets, weight, coef = regression()
    summary = SignSummary.of(design, targets, weight, coef, reaching(design, 1.0))
    rng = np.random.default_rng(1)
    for size in (0.0, 0.01, 0.1, 1.0, 10.0):
        other = coef + size * rng.standard_normal(coef.shape)
        for output, one in enumerate(other):
            rows = np.vstack([summary.near[output], summary.sums[:, output]])
            bound = np.abs(rows @ np.append(one, -1.0)).sum()
            true = absolute(design, targets, weight, other)[output]
            assert bound <= true * (1 + 1e-12)
            if size == 0.0:
                assert bound == pytest.approx(true, rel=1e-12)


def test_signs_of_blocks_are_joined():
    design, targets, weight, coef = regression()
    reach = reaching(design, 3.0)
    whole, joined = assert_joined(SignSummary, design, targets, weight, coef, reach)
    for one, two in zip(whole.near, joined.near, strict=True):
        assert np.array_equal(one, two)
    assert np.allclose(whole.sums, joined.sums, rtol=1e-12, atol=1e-10)


def test_an_output_that_is_met_exactly_keeps_its_coefficients():
    design, targets, weight, coef = regression()
    targets[:, 0] = design @ coef[0]
    summary = SignSummary.of(design, targets, weight, coef, reaching(design, [-1.0, 3.0]))
    found = summary.fit(coef, np.inf, EVERYWHERE)
    assert np.array_equal(found[0], coef[0]) and not np.array_equal(found[1], coef[1])


def test_signs_respect_box_and_support():
    design, targets, weight, coef = regression()
    support = np.array([[True, False, True, True], [True, True, True, False]])
    bound, coef = 0.3, np.where(support, coef, 0.0).clip(-0.3, 0.3)
    exact = np.zeros_like(coef)
    for output, free in enumerate(support):
        exact[output, free] = least_absolute_deviations(
            design[:, free], targets[:, [output]], sample_weight=weight, coef_bound=bound
        ).coef[0]
    assert np.abs(exact).max() == bound
    summary = SignSummary.of(design, targets, weight, coef, reach_to(design, coef, exact))
    found = summary.fit(coef, bound, support)
    assert np.abs(found).max() <= bound and not found[~support].any()
    objective = absolute(design, targets, weight, found)
    assert objective == pytest.approx(absolute(design, targets, weight, exact), rel=1e-9)


# -- squares -------------------------------------------------------------------------------------


def gram(design, targets, weight):
    nowhere = TrustRegion(np.zeros((4, 0)), np.zeros(2), 0.0)  # a Gram matrix needs none
    return GramSummary.of(design, targets, weight, np.zeros((2, 4)), nowhere)


def test_gram_leads_to_least_squares():
    design, targets, weight, coef = regression()
    root = np.sqrt(weight)[:, None]
    exact = np.linalg.lstsq(design * root, targets * root, rcond=None)[0].T
    found = gram(design, targets, weight).fit(coef, np.inf, EVERYWHERE)
    assert np.abs(found - exact).max() < 1e-12
    assert_joined(GramSummary, design, targets, weight, coef, reaching(design, 0.0))


def test_rows_are_taken_away_from_a_gram_matrix():
    design, targets, weight, coef = regression()
    some, rest = slice(0, 1000), slice(1000, None)
    less = GramSummary.joined(
        [gram(design, targets, weight), gram(design[some], targets[some], -weight[some])]
    )
    left = gram(design[rest], targets[rest], weight[rest])
    assert np.allclose(less.gram, left.gram, rtol=1e-12, atol=1e-9)
    one, two = (each.fit(coef, np.inf, EVERYWHERE) for each in (less, left))
    assert np.abs(one - two).max() < 1e-12


@pytest.mark.parametrize("bound", [0.1, 0.4])
def test_gram_respects_box_and_support(bound):
    design, targets, weight, coef = regression()
    support = np.array([[True, False, True, True], [True, True, True, False]])
    found = gram(design, targets, weight).fit(coef, bound, support)
    root = np.sqrt(weight)
    for output, free in enumerate(support):
        exact = lsq_linear(
            design[:, free] * root[:, None], targets[:, output] * root, (-bound, bound), tol=1e-14
        )
        assert np.abs(found[output, free] - exact.x).max() < 1e-7  # scipy's own accuracy
        assert not found[output, ~free].any()


def test_gram_of_badly_scaled_and_dependent_features():
    design, targets, weight, coef = regression()
    design[:, 1] *= 1e6
    design[:, 3] = design[:, 2]
    found = gram(design, targets, np.ones(len(design))).fit(coef, np.inf, EVERYWHERE)
    exact = np.linalg.lstsq(design, targets, rcond=None)[0].T
    assert np.abs(design @ (found - exact).T).max() < 1e-9
    assert np.abs(found[:, 2] - found[:, 3]).max() < 1e-9  # the least norm


# -- Euclidean norms -----------------------------------------------------------------------------


def norms(design, targets, weight, coef):
    return weight @ np.linalg.norm(targets - design @ coef.T, axis=1)


def test_norms_derivatives_by_finite_differences():
    design, targets, weight, coef = regression(300)
    summary = NormSummary.of(design, targets, weight, coef, reaching(design, 0.0))
    assert not len(summary.design)  # no row is within a reach of zero
    step = 1e-4
    shifts = step * np.eye(coef.size).reshape(-1, *coef.shape)
    value = [
        [norms(design, targets, weight, coef + sign * shift) for sign in (-1, 0, 1)]
        for shift in shifts
    ]
    below, here, above = np.array(value).T
    assert summary.gradient.ravel() == pytest.approx((above - below) / (2 * step), abs=1e-4)
    size = np.abs(summary.hessian).max()
    flat = summary.hessian.reshape(coef.size, coef.size)
    assert np.diag(flat) == pytest.approx((above - 2 * here + below) / step**2, abs=1e-3 * size)
    mixed = [
        sum(
            a * b * norms(design, targets, weight, coef + a * one + b * two)
            for a in (-1, 1)
            for b in (-1, 1)
        )
        / (4 * step**2)
        for one in shifts
        for two in shifts
    ]
    assert flat.ravel() == pytest.approx(np.array(mixed), abs=2e-3 * size)


def stepped(design, targets, weight, coef, *, bound=np.inf, support=EVERYWHERE, n_steps=4):
    """A few summaries, each with the reach of the step before."""
    reach = reaching(design, np.linalg.norm(design @ coef.T, axis=0) * 0.05)
    for _ in range(n_steps):
        before = coef
        coef = NormSummary.of(design, targets, weight, coef, reach).fit(coef, bound, support)
        reach = reach_to(design, coef, before)
    return coef


@pytest.mark.parametrize("bound", [np.inf, 0.3])
@pytest.mark.parametrize("seed", range(3))
def test_norms_lead_to_the_loss_own_fit(seed, bound):
    design, targets, weight, coef = regression(seed=seed)
    support = np.array([[True, False, True, True], [True, True, True, False]])
    exact = get_loss("l2").fit(
        design,
        targets,
        sample_weight=weight,
        coef_bound=None if np.isinf(bound) else bound,
        support=support,
    )
    start = np.where(support, coef, 0.0).clip(-bound, bound)
    found = stepped(design, targets, weight, start, bound=bound, support=support)
    assert not found[~support].any() and np.abs(found).max() <= bound
    value = norms(design, targets, weight, found)
    assert value <= exact.objective * (1 + 1e-9)
    assert value >= exact.lower_bound * (1 - 1e-9)


def test_norms_of_one_output_are_absolute_deviations():
    design, targets, weight, coef = regression()
    exact = least_absolute_deviations(design, targets[:, :1], sample_weight=weight)
    reach = reach_to(design, coef, np.vstack([exact.coef, coef[1:]]))
    reach = TrustRegion(reach.metric, reach.size[:1], reach.most)
    summary = NormSummary.of(design, targets[:, :1], weight, coef[:1], reach)
    found = summary.fit(coef[:1], np.inf, EVERYWHERE[:1])
    objective = absolute(design, targets[:, :1], weight, found)
    assert objective == pytest.approx(exact.objective, rel=1e-9)


def test_norms_of_blocks_are_joined():
    design, targets, weight, coef = regression()
    whole, joined = assert_joined(NormSummary, design, targets, weight, coef, reaching(design, 1.0))
    assert 0 < len(whole.design) < 0.2 * len(design)
    assert np.array_equal(whole.design, joined.design)
    assert np.allclose(whole.hessian, joined.hessian, rtol=1e-12, atol=1e-9)


def test_norms_that_vanish_keep_the_coefficients():
    design, _, weight, coef = regression()
    rounded = design @ coef.T * (1 + 1e-16 * np.arange(2))
    summary = NormSummary.of(design, rounded, weight, coef, reaching(design, [-1.0, -1.0]))
    assert np.array_equal(summary.fit(coef, np.inf, EVERYWHERE), coef)


@pytest.mark.parametrize("cls", SUMMARIES)
def test_weight_is_repetition(cls):
    design, targets, weight, coef = regression()
    rows = np.repeat(np.arange(len(design)), weight.astype(int))
    reach = reaching(design, 3.0)
    one = cls.of(design, targets, weight, coef, reach)
    two = cls.of(design[rows], targets[rows], np.ones(len(rows)), coef, reach)
    one, two = (each.fit(coef, np.inf, EVERYWHERE) for each in (one, two))
    assert np.abs(one - two).max() < 1e-8  # of coefficients of order one
