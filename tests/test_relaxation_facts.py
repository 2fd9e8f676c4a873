"""What the moment relaxations are worth, against real semidefinite programs.

Order 1 has the value of the simplex relaxation, order 2 that of the best hard assignment, and
one-hot minimisers of the simplex relaxation are no matter of course.
"""

import cvxpy as cp
import numpy as np
import pytest

from swsysid._losses import get_loss
from swsysid.relaxations import MomentRelaxation, SimplexRelaxation

LOSSES = ["l1", "l2", "squared"]
# Interior-point accuracy, for sums over at most 30 samples of order one.
SDP = 2e-6


def draw(n_modes, n_samples, n_states, noise, seed):
    rng = np.random.default_rng(seed)
    candidates = rng.normal(size=(n_modes, n_samples, n_states))
    modes = rng.integers(n_modes, size=n_samples)
    targets = candidates[modes, np.arange(n_samples)]
    return candidates, targets + noise * rng.normal(size=targets.shape)


def with_loss(relaxation, loss):
    relaxation.loss = loss
    return relaxation


def simplex_values(candidates, targets, loss):
    relaxation = with_loss(SimplexRelaxation(), loss)
    membership = relaxation.assign(candidates, targets).membership
    return relaxation.soft_losses(membership, candidates, targets), membership


def hard_values(candidates, targets, loss):
    return get_loss(loss).values(targets - candidates).min(axis=0)


class Recorded(MomentRelaxation):
    """Keeps the semidefinite program's own value, before it is compared with anything."""

    def hardened(self, candidates, targets, membership, lower_bound, *rest):
        self.value_ = lower_bound
        return super().hardened(candidates, targets, membership, lower_bound, *rest)


def shor(velocities, target, loss):
    """The paper's mode assignment SDP for one sample, written down as it stands there."""
    n_modes = len(velocities)
    matrix = cp.Variable((n_modes + 1, n_modes + 1), PSD=True)
    membership = matrix[0, 1:]
    residual = target - velocities.T @ membership
    cost = {"l1": cp.norm1, "l2": cp.norm2, "squared": cp.sum_squares}[loss](residual)
    constraints = [
        matrix[0, 0] == 1,
        cp.diag(matrix)[1:] == membership,
        cp.sum(membership) == 1,
    ]
    return cp.Problem(cp.Minimize(cost), constraints).solve(solver="CLARABEL")


# --- fact 1: order 1 is the simplex --------------------------------------------------------------


@pytest.mark.parametrize("noise", [0.0, 0.5])
@pytest.mark.parametrize("n_modes", [2, 3])
@pytest.mark.parametrize("loss", LOSSES)
def test_order_one_has_the_value_of_the_simplex(loss, n_modes, noise):
    candidates, targets = draw(n_modes, 12, 2, noise, seed=n_modes)
    simplex, _ = simplex_values(candidates, targets, loss)
    program = [shor(candidates[:, i], targets[i], loss) for i in range(len(targets))]
    np.testing.assert_allclose(program, simplex, atol=SDP)
    recorded = with_loss(Recorded(order=1), loss)
    recorded.assign(candidates, targets)
    assert recorded.value_ == pytest.approx(simplex.sum(), abs=SDP)


@pytest.mark.parametrize("n_modes", [2, 3, 5])
def test_every_simplex_point_extends_to_a_moment_matrix(n_modes):
    # the proof: Lambda = diag(lambda) is feasible, as diag(lambda) - lambda lambda^T >= 0
    for membership in np.random.default_rng(0).dirichlet(np.ones(n_modes), size=20):
        matrix = np.block(
            [[np.ones((1, 1)), membership[None]], [membership[:, None], np.diag(membership)]]
        )
        assert np.linalg.eigvalsh(matrix).min() >= -1e-14


@pytest.mark.parametrize("loss", LOSSES)
def test_rank_one_if_and_only_if_one_hot(loss):
    candidates, targets = draw(3, 120, 2, 0.5, seed=8)
    moment = with_loss(MomentRelaxation(order=1), loss).assign(candidates, targets)
    largest = moment.membership.max(axis=1)
    # in between lies what an interior-point solver cannot tell
    assert moment.tightness[largest >= 1 - 1e-8].all()
    assert not moment.tightness[largest <= 1 - 1e-5].any()
    assert 20 <= moment.tightness.sum() <= 100


def test_a_lifted_squared_loss_at_order_one_lies_strictly_between():
    # |xdot - V lambda|^2 written in the second moments is linear in Lambda
    candidates, targets = draw(3, 8, 2, 0.6, seed=3)
    lifted = []
    for i, target in enumerate(targets):
        velocities = candidates[:, i]
        matrix = cp.Variable((4, 4), PSD=True)
        second = cp.trace((velocities @ velocities.T) @ matrix[1:, 1:])
        cost = target @ target - 2 * (velocities @ target) @ matrix[0, 1:] + second
        constraints = [
            matrix[0, 0] == 1,
            cp.diag(matrix)[1:] == matrix[0, 1:],
            cp.sum(matrix[0, 1:]) == 1,
        ]
        lifted.append(cp.Problem(cp.Minimize(cost), constraints).solve(solver="CLARABEL"))
    simplex, _ = simplex_values(candidates, targets, "squared")
    hard = hard_values(candidates, targets, "squared")
    assert (np.array(lifted) >= simplex - SDP).all()
    assert (np.array(lifted) <= hard + SDP).all()
    assert simplex.sum() + 1e-2 < sum(lifted) < hard.sum() - 1e-2


# --- fact 2: order 2 is the argmin ---------------------------------------------------------------


@pytest.mark.parametrize(
    ("loss", "n_modes", "n_samples"),
    [("l1", 2, 25), ("l1", 3, 15), ("l2", 2, 15), ("l2", 3, 10), ("squared", 2, 20),
     ("squared", 3, 20)],
)  # fmt: skip
@pytest.mark.parametrize("noise", [0.0, 0.5])
def test_order_two_has_the_value_of_the_best_mode(loss, n_modes, n_samples, noise):
    candidates, targets = draw(n_modes, n_samples, 2, noise, seed=10 + n_modes)
    relaxation = with_loss(Recorded(order=2), loss)
    assignment = relaxation.assign(candidates, targets)
    hard = hard_values(candidates, targets, loss)
    # the program's own value, from both sides
    assert relaxation.value_ == pytest.approx(hard.sum(), abs=SDP)
    # and its moments are those of the Dirac measure on the best mode
    assert assignment.tightness.all()
    best = get_loss(loss).values(targets - candidates).argmin(axis=0)
    np.testing.assert_array_equal(assignment.modes, best)
    np.testing.assert_allclose(assignment.membership.max(axis=1), 1.0, atol=1e-5)


def test_order_two_in_three_states_and_order_three():
    candidates, targets = draw(2, 6, 3, 0.5, seed=0)
    assert solved_value(2, candidates, targets) == pytest.approx(
        hard_values(candidates, targets, "l1").sum(), abs=SDP
    )
    candidates, targets = draw(2, 3, 1, 0.5, seed=0)
    assert solved_value(3, candidates, targets) == pytest.approx(
        hard_values(candidates, targets, "l1").sum(), abs=SDP
    )


def solved_value(order, candidates, targets):
    relaxation = Recorded(order=order)
    relaxation.assign(candidates, targets)
    return relaxation.value_


@pytest.mark.parametrize("loss", LOSSES)
def test_the_hierarchy_is_strict_where_the_target_lies_between(loss):
    # midway between two candidates at distance 2: order 1 fits exactly, order 2 pays 1
    candidates = np.array([[[-1.0, 0.0]], [[1.0, 0.0]]])
    values = []
    for order in (1, 2):
        relaxation = with_loss(Recorded(order=order), loss)
        relaxation.assign(candidates, np.zeros((1, 2)))
        values.append(relaxation.value_)
    np.testing.assert_allclose(values, [0.0, 1.0], atol=1e-5)


# --- one-hot minimisers are not almost sure ------------------------------------------------------


@pytest.mark.parametrize("loss", LOSSES)
def test_a_target_inside_the_hull_of_three_modes_is_never_one_hot(loss):
    # The paper's theorem calls minimisers one-hot almost surely. The targets below have a
    # density, the losses of the modes all differ, and yet no minimiser is one-hot.
    rng = np.random.default_rng(0)
    candidates = rng.normal(size=(3, 200, 2))
    weights = rng.dirichlet(np.ones(3), size=200)
    targets = np.einsum("im,mik->ik", weights, candidates)
    assignment = with_loss(SimplexRelaxation(), loss).assign(candidates, targets)
    assert assignment.lower_bound == pytest.approx(0.0, abs=1e-9)
    assert not assignment.tightness.any()
    # in a triangle the weights are unique, whatever the loss
    areas = np.abs(np.cross(*_pad(candidates[1:] - candidates[0])))[:, 2]
    sound = areas > 1e-2
    np.testing.assert_allclose(assignment.membership[sound], weights[sound], atol=1e-7)
    losses = np.sort(get_loss(loss).values(targets - candidates), axis=0)
    assert (losses[1] > losses[0]).all()
    assert assignment.objective > 10.0


def _pad(vectors):
    """The same vectors in space, where they have a cross product."""
    return np.concatenate([vectors, np.zeros((*vectors.shape[:2], 1))], axis=2)


def test_ties_of_the_l1_loss_have_positive_measure():
    # candidates that differ equally in two coordinates tie on a whole quadrant of targets
    candidates = np.broadcast_to(np.array([[[0.0, 1.0]], [[1.0, 0.0]]]), (2, 50, 2))
    targets = 1.0 + np.random.default_rng(0).uniform(size=(50, 2))
    losses = get_loss("l1").values(targets - candidates)
    np.testing.assert_allclose(losses[0], losses[1], atol=1e-12)
