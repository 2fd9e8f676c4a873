"""Certificates of a fit: each must be true, and the exact dual search must miss none."""

import numpy as np
import pytest

from swsysid._losses import get_loss
from swsysid._results import SolverError, Status
from swsysid.relaxations import SimplexRelaxation
from swsysid.relaxations._certificates import certify

LOSSES = ["l1", "l2", "squared"]


def draw(n_modes, n_samples, n_states, noise, seed):
    """Features, targets and true coefficients of a switching linear system."""
    rng = np.random.default_rng(seed)
    features = rng.normal(size=(n_samples, n_states))
    coef = rng.normal(size=(n_modes, n_states, n_states))
    modes = rng.integers(n_modes, size=n_samples)
    targets = np.einsum("ikp,ip->ik", coef[modes], features)
    return features, targets + noise * rng.normal(size=targets.shape), coef


def certify_velocities(velocities, targets, loss):
    """Certificate for given velocities (n_modes, n_samples, n_states) of every mode.

    A feature for each sample lets the coefficients be the velocities themselves.
    """
    velocities, targets = np.asarray(velocities, dtype=float), np.asarray(targets, dtype=float)
    return certify(np.eye(len(targets)), targets, velocities.transpose(0, 2, 1), loss)


def losses_at(membership, velocities, targets, loss):
    mixed = np.einsum("...m,mk->...k", membership, velocities)
    return get_loss(loss).values(targets - mixed)


@pytest.mark.parametrize(
    ("target", "certified"),
    [
        # one rival at (1, 1); l1: w = sign of the residual, and either sign where it is zero
        ((0.0, 0.0), True),
        ((-1.0, 3.0), False),  # both modes pay 4: no w prefers one
        ((-1.0, 0.0), True),
        ((0.5, 0.0), False),  # w = (1, w2) with w2 = -1 gives exactly 0: not strict
        ((-0.1, 0.3), False),  # best by far, but part of the way to the rival costs nothing
    ],
)
def test_dual_certificates_of_the_l1_loss_by_hand(target, certified):
    # advantage of mode 0 over mode 1 is (-1, -1)
    certificate = certify_velocities([[[0.0, 0.0]], [[1.0, 1.0]]], [target], "l1")
    assert certificate.dual_certified.tolist() == [certified]


@pytest.mark.parametrize("noise", [0.0, 0.1])
@pytest.mark.parametrize("shape", [(2, 150, 2), (3, 150, 2), (4, 100, 3)])
@pytest.mark.parametrize("loss", LOSSES)
def test_a_dual_certificate_means_a_unique_minimiser(loss, shape, noise):
    features, targets, coef = draw(*shape, noise, seed=0)
    certificate = certify(features, targets, coef, loss)
    candidates = features @ coef.transpose(0, 2, 1)
    best = get_loss(loss).values(targets - candidates).argmin(axis=0)
    rng = np.random.default_rng(1)
    assert certificate.dual_certified.any()
    for sample in np.flatnonzero(certificate.dual_certified):
        velocities, target = candidates[:, sample], targets[sample]
        vertex = np.eye(shape[0])[best[sample]]
        # from the vertex towards 200 points of the simplex, near and far
        towards = rng.dirichlet(np.full(shape[0], 0.5), size=200)
        steps = 10.0 ** rng.uniform(-4, 0, size=(200, 1))
        around = vertex + steps * (towards - vertex)
        moved = np.abs(around - vertex).max(axis=1) > 1e-5
        least = losses_at(vertex, velocities, target, loss)
        assert (losses_at(around[moved], velocities, target, loss) > least).all()


@pytest.mark.parametrize("best", [0, 2])
def test_the_dual_search_misses_none(best):
    # Zero residual in the plane: w exists exactly if the advantages lie in an open half-plane,
    # that is if some gap between their directions exceeds half a turn.
    rng = np.random.default_rng(2)
    velocities = rng.normal(size=(4, 300, 2))
    advantages = velocities[best] - np.delete(velocities, best, axis=0)
    angles = np.sort(np.arctan2(advantages[..., 1], advantages[..., 0]), axis=0)
    gaps = np.diff(angles, axis=0, append=angles[:1] + 2 * np.pi)
    expected = gaps.max(axis=0) > np.pi
    assert 50 < expected.sum() < 290
    for loss in LOSSES:
        certificate = certify_velocities(velocities, velocities[best], loss)
        np.testing.assert_array_equal(certificate.dual_certified, expected)


def test_free_coordinates_need_the_exact_search():
    # target = v_0; advantages (3, -1) and (-1, 3) of mode 0: w = (1, 1) serves both, while
    # neither sign vector of one advantage does
    velocities = [[[0.0, 0.0]], [[-3.0, 1.0]], [[1.0, -3.0]]]
    for loss in LOSSES:
        assert certify_velocities(velocities, [[0.0, 0.0]], loss).dual_certified.all()
    # a mode midway between two others can be written as their mixture
    velocities = [[[0.0, 0.0]], [[-3.0, 1.0]], [[3.0, -1.0]]]
    for loss in LOSSES:
        assert not certify_velocities(velocities, [[0.0, 0.0]], loss).dual_certified.any()


@pytest.mark.parametrize("loss", LOSSES)
def test_equal_modes_are_never_certified_and_one_mode_always(loss):
    velocities = np.ones((2, 3, 2))
    targets = np.arange(6.0).reshape(3, 2)
    assert not certify_velocities(velocities, targets, loss).dual_certified.any()
    assert certify_velocities(velocities[:1], targets, loss).dual_certified.all()


@pytest.mark.parametrize("shape", [(2, 200, 2), (3, 200, 2), (5, 150, 3)])
@pytest.mark.parametrize("loss", LOSSES)
def test_gap_and_rounding_bound_are_true(loss, shape):
    features, targets, coef = draw(*shape, 0.3, seed=3)
    certificate = certify(features, targets, coef, loss)
    candidates = features @ coef.transpose(0, 2, 1)
    hard = get_loss(loss).values(targets - candidates).min(axis=0)
    assert certificate.objective == pytest.approx(hard.sum(), rel=1e-12)
    assert certificate.gap == pytest.approx(certificate.objective - certificate.lower_bound)
    assert certificate.gap > 0.0
    # hardening costs at most the bound, so that the best mode costs at most that much more
    assert certificate.gap <= certificate.rounding_bound.sum() + 1e-9
    # what is tight needs no rounding
    assert (certificate.rounding_bound >= 0.0).all()
    assert certificate.tightness == np.mean(certificate.rounding_bound < 1e-5)
    # uniqueness of the vertex implies that the relaxation returned it
    assert (certificate.rounding_bound[certificate.dual_certified] < 1e-9).all()


@pytest.mark.parametrize(("loss", "bound"), [("l1", 0.5), ("l2", 0.5), ("squared", 0.25)])
def test_rounding_bound_by_hand(loss, bound):
    # target 1/4 between 0 and 1: lambda = (3/4, 1/4) fits exactly; rounding to 0 moves the
    # velocity by 1/4 in the norm and the bound says sum of lambda_j |v_j - v_0| = 1/4
    certificate = certify_velocities([[[0.0, 0.0]], [[2.0, 0.0]]], [[0.5, 0.0]], loss)
    np.testing.assert_allclose(certificate.rounding_bound, [bound], atol=1e-12)
    assert certificate.gap == pytest.approx(bound, abs=1e-12)


@pytest.mark.parametrize("loss", LOSSES)
def test_the_rounding_bound_is_the_one_of_the_page(loss):
    # d = sum_m lambda_m |v_m - v_j|, and 2 |c| d + d^2 for the squared norm
    features, targets, coef = draw(3, 60, 2, 0.5, seed=7)
    candidates = features @ coef.transpose(0, 2, 1)
    relaxation = SimplexRelaxation()
    relaxation.loss = loss
    membership = relaxation.assign(candidates, targets).membership
    norm = np.abs if loss == "l1" else np.square
    root = (lambda sums: sums) if loss == "l1" else np.sqrt
    expected = []
    for sample, weights in enumerate(membership):
        velocities = candidates[:, sample]
        chosen = velocities[weights.argmax()]
        d = weights @ root(norm(velocities - chosen).sum(axis=1))
        c = np.linalg.norm(targets[sample] - weights @ velocities)
        expected.append(2.0 * c * d + d**2 if loss == "squared" else d)
    assert np.max(expected) > 0.1
    certificate = certify(features, targets, coef, loss)
    np.testing.assert_allclose(certificate.rounding_bound, expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("loss", LOSSES)
def test_the_dynamics_gap_is_zero_at_the_optimum_only(loss):
    features, targets, coef = draw(2, 60, 2, 0.05, seed=4)
    labels = get_loss(loss).values(targets - features @ coef.transpose(0, 2, 1)).argmin(axis=0)
    fitted = np.stack(
        [get_loss(loss).fit(features[labels == j], targets[labels == j]).coef for j in range(2)]
    )
    certificate = certify(features, targets, fitted, loss, labels=labels)
    scale = certificate.objective
    assert 0.0 <= certificate.dynamics_gap <= 1e-5 * scale
    assert certificate.status is Status.OPTIMAL
    worse = certify(features, targets, fitted + 0.05, loss, labels=labels)
    spent = sum(
        get_loss(loss).values(targets[labels == j] - features[labels == j] @ c.T).sum()
        for j, c in enumerate(fitted + 0.05)
    )
    best = sum(
        get_loss(loss).values(targets[labels == j] - features[labels == j] @ c.T).sum()
        for j, c in enumerate(fitted)
    )
    assert worse.dynamics_gap == pytest.approx(spent - best, abs=1e-5 * scale)
    assert worse.dynamics_gap > 1e-2 * scale


@pytest.mark.parametrize("loss", LOSSES)
def test_weights_mean_repetition(loss):
    features, targets, coef = draw(3, 30, 2, 0.2, seed=5)
    weights = np.random.default_rng(0).integers(0, 4, size=30)
    weighted = certify(features, targets, coef, loss, sample_weight=weights.astype(float))
    repeated = certify(
        np.repeat(features, weights, axis=0), np.repeat(targets, weights, axis=0), coef, loss
    )
    for name in ("objective", "lower_bound", "gap", "dynamics_gap"):
        first, second = getattr(weighted, name), getattr(repeated, name)
        assert first == pytest.approx(second, abs=1e-5 * weighted.objective)


@pytest.mark.parametrize("loss", LOSSES)
def test_equivariance_to_units_and_relabelling(loss):
    features, targets, coef = draw(3, 80, 2, 0.1, seed=6)
    reference = certify(features, targets, coef, loss)
    unit = 1e-4
    scaled = certify(features, unit * targets, unit * coef, loss)
    factor = unit**2 if loss == "squared" else unit
    assert scaled.gap == pytest.approx(factor * reference.gap, rel=1e-6)
    np.testing.assert_array_equal(scaled.dual_certified, reference.dual_certified)
    relabelled = certify(features, targets, coef[[1, 2, 0]], loss)
    assert relabelled.gap == pytest.approx(reference.gap, rel=1e-6)
    np.testing.assert_array_equal(relabelled.dual_certified, reference.dual_certified)


def test_bad_input_gets_a_sentence():
    features, targets, coef = draw(2, 10, 2, 0.1, seed=7)
    with pytest.raises(ValueError, match="loss='l3' is unknown"):
        certify(features, targets, coef, "l3")
    with pytest.raises(ValueError, match="NaN or infinity"):
        certify(features, np.full_like(targets, np.nan), coef, "l1")
    with pytest.raises(SolverError, match="installed solvers are"):
        certify(features, targets, coef, "l1", solver="nosuch")
