"""Refinement within what is known of the laws."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from swsysid import Known
from swsysid.refinement import ParametricLibrary, StatedModel, StatedSurface, refine

T = np.linspace(0.0, 8.0, 81)
SOFTER = [[[0, 1], [-1, -0.1]], [[0, 1], [-4, -0.1]]]


def two_modes(laws, **options):
    return StatedModel(
        None, laws, states=["x", "v"], surface=StatedSurface([[0, 1, 0]], 1), **options
    )


def records(noise=0.02, seed=0):
    rng = np.random.default_rng(seed)
    runs = [two_modes(SOFTER).simulate(start, T).x for start in ([1, 1], [-2, 0])]
    return [{"t": T, "x": run + noise * rng.standard_normal(run.shape)} for run in runs]


START = [[[0.1, 0.9], [-1.1, -0.2]], [[-0.1, 1.1], [-3.8, -0.05]]]


def test_ties_and_values_hold_and_make_errors_smaller():
    free = refine(two_modes(START), records())
    known = Known().equal("x' = v").tie("v'", "v").bound("v'", "v", upper=0)
    found = refine(two_modes(START), records(), known=known)
    coef, sure = found.model.coef_, found.coef_standard_errors
    np.testing.assert_array_equal(coef[:, 0], [[0.0, 1.0]] * 2)
    assert coef[0, 1, 1] == pytest.approx(coef[1, 1, 1], abs=1e-14)
    assert sure[0, 1, 1] == pytest.approx(sure[1, 1, 1], rel=1e-9)
    # bands of rollouts are drawn from the covariance of all, ties included
    both = found.model.covariance_[np.ix_([3, 7], [3, 7])]
    np.testing.assert_allclose(both, sure[0, 1, 1] ** 2, rtol=1e-9)
    assert found.names == ["mode 0: v', x", "mode 0: v', v", "mode 1: v', x"]
    assert (np.abs(coef - SOFTER) <= 4.0 * sure + 1e-12).all()
    assert (sure[:, 1] < free.coef_standard_errors[:, 1]).all()
    assert not any(one.questioned for one in found.known)
    assert "known: v'[v] <= 0: not contradicted" in found.summary()


def test_it_is_the_answer_of_another_solver():
    # one law with v'[x] = 10 v'[v]: rollouts of the one unknown and a start, by SciPy
    model = StatedModel(None, [[0, 1], [-1.2, -0.05]], states=["x", "v"])
    truth = StatedModel(None, [[0, 1], [-1.0, -0.1]], states=["x", "v"]).simulate([1, 1], T).x
    y = truth + 0.02 * np.random.default_rng(0).standard_normal(truth.shape)
    found = refine(model, {"t": T, "x": y}, known=["x' = v", "v'[x] = 10 v'[v]"], noise=[0.02] * 2)

    def left(unknowns):
        law = [[0.0, 1.0], [10.0 * unknowns[0], unknowns[0]]]
        run = solve_ivp(
            lambda _, z: np.dot(law, z), (0, T[-1]), unknowns[1:], t_eval=T, rtol=1e-9, atol=1e-9
        )
        return ((run.y.T - y) / 0.02).ravel()

    other = least_squares(left, [-0.12, 1.0, 1.0], xtol=1e-12, ftol=1e-12)
    error = np.sqrt(np.linalg.inv(other.jac.T @ other.jac)[0, 0])
    speed = found.model.coef_[0, 1]
    # Runge-Kutta steps of both differ by 1e-5
    assert speed[1] == pytest.approx(other.x[0], abs=0.02 * error)
    assert speed[0] == pytest.approx(10.0 * speed[1], rel=1e-12)
    assert found.cost_after == pytest.approx(other.cost, rel=1e-4)


def test_a_bound_that_is_reached_holds_and_is_questioned():
    found = refine(two_modes(START), records(), known=["x' = v", "v'[v] <= -0.2"])
    assert (found.model.coef_[:, 1, 1] <= -0.2).all()
    law, bound = found.known
    assert bound.questioned and not law.questioned
    assert bound.value == pytest.approx(-0.1, abs=4.0 * bound.error)
    assert "leave out or correct" in found.summary()


def test_a_wrong_value_is_found_and_its_neighbours_are_not_blamed():
    found = refine(two_modes(START), records(), known=["x' = v", "v'[v] = -0.13"])
    law, damping = found.known
    assert damping.questioned and not law.questioned
    assert damping.value == pytest.approx(-0.1, abs=4.0 * damping.error)


def test_numbers_inside_terms_are_estimated_beside_what_is_known():
    def drag(p, x_weight=-1.0):
        library = ParametricLibrary(
            {"x": lambda x: x, "v": lambda v: v, "drag": lambda v, p: np.sign(v) * np.abs(v) ** p},
            ["x", "v"], {"p": p},
        )  # fmt: skip
        return StatedModel(library, [[0, 1, 0], [x_weight, 0, -0.3]], states=["x", "v"])

    run = drag(1.5).simulate([2.0, 0.0], T).x
    x = run + 0.01 * np.random.default_rng(0).standard_normal(run.shape)
    found = refine(drag(1.1, -0.9), {"t": T, "x": x}, known=["x' = v", "v'[x] = -1"])
    power = found.names.index("p")
    assert found.values[power] == pytest.approx(1.5, abs=4.0 * found.standard_errors[power])
    assert found.standard_errors[power] < 0.1 and found.model.coef_[0, 1, 0] == -1.0
    assert not any(one.questioned for one in found.known)


@pytest.mark.parametrize(
    ("known", "said"),
    [
        ("v'[x] + v'[v] <= -1", "bounds a sum of coefficients"),
        ("guard x >= 0", "leaves surfaces as they are"),
        ("w' = v", "the equations are x', v'"),
        (["v'[v] = 0", "v'[v] = 1"], "cannot hold together"),
    ],
)
def test_what_cannot_be_is_refused(known, said):
    with pytest.raises(ValueError, match=said):
        refine(two_modes(START), records(), known=known)


@pytest.mark.parametrize(
    ("sentence", "questioned"), [("v'[x] = -2", False), ("v'[x] = -2.2", True)]
)
def test_rollouts_of_recordings_without_noise_are_as_exact_as_steps_are(sentence, questioned):
    """What an integration misses by is no evidence against what is right."""
    t = np.arange(0.0, 3.0, 0.05)
    x = StatedModel(None, [[[0, 1], [-2.0, -0.3]]], states=["x", "v"]).simulate([1.0, 0.0], t).x
    begun = StatedModel(None, [[[0, 1], [-2.1, -0.3]]], states=["x", "v"])
    (check,) = refine(begun, [{"t": t, "x": x}], known=sentence).known
    assert check.questioned == questioned and check.value == pytest.approx(-2.0, abs=1e-6)
