"""What the moment relaxations are worth, against real semidefinite programs.

Order 1 has the value of the simplex relaxation, order 2 that of the best hard assignment, and
one-hot minimisers of the simplex relaxation are no matter of course.
"""

import cvxpy as cp
import numpy as np
import pytest

from swsysid._losses import get_loss
from swsysid.relaxations import MomentRelaxation, SimplexRelaxation
from swsysid.relaxations._moment import _Moments

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


class LiftedSquares:
    """|xdot - V lambda|^2 written in the second moments, where it is linear: one small SDP."""

    def __init__(self, n_modes):
        self.matrix = matrix = cp.Variable((n_modes + 1, n_modes + 1), PSD=True)
        self.linear, self.gram = cp.Parameter(n_modes), cp.Parameter((n_modes, n_modes))
        membership = matrix[0, 1:]
        cost = cp.sum(cp.multiply(self.gram, matrix[1:, 1:])) - 2 * self.linear @ membership
        constraints = [
            matrix[0, 0] == 1,
            cp.diag(matrix)[1:] == membership,
            cp.sum(membership) == 1,
        ]
        self.problem = cp.Problem(cp.Minimize(cost), constraints)

    def value(self, velocities, target):
        self.linear.value, self.gram.value = velocities @ target, velocities @ velocities.T
        return target @ target + self.problem.solve(solver="CLARABEL")


def test_a_lifted_squared_loss_at_order_one_may_lie_strictly_between():
    candidates, targets = draw(3, 8, 2, 0.6, seed=3)
    program = LiftedSquares(3)
    lifted = np.array([program.value(candidates[:, i], x) for i, x in enumerate(targets)])
    simplex, _ = simplex_values(candidates, targets, "squared")
    hard = hard_values(candidates, targets, "squared")
    assert (lifted >= simplex - SDP).all()
    assert (lifted <= hard + SDP).all()
    assert simplex.sum() + 1e-2 < lifted.sum() < hard.sum() - 1e-2


def test_when_the_lifted_squared_loss_of_two_modes_is_exact():
    # least over t of t a + (1 - t) b - 4 max(0, -v_0.v_1) t (1 - t): at an end exactly if the
    # losses a and b differ by at least 4 max(0, -v_0.v_1)
    rng = np.random.default_rng(0)
    candidates, targets = rng.normal(size=(2, 200, 2)), rng.normal(size=(200, 2))
    losses = np.square(targets - candidates).sum(axis=2)
    bend = 4.0 * np.maximum(0.0, -(candidates[0] * candidates[1]).sum(axis=1))
    spread = np.abs(losses[0] - losses[1])
    inside = np.square(bend - spread) / (4.0 * np.where(bend > 0.0, bend, 1.0))
    expected = losses.min(axis=0) - np.where(spread < bend, inside, 0.0)
    program = LiftedSquares(2)
    lifted = [program.value(candidates[:, i], x) for i, x in enumerate(targets)]
    np.testing.assert_allclose(lifted, expected, atol=20 * SDP)
    exact = np.abs(lifted - losses.min(axis=0)) < 20 * SDP
    np.testing.assert_array_equal(exact, spread >= bend)
    assert exact.sum() == 161
    # the lift is no worse than the simplex, and the inner product alone is enough
    simplex, _ = simplex_values(candidates, targets, "squared")
    assert (lifted >= simplex - 20 * SDP).all()
    assert exact[bend == 0.0].all()


def test_inner_products_are_not_enough_for_three_modes():
    # none is negative, and yet Lambda may be negative where they are positive
    velocities = np.array([[2.0, 0.0], [2.0, 1.0], [0.0, 1.0]])
    target = np.array([1.0, 1.0])
    assert (velocities @ velocities.T >= 0.0).all()
    value = LiftedSquares(3).value(velocities, target)
    assert value < np.square(target - velocities).sum(axis=1).min() - 0.9


# --- flat extension: rank one ---------------------------------------------------------------------


def test_a_rank_one_moment_matrix_is_that_of_a_vertex():
    # order 2, all moments of lambda up to degree four from the reduced monomials: rank one, its
    # first column the vector of monomials at a vertex
    candidates, targets = draw(3, 6, 2, 0.3, seed=5)
    assignment = with_loss(MomentRelaxation(order=2), "l1").assign(candidates, targets)
    assert assignment.tightness.all()
    np.testing.assert_allclose(np.sort(assignment.membership)[:, :-1], 0.0, atol=1e-5)
    np.testing.assert_allclose(assignment.membership.max(axis=1), 1.0, atol=1e-5)


def test_tight_and_yet_not_of_rank_one():
    # Two modes that tie on the whole segment between them: the relaxation is exact, and the
    # solver returns the middle of the optimal face, whose moment matrix has rank two. The rank
    # of a returned matrix proves tightness; it does not disprove it.
    candidates = np.array([[[0.0, 1.0]], [[1.0, 0.0]]])
    assignment = MomentRelaxation(order=1).assign(candidates, np.array([[1.5, 1.5]]))
    assert assignment.gap == pytest.approx(0.0, abs=SDP)
    assert not assignment.tightness.any()
    np.testing.assert_allclose(assignment.membership, 0.5, atol=1e-3)


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


@pytest.mark.parametrize("limit", [1.25, 5.0])
def test_a_scalar_lift_of_the_euclidean_cone_is_not_exact(limit):
    # midway between two candidates at distance 2 the best mode pays 1; with delta^2 >= |c|^2 in
    # place of the cone, order 2 pays one over the bound of delta
    displacements = np.array([[-1.0, 0.0], [1.0, 0.0]])
    moments, slack = _Moments(2, 1, 2), (2,)
    basis, multipliers = moments.monomials(1), moments.monomials(3)
    squares = sum(
        displacements[i] @ displacements[j] * moments.matrix(basis, (i, j))
        for i in (0, 1)
        for j in (0, 1)
    )
    constraints = [
        moments.vector([()]) == 1,
        sum(moments.vector([m + (j,) for m in multipliers]) for j in (0, 1))
        == moments.vector(multipliers),
        moments.matrix(moments.monomials(2)) >> 0,
        moments.matrix(basis, slack) >> 0,
        limit * moments.matrix(basis) - moments.matrix(basis, slack) >> 0,
        moments.matrix(basis, slack + slack) - squares >> 0,
    ]
    problem = cp.Problem(cp.Minimize(moments.vector([slack])[0]), constraints)
    assert problem.solve(solver="CLARABEL") == pytest.approx(1.0 / limit, abs=1e-4)


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


def test_ties_of_the_euclidean_loss_lie_on_a_plane():
    # |x - v_0| = |x - v_1| on the bisecting plane only: there the paper's first half holds
    rng = np.random.default_rng(0)
    candidates = rng.normal(size=(2, 2000, 2))
    targets = rng.normal(size=(2000, 2))
    losses = get_loss("l2").values(targets - candidates)
    middle, normal = candidates.mean(axis=0), candidates[1] - candidates[0]
    height = ((targets - middle) * normal).sum(axis=1)
    np.testing.assert_array_equal(np.sign(height), np.sign(losses[0] - losses[1]))
    assert (losses[0] != losses[1]).all()


@pytest.mark.parametrize("size", [1e-1, 1e-4])
@pytest.mark.parametrize("loss", ["l1", "l2"])
def test_half_of_noisy_samples_of_two_modes_have_fractional_minimisers(loss, size):
    rng = np.random.default_rng(0)
    n_samples = 4000
    candidates = np.broadcast_to(np.array([[[0.0, 0.0]], [[2.0, 1.0]]]), (2, n_samples, 2))
    targets = size * rng.normal(size=(n_samples, 2))
    assignment = with_loss(SimplexRelaxation(), loss).assign(candidates, targets)
    # the standard deviation of such a share is 0.008
    assert 1.0 - assignment.tightness.mean() == pytest.approx(0.5, abs=0.03)
    assert (assignment.membership.argmax(axis=1) == 0).all()
