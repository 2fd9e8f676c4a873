"""Energies that never rise: a matrix inequality of coefficients, met by cutting planes."""

import cvxpy as cp
import numpy as np
import pandas as pd
import pytest

from swsysid import Known, SwitchingSystemRegressor, TrajectoryIdentifier, solve_mip
from swsysid._known.known import check_known
from swsysid._known.program import Cone, Steps
from swsysid._losses import LOSSES, get_loss
from swsysid.diagnosis import switching_verdict
from swsysid.refinement import StatedModel, StatedSurface, refine

ENERGY = "energy x^2 + v^2 never rises"
COEF = np.array([[[0.0, 1.0, 0.0], [-1.0, -0.02, 0.5]], [[0.0, 1.0, 0.0], [-1.0, -0.3, 0.5]]])


def rows(n_samples=300, noise=0.3):
    rng = np.random.default_rng(0)
    X = rng.uniform(-2, 2, (n_samples, 3))
    modes = (X[:, 0] > 0).astype(int)
    Xdot = np.einsum("isf,if->is", COEF[modes], X) + noise * rng.standard_normal((n_samples, 2))
    return pd.DataFrame(X, columns=["x", "v", "u"]), Xdot


def rates(law, form):
    """Eigenvalues of A'P + PA."""
    A = law[:, : len(form)]
    return np.linalg.eigvalsh(A.T @ form + form @ A)


@pytest.mark.filterwarnings("ignore::swsysid._results.IdentificationWarning")
@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
@pytest.mark.parametrize("loss", LOSSES)
def test_laws_are_those_of_a_semidefinite_program(loss):
    X, Xdot = rows()
    free = SwitchingSystemRegressor(loss=loss, random_state=0).fit(X, Xdot)
    found = SwitchingSystemRegressor(loss=loss, known=ENERGY, random_state=0).fit(X, Xdot)
    form, least = np.eye(2), 0.0
    for mode in range(2):
        law, own = cp.Variable((2, 3)), found.modes_ == mode
        left = Xdot[own] - X.to_numpy()[own] @ law.T
        A = law[:, :2]
        program = cp.Problem(
            cp.Minimize(cp.sum(get_loss(loss).expression(cp, left))), [A.T @ form + form @ A << 0]
        )
        least += program.solve(solver="CLARABEL")
    # Clarabel is 1e-8 off, and so may a matrix be
    assert found.objective_ == pytest.approx(least, rel=1e-7)
    assert max(rates(law, form).max() for law in found.coef_) < 1e-8
    assert max(rates(law, form).max() for law in free.coef_) > 0.004  # noise makes energy


@pytest.mark.parametrize(("growth", "n_zero"), [(0.0, 1), (1.2, 2), (5.0, 3)])
def test_three_states_on_faces_and_in_corners_of_the_cone(growth, n_zero):
    rng = np.random.default_rng(1)
    form, X = np.diag([1.0, 2.0, 0.5]), rng.standard_normal((60, 3))
    y = X @ (rng.standard_normal((3, 3)) + growth * np.eye(3)).T  # rises in so many directions
    matrix, right = np.kron(np.eye(3), X.T @ X), (y.T @ X).ravel()
    by = np.zeros((9, 3, 3))
    for k in range(9):
        A = np.eye(9)[k].reshape(3, 3)
        by[k] = A.T @ form + form @ A
    nothing = np.zeros((0, 9)), np.zeros(0)
    found = Steps(*nothing, *nothing, (Cone(np.zeros((3, 3)), by),)).least(matrix, right)
    law = cp.Variable((3, 3))
    squares = cp.sum_squares(y - X @ law.T)
    cp.Problem(cp.Minimize(squares), [law.T @ form + form @ law << 0]).solve(solver="CLARABEL")
    np.testing.assert_allclose(found.reshape(3, 3), law.value, atol=1e-5)  # that of Clarabel
    assert np.sum(rates(found.reshape(3, 3), form) > -1e-6) == n_zero


def test_a_full_energy_of_eight_states_is_met():
    """As close as one of two; with a hundred turns of cuts one is 8e-5 off."""
    rng, names = np.random.default_rng(1), [f"s{i}" for i in range(8)]
    for _ in range(3):
        root = rng.standard_normal((8, 8))
        form = root @ root.T + 0.1 * np.eye(8)
        parts = (
            f"{form[i, j] * (2 - (i == j))} {names[i]} {names[j]}".replace(
                f"{names[i]} {names[i]}", f"{names[i]}^2"
            )
            for i in range(8)
            for j in range(i + 1)
        )
        energy = " + ".join(parts).replace("+ -", "- ")
        region = Known().dissipates(energy).region(names, names, 1)
        law, free = rng.standard_normal((1, 8, 8)), np.ones((1, 8, 8), dtype=bool)
        [moved] = region.nearest(law, free, np.diag(rng.uniform(0.5, 2.0, 64)))
        size = np.abs(form).max() * np.abs(moved).max()
        assert rates(moved, form).max() < 1e-7 * size


def test_with_speeds_that_are_known_an_energy_is_a_stiffness_and_a_sign():
    region = Known.from_text(["energy 4 x^2 + v^2 never rises", "x' = v"]).region(
        ["x", "v"], ["1", "x", "v"], 1
    )
    fixed, values = region.fixed
    assert not region.cones  # all of it is in rows
    np.testing.assert_array_equal(fixed[0], [[True] * 3, [False, True, False]])
    np.testing.assert_array_equal(values[0, 1], [0.0, -4.0, 0.0])
    assert region.box[1][0, 1, 2] == 0.0


def plant(damping):
    return StatedModel(
        None, [[[0, 1], [-1, -damping]], [[0, 1], [-1, -0.3]]],
        states=["x", "v"], surface=StatedSurface([[0, 1, 0]], 1),
    )  # fmt: skip


def recorded(damping, seed=0):
    rng, t = np.random.default_rng(seed), np.linspace(0, 8, 161)
    runs = [plant(damping).simulate(start, t).x for start in ([1, 1], [-2, 0], [0.5, -1])]
    frames = [
        pd.DataFrame(run + 0.03 * rng.standard_normal(run.shape), columns=["x", "v"])
        for run in runs
    ]
    return frames, [t] * 3


@pytest.mark.parametrize("damping", [0.0, 0.02])
def test_recordings_are_held_to_it_and_ask_it(damping):
    regressor = SwitchingSystemRegressor(random_state=0)
    found = TrajectoryIdentifier(regressor, known=ENERGY).fit(*recorded(damping))
    assert max(rates(law, np.eye(2)).max() for law in found.estimator_.coef_) < 1e-8
    [check] = found.known_
    assert not check.questioned and check.p_value > 0.01
    assert abs(check.value) < 4.0 * check.error
    errors = np.abs(np.sort(found.estimator_.coef_[:, 1, 1]) - [-0.3, -damping])
    assert (errors < 0.012).all()  # four standard errors
    # what it proves: no rollout gains energy, wherever it begins
    run = found.estimator_.simulate([3.0, -2.0], np.linspace(0, 30, 601)).x
    energy = np.square(run).sum(axis=1)
    assert np.diff(energy).max() <= 1e-6 * energy[0]


def test_what_is_wrong_is_found():
    known = ["energy 1.5 x^2 + v^2 never rises"]
    regressor = SwitchingSystemRegressor(random_state=0)
    found = TrajectoryIdentifier(regressor, known=known).fit(*recorded(0.02))
    [check] = found.known_
    assert check.questioned and check.p_value < 1e-6
    assert check.name.startswith("rate of the energy in mode")
    # of x' = v, v' = -x it is x v at its largest over the unit circle: 0.5, less the damping
    assert check.value == pytest.approx(0.5, abs=0.05)


def test_smooth_rivals_of_a_verdict_know_nothing():
    X, Xdot = rows(1500)
    model = SwitchingSystemRegressor(known=ENERGY, random_state=0).fit(X, Xdot)
    # laws with squares are among them, of which no energy of squares is
    assert switching_verdict(model, X, Xdot).best_law


def test_sentences_and_refusals():
    known = Known().dissipates("4 x^2 + x v + v^2")
    assert str(known) == "energy 4 x^2 + x v + v^2 never rises"
    assert Known.from_text(str(known)) == known
    met = [ENERGY, "x'[x] = -1", "v'[v] = -1", "x'[v] = 2", "v'[x] = 0"]
    assert check_known(met).region(["x", "v"], ["x", "v"], 1).cones
    # the law of a state without energy may be any
    partly = check_known(["energy v^2 never rises", "v' has only v, u"])
    assert partly.region(["x", "v"], ["x", "v", "u", "x v"], 1).box[1][0, 1, 1] == 0.0
    region = Known().dissipates("x^2 + x'^2").region(["x", "x'"], ["1", "x", "x'"], 2)
    assert len(region.cones) == 2
    X, Xdot = rows(60)
    for sentences, message in (
        ("energy x^2 + w^2 never rises", r"names w\^2; an energy is of squares"),
        ("energy 0 x^2 never rises", "says nothing: all of its numbers are zero"),
        ("energy x v - v x never rises", "says nothing: all of its numbers are zero"),
        ("energy x^2 + 3 never rises", "an energy is of squares and products of states"),
        ("energy x^2 + v^2 never falls", r"such as .*energy x\^2 \+ v\^2 never rises"),
        (["energy x^2 never rises", "x' = v"], "cannot hold together"),
        ([ENERGY, "x' = v", "v'[x] = -4"], "cannot hold together"),
        ([ENERGY, "x'[x] = 0.1"], "cannot hold together"),
        # by no row alone: the matrix is [[-2, 2.1], [2.1, -2]], and with 2 it would be met
        ([ENERGY, "x'[x] = -1", "v'[v] = -1", "x'[v] = 2.1", "v'[x] = 0"], "cannot hold together"),
        ([ENERGY, "x'[x] >= -1", "v'[v] >= -1", "x'[v] >= 2.1", "v'[x] >= 0"], "cannot hold"),
    ):
        with pytest.raises(ValueError, match=message):
            SwitchingSystemRegressor(known=sentences).fit(X, Xdot)
    with pytest.raises(ValueError, match=r"laws that are linear in states; one may have x\^2"):
        SwitchingSystemRegressor(feature_library=2, known=ENERGY).fit(X, Xdot)
    with pytest.raises(ValueError, match="known of velocities"):
        SwitchingSystemRegressor(discrete_time=True, known=ENERGY).fit(X, Xdot)
    with pytest.raises(ValueError, match="no linear program; leave it out, or"):
        solve_mip(X, Xdot, known=ENERGY)
    t = np.linspace(0, 2, 41)
    data = [{"t": t, "x": plant(0.1).simulate([1.0, 1.0], t).x}]
    with pytest.raises(ValueError, match="say x' = v beside it"):
        refine(plant(0.1), data, known=ENERGY)
