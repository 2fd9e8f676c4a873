"""The simplex assignment of any number of modes: hand cases, proofs, HiGHS, Clarabel, row order."""

import cvxpy as cp
import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.sparse import block_diag

from swsysid._results import SolverError, Status
from swsysid._solvers.conic import LinearSolution
from swsysid.relaxations import SimplexRelaxation
from swsysid.relaxations import _hulls as hulls
from swsysid.relaxations._hulls import HullSettings, nearest_l1


def random(rng, candidates, targets):
    return candidates, targets


def equal_candidates(rng, candidates, targets):
    candidates[-1] = candidates[0]
    return candidates, targets


def collinear(rng, candidates, targets):
    along = rng.normal(size=(len(candidates), len(targets), 1))
    return candidates[0] + along * candidates[1], targets


def integers(rng, candidates, targets):
    return np.round(2 * candidates), np.round(2 * targets)


def on_an_edge(rng, candidates, targets):
    share = rng.uniform(size=(len(targets), 1))
    return candidates, share * candidates[0] + (1.0 - share) * candidates[1]


def inside(rng, candidates, targets):
    weights = rng.dirichlet(np.ones(len(candidates)), size=len(targets))
    return candidates, np.einsum("im,mik->ik", weights, candidates)


def at_a_candidate(rng, candidates, targets):
    modes = rng.integers(len(candidates), size=len(targets))
    return candidates, candidates[modes, np.arange(len(targets))].copy()


def duplicated_samples(rng, candidates, targets):
    rows = np.repeat(np.arange(len(targets) // 5), 5)
    return candidates[:, rows], targets[rows]


def a_state_at_rest(rng, candidates, targets):
    candidates[..., 0], targets[:, 0] = 0.0, 0.0
    return candidates, targets


def far_from_the_origin(rng, candidates, targets):
    return 1e6 + candidates, 1e6 + targets


def badly_scaled_samples(rng, candidates, targets):
    unit = 10.0 ** rng.uniform(-6, 6, size=(len(targets), 1))
    return candidates * unit, targets * unit


def badly_scaled_modes(rng, candidates, targets):
    unit = 10.0 ** rng.uniform(-6, 6, size=(len(candidates), 1, 1))
    return candidates * unit, targets


def badly_scaled_states(rng, candidates, targets):
    unit = 10.0 ** rng.uniform(-6, 6, size=targets.shape[1])
    return candidates * unit, targets * unit


KINDS = (
    random,
    equal_candidates,
    collinear,
    integers,
    on_an_edge,
    inside,
    at_a_candidate,
    duplicated_samples,
    a_state_at_rest,
    far_from_the_origin,
    badly_scaled_samples,
    badly_scaled_modes,
    badly_scaled_states,
)
SHAPES = [(n_modes, n_states) for n_modes in (2, 3, 4, 5, 6) for n_states in (1, 2, 3, 4)]


def problem(kind, n_modes, n_states, n_samples=40, seed=0):
    rng = np.random.default_rng([seed, n_modes, n_states])
    candidates = rng.normal(size=(n_modes, n_samples, n_states))
    return kind(rng, candidates, rng.normal(size=(n_samples, n_states)))


def in_units(candidates, targets):
    """Residuals, every sample in units of its longest."""
    residuals = targets - candidates
    scale = np.abs(residuals).max(axis=(0, 2))
    return residuals / np.where(scale > 0, scale, 1.0)[:, None]


def values(residuals, membership):
    """Loss of every sample."""
    return np.abs(np.einsum("im,mik->ik", membership, residuals)).sum(axis=1)


def highs(residuals):
    """The least loss of every sample from SciPy, at its tightest, every state in its own unit."""
    n_modes, n_samples, n_states = residuals.shape
    unit = np.abs(residuals).max(axis=(0, 1))
    residuals = residuals / np.where(unit > 0.0, unit, 1.0)
    parts = np.hstack([-np.eye(n_states), np.eye(n_states)])
    ones = np.append(np.ones(n_modes), np.zeros(2 * n_states))
    blocks = [np.vstack([np.hstack([one.T, parts]), ones]) for one in residuals.transpose(1, 0, 2)]
    tight = {f"{side}_feasibility_tolerance": 1e-10 for side in ("primal", "dual")}
    answer = linprog(
        np.tile(np.concatenate([np.zeros(n_modes), unit, unit]), n_samples),
        A_eq=block_diag(blocks, format="csr"),
        b_eq=np.tile(np.append(np.zeros(n_states), 1.0), n_samples),
        method="highs-ds",
        options=tight,
    )
    return answer.x.reshape(n_samples, -1)[:, n_modes:] @ np.append(unit, unit)


@pytest.mark.parametrize("shape", SHAPES, ids=str)
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_every_sample_agrees_with_highs(kind, shape):
    candidates, targets = problem(kind, *shape)
    assignment = SimplexRelaxation().assign(candidates, targets)
    residuals = in_units(candidates, targets)
    found = values(residuals, assignment.membership)
    # Where the hull contains the target the loss is zero, and so it comes out up to rounding.
    np.testing.assert_allclose(found, highs(residuals), rtol=1e-8, atol=1e-10)
    assert assignment.status is Status.OPTIMAL


@pytest.mark.parametrize("n_modes", [2, 4, 6])
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_the_value_agrees_with_clarabel(kind, n_modes):
    candidates, targets = problem(kind, n_modes, 2, seed=1)
    membership = SimplexRelaxation().assign(candidates, targets).membership
    residuals = in_units(candidates, targets)
    free = cp.Variable(membership.shape, nonneg=True)
    mixed = [cp.sum(cp.multiply(residuals[:, :, k].T, free), axis=1) for k in range(2)]
    cost = cp.sum(cp.abs(cp.vstack(mixed)))
    program = cp.Problem(cp.Minimize(cost), [cp.sum(free, axis=1) == 1])
    tight = {f"tol_{name}": 1e-11 for name in ("gap_abs", "gap_rel", "feas")}
    value = program.solve(solver="CLARABEL", **tight)
    assert values(residuals, membership).sum() == pytest.approx(value, rel=1e-8, abs=1e-9)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_one_hot_where_a_mode_is_as_good(kind):
    candidates, targets = problem(kind, 2, 3, n_samples=200, seed=2)
    three = np.concatenate([candidates, candidates[:1]])
    for some in (candidates, three):
        membership = SimplexRelaxation().assign(some, targets).membership
        residuals = in_units(some, targets)
        best = np.abs(residuals).sum(axis=2).min(axis=0)
        as_good = best <= values(residuals, membership) * (1.0 + 1e-13)
        assert (membership.max(axis=1)[as_good] == 1.0).all()


# --- the batched tableaus by themselves -----------------------------------------------------------


def refused(*arguments, **options):
    raise AssertionError("HiGHS was asked")


@pytest.mark.parametrize("kind", KINDS[:-5], ids=lambda kind: kind.__name__)
@pytest.mark.parametrize("n_modes", [3, 6])
def test_tableaus_prove_every_sample_themselves(monkeypatch, n_modes, kind):
    monkeypatch.setattr(hulls, "linear_program", refused)
    candidates, targets = problem(kind, n_modes, 4, n_samples=300, seed=3)
    membership, bound, status = nearest_l1(targets - candidates)
    norms = values(targets - candidates, membership)
    np.testing.assert_allclose(bound, norms, rtol=1e-9, atol=1e-12)
    assert status is Status.OPTIMAL
    assert (membership >= 0.0).all()
    np.testing.assert_allclose(membership.sum(axis=1), 1.0, atol=1e-14)


def test_samples_without_a_proof_are_solved_by_highs():
    candidates, targets = problem(random, 4, 3, seed=4)
    residuals = in_units(candidates, targets)
    reference = values(residuals, nearest_l1(residuals)[0])
    posed = values(residuals, nearest_l1(residuals, HullSettings(patience=0, chunk=7))[0])
    np.testing.assert_allclose(posed, reference, rtol=1e-9, atol=1e-14)


@pytest.mark.parametrize("status", [Status.INFEASIBLE, Status.UNBOUNDED, Status.FAILED])
def test_where_highs_fails_too_there_is_no_assignment(monkeypatch, status):
    nothing = LinearSolution(np.empty(0), np.nan, np.empty(0), np.empty(0), status)
    monkeypatch.setattr(hulls, "linear_program", lambda *_, **__: nothing)
    relaxation = SimplexRelaxation()
    relaxation.settings = HullSettings(patience=0)
    with pytest.raises(SolverError, match="choose another solver"):
        relaxation.assign(*problem(random, 3, 2))


def test_without_a_proof_nothing_is_called_optimal(monkeypatch):
    candidates, targets = problem(random, 4, 2, seed=6)
    relaxation = SimplexRelaxation()
    relaxation.loss = "l2"
    right = relaxation.assign(candidates, targets)
    assert right.status is Status.OPTIMAL

    def corners_only(corners, accuracy):  # a projection that finds no point but the first corner
        weights = np.eye(len(corners))[[0] * corners.shape[1]]
        return weights, corners[0]

    monkeypatch.setattr(hulls, "_project", corners_only)
    doubtful = relaxation.assign(candidates, targets)
    assert doubtful.status is Status.INACCURATE
    assert 0.0 <= doubtful.lower_bound <= right.lower_bound  # a true bound all the same


def test_the_proof_of_a_projection_is_checked_by_its_bound():
    candidates, targets = problem(random, 5, 3, seed=7)
    residuals = targets - candidates
    membership, bound, status = hulls.nearest_euclidean(residuals)
    points = np.einsum("ij,jik->ik", membership, residuals)
    size = np.abs(residuals).max(axis=(0, 2))
    assert status is Status.OPTIMAL
    assert (np.abs(np.linalg.norm(points, axis=1) - bound) <= 1e-9 * size).all()
    # p is nearest exactly where <p, r_j> >= <p, p> for every corner
    reach = np.einsum("ik,jik->ij", points, residuals).min(axis=1)
    assert (np.square(points).sum(axis=1) - reach <= 1e-9 * size**2).all()


@pytest.mark.parametrize("n_modes", [2, 3, 5])
def test_a_sample_has_its_membership_whatever_its_company(n_modes):
    candidates, targets = problem(random, n_modes, 3, n_samples=100, seed=5)
    together = SimplexRelaxation().assign(candidates, targets).membership
    rows = np.random.default_rng(0).integers(100, size=250)
    relaxation = SimplexRelaxation()
    relaxation.settings = HullSettings(together=30)
    apart = relaxation.assign(candidates[:, rows], targets[rows]).membership
    np.testing.assert_array_equal(apart, together[rows])


def test_a_square_around_the_target_by_hand():
    # In a square of corners (+-1, +-1) around the origin any balanced weights have no residual;
    # moved by (3, 0) its nearest points are those of the side x = 2.
    square = np.array([[[-1.0, -1.0]], [[-1.0, 1.0]], [[1.0, -1.0]], [[1.0, 1.0]]])
    weights = nearest_l1(square)[0]
    np.testing.assert_allclose(weights @ square[:, 0], [[0.0, 0.0]], atol=1e-15)
    np.testing.assert_allclose(nearest_l1(square + [3.0, 0.0])[0], [[0.5, 0.5, 0.0, 0.0]])


def test_memberships_lose_the_rounding_of_a_solver():
    told = hulls.on_simplex(np.array([[2.0, -1e-9, 2.0], [0.0, 3.0, 0.0]]))
    np.testing.assert_array_equal(told, [[0.5, 0.0, 0.5], [0.0, 1.0, 0.0]])
