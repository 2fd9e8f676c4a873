"""Losses and their dynamics programs: hand cases, duality, other solvers, symmetries."""

import numpy as np
import pytest

from swsysid._losses import LOSSES, get_loss
from swsysid._results import SolverError, Status

LOSS_NAMES = sorted(LOSSES)


def problem(seed=0, n_samples=150, n_features=5, n_outputs=2, noise=0.2):
    rng = np.random.default_rng(seed)
    design = rng.normal(size=(n_samples, n_features))
    truth = rng.normal(size=(n_outputs, n_features))
    return design, truth, design @ truth.T + noise * rng.normal(size=(n_samples, n_outputs))


def variants():
    """Keyword arguments of `fit` that exercise every constraint."""
    rng = np.random.default_rng(1)
    weight = rng.integers(0, 4, 150).astype(float)
    support = np.array([[1, 0, 1, 1, 0], [1, 1, 0, 0, 1]], dtype=bool)
    return {
        "free": {},
        "weights": {"sample_weight": weight},
        "box": {"coef_bound": 0.4},
        "support": {"support": support},
        "same_support": {"support": support[[0, 0]]},
        "everything": {"sample_weight": weight, "coef_bound": 0.3, "support": support},
    }


@pytest.mark.parametrize("name", LOSS_NAMES)
@pytest.mark.parametrize("variant", variants())
def test_agrees_with_a_conic_solver_and_proves_itself(name, variant):
    design, _, targets = problem()
    keywords = variants()[variant]
    fit = get_loss(name).fit(design, targets, **keywords)
    reference = get_loss(name).fit(design, targets, solver="clarabel", **keywords)
    assert fit.status is Status.OPTIMAL
    assert reference.status is Status.OPTIMAL
    # Both bounds hold for both objectives, which are therefore equal up to the gaps.
    assert fit.objective <= reference.objective * (1 + 1e-8)
    assert reference.lower_bound <= fit.objective * (1 + 1e-12)
    assert fit.objective - fit.lower_bound <= 5e-8 * fit.objective
    np.testing.assert_allclose(fit.objective, reference.objective, rtol=1e-8)
    weight = keywords.get("sample_weight", np.ones(len(design)))
    value = weight @ get_loss(name).values(targets - design @ fit.coef.T)
    assert fit.objective == pytest.approx(value, rel=1e-13)
    assert np.abs(fit.coef).max() <= keywords.get("coef_bound", np.inf)
    assert (fit.coef[~keywords.get("support", np.ones((2, 5), dtype=bool))] == 0).all()


@pytest.mark.parametrize("bound", [None, 0.4])
def test_l1_agrees_with_highs(bound):
    design, _, targets = problem(2)
    fit = get_loss("l1").fit(design, targets, coef_bound=bound)
    reference = get_loss("l1").fit(design, targets, coef_bound=bound, solver="highs")
    np.testing.assert_allclose(fit.objective, reference.objective, rtol=1e-10)
    np.testing.assert_allclose(reference.lower_bound, reference.objective, rtol=1e-10)
    np.testing.assert_allclose(fit.coef, reference.coef, atol=1e-9)


@pytest.mark.parametrize("name", LOSS_NAMES)
def test_one_sample_is_met(name):
    fit = get_loss(name).fit(np.array([[2.0]]), np.array([[4.0, -6.0]]))
    np.testing.assert_allclose(fit.coef, [[2.0], [-3.0]], atol=1e-15)
    assert fit.objective <= 1e-14


def test_three_points_by_hand():
    # A constant for each output: median, geometric median and mean of three points. The angle
    # at the first is above 120 degrees, so that the geometric median is that point itself.
    points = np.array([[0.0, 0.0], [-4.0, -1.0], [4.0, -1.0]])
    fits = {name: get_loss(name).fit(np.ones((3, 1)), points) for name in LOSS_NAMES}
    np.testing.assert_allclose(fits["l1"].coef.ravel(), [0.0, -1.0], atol=1e-14)
    np.testing.assert_allclose(fits["l2"].coef.ravel(), [0.0, 0.0], atol=1e-14)
    np.testing.assert_allclose(fits["squared"].coef.ravel(), [0.0, -2 / 3], atol=1e-14)
    assert fits["l1"].objective == pytest.approx(9.0, rel=1e-14)
    assert fits["l2"].objective == pytest.approx(2 * np.sqrt(17.0), rel=1e-14)
    assert fits["squared"].objective == pytest.approx(32.0 + 2 / 3, rel=1e-14)
    for fit in fits.values():
        assert fit.lower_bound == pytest.approx(fit.objective, rel=1e-9)


@pytest.mark.parametrize("name", ["l1", "l2"])
def test_gross_outliers_do_not_move_the_coefficients(name):
    design, truth, targets = problem(3, noise=0.0)
    rng = np.random.default_rng(4)
    outliers = rng.random(len(design)) < 0.2
    targets[outliers] += 20 * rng.normal(size=(outliers.sum(), 2))
    fit = get_loss(name).fit(design, targets)
    np.testing.assert_allclose(fit.coef, truth, rtol=0, atol=1e-11)
    np.testing.assert_allclose(fit.lower_bound, fit.objective, rtol=1e-9)


@pytest.mark.parametrize("name", LOSS_NAMES)
@pytest.mark.parametrize("variant", ["free", "weights", "support"])
def test_clean_data_are_met_exactly(name, variant):
    design, truth, _ = problem(5)
    keywords = variants()[variant]
    truth = np.where(keywords.get("support", True), truth, 0.0)
    fit = get_loss(name).fit(design, design @ truth.T, **keywords)
    np.testing.assert_allclose(fit.coef, truth, rtol=0, atol=1e-13)
    assert fit.objective <= 1e-11
    assert fit.status is Status.OPTIMAL


@pytest.mark.parametrize("name", LOSS_NAMES)
def test_weights_are_repetitions(name):
    design, _, targets = problem(6)
    weight = np.random.default_rng(7).integers(0, 4, len(design))
    weighted = get_loss(name).fit(design, targets, sample_weight=weight.astype(float))
    repeated = get_loss(name).fit(
        np.repeat(design, weight, axis=0), np.repeat(targets, weight, axis=0)
    )
    np.testing.assert_allclose(weighted.objective, repeated.objective, rtol=1e-9)
    np.testing.assert_allclose(weighted.coef, repeated.coef, rtol=0, atol=1e-4)


@pytest.mark.parametrize("name", LOSS_NAMES)
def test_dependent_features_take_the_coefficients_of_least_norm(name):
    design, _, targets = problem(8)
    doubled = np.column_stack([design, design[:, :2], np.zeros(len(design))])
    single = get_loss(name).fit(design, targets)
    fit = get_loss(name).fit(doubled, targets)
    np.testing.assert_allclose(fit.objective, single.objective, rtol=1e-10)
    np.testing.assert_allclose(fit.coef[:, :2], fit.coef[:, 5:7], atol=1e-12)
    np.testing.assert_allclose(fit.coef[:, :2] * 2, single.coef[:, :2], atol=1e-5)
    assert (fit.coef[:, 7] == 0).all()


@pytest.mark.parametrize("name", LOSS_NAMES)
@pytest.mark.parametrize("n_samples", [0, 2])
def test_too_few_rows(name, n_samples):
    design, _, targets = problem(9)
    fit = get_loss(name).fit(design[:n_samples], targets[:n_samples])
    least = np.linalg.pinv(design[:n_samples]) @ targets[:n_samples]
    np.testing.assert_allclose(fit.coef, least.T, atol=1e-12)
    assert fit.objective <= 1e-12
    assert fit.status is Status.OPTIMAL


@pytest.mark.parametrize("name", LOSS_NAMES)
def test_an_output_without_features_costs_its_targets(name):
    design, _, targets = problem(10)
    support = np.array([[True] * 5, [False] * 5])
    fit = get_loss(name).fit(design, targets, support=support)
    assert (fit.coef[1] == 0).all()
    assert fit.status is Status.OPTIMAL
    assert fit.objective - fit.lower_bound <= 1e-8 * fit.objective
    if get_loss(name).separable:
        alone = get_loss(name).fit(design, targets[:, :1]).objective
        rest = get_loss(name).values(targets[:, 1:]).sum()
        assert fit.objective == pytest.approx(alone + rest, rel=1e-12)


def test_l2_is_invariant_to_rotations_of_the_outputs():
    design, _, targets = problem(11)
    angle = 0.7
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    plain = get_loss("l2").fit(design, targets)
    turned = get_loss("l2").fit(design, targets @ rotation.T)
    np.testing.assert_allclose(turned.objective, plain.objective, rtol=1e-10)
    np.testing.assert_allclose(turned.coef, rotation @ plain.coef, atol=1e-5)


def test_losses_agree_in_one_dimension():
    design, _, targets = problem(12, n_outputs=1)
    absolute = get_loss("l1").fit(design, targets)
    euclidean = get_loss("l2").fit(design, targets)
    np.testing.assert_allclose(euclidean.objective, absolute.objective, rtol=1e-9)


def test_a_coupled_support_matches_the_separable_case_for_one_free_output():
    # With the first output fixed at zero coefficients and zero targets, l2 is l1 of the second.
    design, _, targets = problem(13)
    targets[:, 0] = 0.0
    support = np.array([[False] * 5, [True, True, False, True, True]])
    euclidean = get_loss("l2").fit(design, targets, support=support)
    absolute = get_loss("l1").fit(design, targets, support=support)
    np.testing.assert_allclose(euclidean.objective, absolute.objective, rtol=1e-9)


@pytest.mark.parametrize("name", LOSS_NAMES)
def test_subgradients_support_the_loss_from_below(name):
    loss = get_loss(name)
    rng = np.random.default_rng(14)
    residuals = rng.normal(size=(50, 3))
    residuals[:5] = 0.0
    slopes = loss.subgradient(residuals)
    others = rng.normal(size=(200, 1, 3))
    below = loss.values(residuals) + ((others - residuals) * slopes).sum(axis=-1)
    assert (loss.values(others) >= below - 1e-12).all()


@pytest.mark.parametrize("name", LOSS_NAMES)
def test_dual_norms(name):
    loss = get_loss(name)
    rng = np.random.default_rng(15)
    vectors, others = rng.normal(size=(50, 3)), rng.normal(size=(400, 1, 3))
    norms = np.sqrt(loss.values(others)) if name == "squared" else loss.values(others)
    ratios = (vectors * others).sum(axis=-1) / norms
    assert (ratios <= loss.dual_norm(vectors) + 1e-12).all()
    # ... and some vector of unit norm attains it.
    attained = {"l1": np.eye(3)[np.abs(vectors).argmax(axis=1)] * np.sign(vectors)}.get(
        name, vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    )
    np.testing.assert_allclose((vectors * attained).sum(axis=1), loss.dual_norm(vectors))


@pytest.mark.parametrize("name", LOSS_NAMES)
def test_a_penalty_is_one_more_coordinate(name):
    loss = get_loss(name)
    rng = np.random.default_rng(16)
    residuals, penalty = rng.normal(size=(4, 60, 3)), rng.exponential(size=(4, 60))
    penalty[0], residuals[1] = 0.0, 0.0
    values = loss.values(residuals)
    extra = loss.extra_coordinate(values, penalty)
    assert (extra >= 0).all()
    extended = np.concatenate([residuals, extra[..., None]], axis=-1)
    np.testing.assert_allclose(loss.values(extended), values + penalty, rtol=1e-13)


def test_an_unknown_loss_is_refused_in_words():
    with pytest.raises(ValueError, match="loss='l3' is unknown; choose 'l1', 'l2' or 'squared'"):
        get_loss("l3")


@pytest.mark.parametrize("name", LOSS_NAMES)
def test_a_solver_that_is_not_installed_is_refused_in_words(name):
    design, _, targets = problem(17)
    with pytest.raises(SolverError, match="solver='nosuch' is not installed"):
        get_loss(name).fit(design, targets, solver="nosuch")


def test_a_solver_that_cannot_pose_the_program_is_refused_in_words():
    # OSQP knows quadratic programs but no second-order cones.
    design, _, targets = problem(18)
    with pytest.raises(SolverError, match="found no solution of the l2 dynamics program"):
        get_loss("l2").fit(design, targets, solver="osqp")
