"""The contract of every relaxation, and the fast simplex paths against certificates and cvxpy."""

import cvxpy as cp
import numpy as np
import pytest
from sklearn.base import clone

from swsysid._losses import get_loss
from swsysid._results import Assignment, SolverError, Status
from swsysid.relaxations import (
    RELAXATIONS,
    ExactRelaxation,
    MomentRelaxation,
    Relaxation,
    SimplexRelaxation,
    get_relaxation,
)
from swsysid.relaxations._hulls import HullSettings

LOSSES = ["l1", "l2", "squared"]
# How a loss grows when velocities are multiplied by a number.
DEGREE = {"l1": 1, "l2": 1, "squared": 2}


def problem(n_modes, n_samples, n_states, noise, seed=0):
    """Random candidates, and targets near one of them: candidates, targets, true modes."""
    rng = np.random.default_rng(seed)
    candidates = rng.normal(size=(n_modes, n_samples, n_states))
    modes = rng.integers(n_modes, size=n_samples)
    targets = candidates[modes, np.arange(n_samples)]
    return candidates, targets + noise * rng.normal(size=targets.shape), modes


PROBLEMS = {
    "two modes, clean": problem(2, 12, 2, 0.0),
    "two modes, noisy": problem(2, 12, 2, 0.4),
    "three modes, noisy": problem(3, 10, 2, 0.4),
    "four modes in space": problem(4, 8, 3, 0.4),
    "one mode": problem(1, 5, 2, 0.4),
    "one state": problem(3, 8, 1, 0.4),
}


def prepared(relaxation, loss="l1", solver="auto"):
    relaxation = get_relaxation(relaxation)
    relaxation.loss, relaxation.solver = loss, solver
    return relaxation


def close(first, second, loss, scale=1.0, tolerance=1e-6):
    """Bounds agree to the accuracy of a conic solver."""
    return first == pytest.approx(second, abs=tolerance * scale ** DEGREE[loss])


# --- the contract, for every relaxation --------------------------------------------------------


@pytest.mark.parametrize("data", PROBLEMS.values(), ids=PROBLEMS)
@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("name", RELAXATIONS)
def test_every_relaxation_bounds_the_best_modes(name, loss, data):
    candidates, targets, _ = data
    assignment = prepared(name, loss).assign(candidates, targets)
    losses = get_loss(loss).values(targets - candidates).T
    rows = np.arange(len(targets))
    assert assignment.status is Status.OPTIMAL
    assert assignment.membership.shape == losses.shape
    np.testing.assert_allclose(assignment.membership.sum(axis=1), 1.0, atol=1e-12)
    assert (assignment.membership >= 0).all()
    assert assignment.objective == pytest.approx(losses[rows, assignment.modes].sum(), abs=1e-12)
    # bound <= best hard assignment <= hardened assignment
    assert assignment.lower_bound <= losses.min(axis=1).sum() + 1e-9
    assert assignment.objective >= losses.min(axis=1).sum() - 1e-12
    # where the relaxation is tight its hard assignment is optimal
    tight = assignment.tightness
    np.testing.assert_allclose(
        losses[rows, assignment.modes][tight], losses.min(axis=1)[tight], atol=1e-6
    )


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("name", RELAXATIONS)
def test_modes_of_clean_data_are_found(name, loss):
    candidates, targets, modes = problem(3, 15, 3, 0.0, seed=4)
    assignment = prepared(name, loss).assign(candidates, targets)
    assert (assignment.modes == modes).all()
    assert assignment.tightness.all()
    assert assignment.objective == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("name", RELAXATIONS)
def test_equivariance_to_relabelling_rows_units_and_origin(name, loss):
    candidates, targets, _ = problem(3, 10, 2, 0.2, seed=2)
    relaxation = prepared(name, loss)
    reference = relaxation.assign(candidates, targets)

    relabelled = np.array([2, 0, 1])
    rows = np.random.default_rng(0).permutation(len(targets))
    scale, origin = 1e-5, np.array([3.0, -7.0])
    variants = [
        (candidates[relabelled], targets, reference.membership[:, relabelled], 1.0),
        (candidates[:, rows], targets[rows], reference.membership[rows], 1.0),
        (candidates * scale, targets * scale, reference.membership, scale),
        (candidates + origin, targets + origin, reference.membership, 1.0),
    ]
    for changed, changed_targets, membership, unit in variants:
        assignment = relaxation.assign(changed, changed_targets)
        assert close(
            assignment.lower_bound, reference.lower_bound * unit ** DEGREE[loss], loss, unit
        )
        # two interior-point runs agree on the minimiser to the root of their accuracy only
        np.testing.assert_allclose(assignment.membership, membership, atol=1e-3)


@pytest.mark.parametrize("name", RELAXATIONS)
@pytest.mark.parametrize("shapes", [((2, 5, 2), (5, 3)), ((2, 5, 2), (4, 2)), ((5, 2), (5, 2))])
def test_shapes_that_do_not_match_are_refused(name, shapes):
    with pytest.raises(ValueError, match="must be .n_modes, n_samples, n_states."):
        get_relaxation(name).assign(*(np.zeros(shape) for shape in shapes))


@pytest.mark.parametrize("name", RELAXATIONS)
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_nan_is_refused(name, bad):
    candidates, targets, _ = problem(2, 4, 2, 0.1)
    targets[1, 0] = bad
    with pytest.raises(ValueError, match="NaN or infinity"):
        get_relaxation(name).assign(candidates, targets)


@pytest.mark.parametrize("name", ["simplex", "moment"])
def test_a_missing_solver_is_a_sentence(name):
    candidates, targets, _ = problem(2, 4, 2, 0.1)
    with pytest.raises(SolverError, match="installed solvers are"):
        prepared(name, solver="nosuch").assign(candidates, targets)


@pytest.mark.parametrize(
    "relaxation", [SimplexRelaxation(), MomentRelaxation(1), MomentRelaxation(2)]
)
def test_a_failing_solver_is_an_error_with_advice(relaxation):
    # OSQP takes no second-order and no semidefinite cones
    candidates, targets, _ = problem(3, 6, 2, 0.1)
    with pytest.raises(SolverError, match="choose another solver"):
        prepared(relaxation, "l2", "osqp").assign(candidates, targets)


# --- naming and extending ----------------------------------------------------------------------


def test_names_and_instances_give_fresh_relaxations():
    for name, kind in RELAXATIONS.items():
        assert type(get_relaxation(name)) is kind
    given = MomentRelaxation(order=3)
    fresh = get_relaxation(given)
    assert fresh is not given
    assert fresh.order == 3
    fresh.loss = "l2"
    assert given.loss == Relaxation.loss == "l1"


def test_unknown_relaxations_are_refused_in_a_sentence():
    with pytest.raises(ValueError, match="'sdp' is unknown; choose one of simplex, moment, exact"):
        get_relaxation("sdp")
    for wrong in (3, object(), SimplexRelaxation):
        with pytest.raises(TypeError, match="neither a name nor an instance"):
            get_relaxation(wrong)


@pytest.mark.parametrize("order", [0, -1, 1.5, "2"])
def test_a_wrong_order_is_refused_in_a_sentence(order):
    candidates, targets, _ = problem(2, 4, 2, 0.1)
    with pytest.raises(ValueError, match="order=.* must be a positive integer"):
        MomentRelaxation(order).assign(candidates, targets)


class NearestRelaxation(Relaxation):
    """All that a user has to write."""

    def assign(self, candidates, targets):
        """Take the nearest candidate."""
        distances = np.linalg.norm(targets - candidates, axis=-1).T
        membership = np.eye(len(candidates))[distances.argmin(axis=1)]
        total = distances.min(axis=1).sum()
        tight = np.ones(len(targets), dtype=bool)
        return Assignment(membership, total, total, tight, Status.OPTIMAL)


def test_a_subclass_needs_assign_alone():
    candidates, targets, modes = problem(3, 20, 2, 0.0)
    relaxation = get_relaxation(NearestRelaxation())
    assert (relaxation.assign(candidates, targets).modes == modes).all()
    assert clone(relaxation).get_params() == {}
    with pytest.raises(TypeError, match="abstract"):
        Relaxation()


# --- the simplex: hand case, certificate, independent solver ------------------------------------


@pytest.mark.parametrize(
    ("loss", "position", "value"),
    # residual (1 - 2t, 2 - t) on the segment from (0, 0) to (2, 1), target (1, 2):
    # l1: weights 2 and 1 at t = 1/2 and t = 2, so t = 1/2 with |0| + |3/2|
    # euclidean: t = (2 + 2) / 5 = 4/5 with residual (-3/5, 6/5)
    [("l1", 0.5, 1.5), ("l2", 0.8, np.sqrt(1.8)), ("squared", 0.8, 1.8)],
)
def test_two_modes_by_hand(loss, position, value):
    candidates = np.array([[[0.0, 0.0]], [[2.0, 1.0]]])
    assignment = prepared("simplex", loss).assign(candidates, np.array([[1.0, 2.0]]))
    np.testing.assert_allclose(assignment.membership, [[1 - position, position]], atol=1e-12)
    assert assignment.lower_bound == pytest.approx(value, abs=1e-12)


def simplex_reference(candidates, targets, loss):
    """Value of the simplex relaxation from cvxpy, with a solver at its tightest."""
    n_modes, n_samples, n_states = candidates.shape
    membership = cp.Variable((n_samples, n_modes), nonneg=True)
    residuals = cp.vstack(
        [
            targets[:, k] - cp.sum(cp.multiply(candidates[:, :, k].T, membership), axis=1)
            for k in range(n_states)
        ]
    )
    cost = {
        "l1": cp.sum(cp.abs(residuals)),
        "l2": cp.sum(cp.norm(residuals, 2, axis=0)),
        "squared": cp.sum_squares(residuals),
    }[loss]
    program = cp.Problem(cp.Minimize(cost), [cp.sum(membership, axis=1) == 1])
    tight = {f"tol_{name}": 1e-11 for name in ("gap_abs", "gap_rel", "feas")}
    return program.solve(solver="CLARABEL", **tight)


SHAPES = [(2, 60, 1), (2, 60, 2), (2, 60, 4), (3, 60, 1), (3, 60, 2), (4, 40, 3), (5, 40, 2)]


@pytest.mark.parametrize("shape", [*SHAPES, (5, 30, 6)])
@pytest.mark.parametrize("loss", LOSSES)
def test_simplex_value_agrees_with_an_independent_solver(loss, shape):
    candidates, targets, _ = problem(*shape, 0.5, seed=1)
    value = prepared("simplex", loss).assign(candidates, targets).lower_bound
    assert value == pytest.approx(simplex_reference(candidates, targets, loss), rel=1e-8)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("loss", LOSSES)
def test_another_solver_gets_the_whole_program(loss, shape):
    candidates, targets, _ = problem(*shape, 0.5, seed=5)
    fast = prepared("simplex", loss).assign(candidates, targets)
    whole = prepared("simplex", loss, "clarabel").assign(candidates, targets)
    assert whole.lower_bound == pytest.approx(fast.lower_bound, rel=1e-6)
    # a fractional hull of more than n_states + 1 points has many minimisers; a face has one
    if shape[0] <= shape[2] + 1:
        np.testing.assert_allclose(whole.membership, fast.membership, atol=1e-3)


@pytest.mark.parametrize("shape", [*SHAPES, (6, 200, 5), (4, 1200, 2)])
def test_euclidean_memberships_carry_their_own_proof(shape):
    # The hyperplane through the point nearest to the target has all candidates behind it.
    candidates, targets, _ = problem(*shape, 0.5, seed=3)
    membership = prepared("simplex", "l2").assign(candidates, targets).membership
    nearest = np.einsum("im,mik->ik", membership, candidates)
    residuals = targets - nearest
    excess = np.einsum("ik,mik->im", residuals, candidates - nearest).max(axis=1)
    assert (excess <= 1e-9 * np.linalg.norm(residuals, axis=1) + 1e-14).all()


@pytest.mark.parametrize("loss", LOSSES)
def test_degenerate_hulls_are_solved(loss):
    # repeated candidates, candidates on a line, and candidates that are all the target
    rng = np.random.default_rng(0)
    line = np.linspace(-1, 1, 4)[:, None, None] * np.array([[[1.0, 2.0]]])
    line = np.repeat(line, 20, axis=1)
    repeated = line[[0, 0, 2, 2]]
    targets = rng.normal(size=(20, 2))
    for candidates in (line, repeated):
        value = prepared("simplex", loss).assign(candidates, targets).lower_bound
        assert value == pytest.approx(simplex_reference(candidates, targets, loss), rel=1e-8)
    same = np.repeat(targets[None], 4, axis=0)
    assert prepared("simplex", loss).assign(same, targets).objective == 0.0


def test_the_nearest_face_is_kept_where_rounding_hides_its_proof():
    candidates, targets, _ = problem(5, 60, 2, 0.5, seed=1)
    relaxation = prepared("simplex", "l2")
    relaxation.settings = HullSettings(accuracy=1e-30)
    value = relaxation.assign(candidates, targets).lower_bound
    assert value == pytest.approx(simplex_reference(candidates, targets, "l2"), rel=1e-8)


@pytest.mark.parametrize("loss", LOSSES)
def test_a_one_hot_minimiser_is_preferred(loss):
    # both candidates miss the target by the same vector: every membership is optimal
    candidates = np.ones((2, 3, 2))
    assignment = prepared("simplex", loss).assign(candidates, np.zeros((3, 2)))
    assert assignment.tightness.all()
    # l1 only: |1 - 2t| + |0 + 2t| = 1 on all of 0 <= t <= 1/2
    candidates = np.array([[[0.0, 0.0]], [[2.0, -2.0]]])
    assignment = prepared("simplex", "l1").assign(candidates, np.array([[1.0, 0.0]]))
    np.testing.assert_array_equal(assignment.membership, [[1.0, 0.0]])


def test_exact_is_the_argmin_and_proves_itself():
    candidates = np.array([[[0.0, 0.0], [0.0, 0.0]], [[1.0, 1.0], [1.0, 1.0]]])
    assignment = ExactRelaxation().assign(candidates, np.array([[0.2, 0.3], [1.0, 0.5]]))
    np.testing.assert_array_equal(assignment.modes, [0, 1])
    assert assignment.objective == pytest.approx(1.0, abs=1e-12)
    assert assignment.gap == 0.0
    assert assignment.tightness.all()


# --- the moment relaxation's own bookkeeping ----------------------------------------------------


@pytest.mark.parametrize("n_samples", [1, 49, 50, 51, 120])
def test_chunks_do_not_show(n_samples):
    candidates, targets, _ = problem(2, n_samples, 2, 0.3, seed=6)
    moment = MomentRelaxation().assign(candidates, targets)
    simplex = SimplexRelaxation().assign(candidates, targets)
    assert moment.membership.shape == (n_samples, 2)
    assert close(moment.lower_bound, simplex.lower_bound, "l1", tolerance=1e-6 * n_samples)


def test_order_one_by_hand():
    # target 1/4 between 0 and 1: lambda = (3/4, 1/4), fitted exactly, not rank one
    candidates = np.array([[[0.0], [0.0]], [[1.0], [1.0]]])
    assignment = MomentRelaxation().assign(candidates, np.array([[0.25], [1.5]]))
    np.testing.assert_allclose(assignment.membership, [[0.75, 0.25], [0.0, 1.0]], atol=1e-5)
    assert assignment.lower_bound == pytest.approx(0.5, abs=1e-6)
    assert assignment.objective == pytest.approx(0.75, abs=1e-12)
    np.testing.assert_array_equal(assignment.tightness, [False, True])
