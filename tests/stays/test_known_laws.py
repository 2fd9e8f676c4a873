"""Recordings of laws of which something is known."""

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from swsysid import Known, SwitchingSystemRegressor, TrajectoryIdentifier, load_model, save_model
from swsysid.datasets import make_damped_oscillator
from swsysid.refinement import StatedModel, StatedSurface

T = np.linspace(0.0, 8.0, 161)
SOFTER = StatedModel(
    None, [[[0, 1], [-1, -0.1]], [[0, 1], [-4, -0.1]]],
    states=["x", "v"], surface=StatedSurface([[0, 1, 0]], 1),
)  # fmt: skip


def recordings(plant, starts, noise=0.02, seed=0, offset=0.0):
    rng = np.random.default_rng(seed)
    return [
        {"t": T, "x": pd.DataFrame(
            plant.simulate(start, T).x + noise * rng.standard_normal((len(T), 2)) + [offset, 0.0],
            columns=["x", "v"],
        )}
        for start in starts
    ]  # fmt: skip


def softer():
    return recordings(SOFTER, ([1, 1], [-2, 0], [1.5, -1]))


def identified(given, known, n_modes=2, **options):
    estimator = SwitchingSystemRegressor(n_modes, feature_library=1, random_state=0, **options)
    return TrajectoryIdentifier(estimator, known=known).fit(given)


@pytest.mark.parametrize("sentence", ["x' = 1.03 v", "x'[v] = 1.03"])
def test_one_sentence_alone_may_be_wrong(sentence):
    """A circle, told with its rate three per cent off: nothing is known without that sentence."""
    rng = np.random.default_rng(0)
    x = np.column_stack([np.cos(T), -np.sin(T)]) + 0.01 * rng.standard_normal((len(T), 2))
    given = [{"t": T, "x": pd.DataFrame(x, columns=["x", "v"])}]
    [check] = identified(given, [sentence], n_modes=1).known_
    assert check.p_value < 1e-6 and "would rather have x'[v] = " in str(check)


def test_what_is_said_twice_is_asked_once():
    rng = np.random.default_rng(0)
    x = np.column_stack([np.cos(T), -np.sin(T)]) + 0.01 * rng.standard_normal((len(T), 2))
    given = [{"t": T, "x": pd.DataFrame(x, columns=["x", "v"])}]
    [check] = identified(given, ["x'[v] = 1.05", "x'[v]=1.05"], n_modes=1).known_
    assert check.questioned and check.value == pytest.approx(1.0, abs=0.01)
    other = identified(given, ["x' = v", "x'[v] = 1"], n_modes=1).known_[1]
    assert other.value == pytest.approx(1.0, abs=4.0 * other.error) and not other.questioned


@pytest.mark.nightly
def test_what_is_wrong_twice_is_found_in_both():
    """Either of two sentences holds what the other one says."""
    found = identified(softer(), ["x' = 1.05 v", "x'[v] = 1.05", "x'[x] same in all modes"])
    *wrong, tie = found.known_
    for check in wrong:
        assert check.questioned and check.value == pytest.approx(1.0, abs=4.0 * check.error)
    assert not tie.questioned


@pytest.mark.nightly
@pytest.mark.parametrize("sparsity", [None, "auto"])
def test_what_is_grossly_wrong_distorts_the_modes_and_is_found(sparsity):
    """README's oscillator: with one damping the modes settle where no small step is a gain."""
    true = make_damped_oscillator(None, n_trajectories=4, time_step=0.05, random_state=0)
    x = true.X + 0.02 * np.random.default_rng(0).standard_normal(true.X.shape)
    estimator = SwitchingSystemRegressor(2, sparsity=sparsity, random_state=0)
    tie = "x1'[x1] same in all modes"
    found = TrajectoryIdentifier(estimator, known=tie).fit(x, true.t, true.groups)
    [check] = found.known_
    assert check.questioned and abs(check.value) == pytest.approx(0.4, abs=4.0 * check.error)


def test_laws_are_as_known_and_closer_to_the_truth():
    given = softer()
    free = identified(given, None)
    found = identified(given, Known().equal("x' = v").tie("v'", "v").zero("v'", "1"))
    coef = found.estimator_.coef_
    np.testing.assert_array_equal(coef[:, 0], [[0.0, 0.0, 1.0]] * 2)
    np.testing.assert_array_equal(coef[:, 1, 0], 0.0)
    assert coef[0, 1, 2] == pytest.approx(coef[1, 1, 2], abs=1e-12)
    truth = np.array([[-1.0, -0.1], [-4.0, -0.1]])
    errors = [np.abs(one.estimator_.coef_[:, 1, 1:] - truth).max() for one in (found, free)]
    assert errors[0] < errors[1] / 2.0
    sure = found.coef_errors_
    assert (sure[:, 0] == 0.0).all() and sure[0, 1, 2] == pytest.approx(sure[1, 1, 2], rel=1e-9)
    assert (sure[:, 1, 1:] < free.coef_errors_[:, 1, 1:]).all()
    assert not any(one.questioned for one in found.known_)
    assert found.verdict_.n_modes == 2  # whose rivals have other terms


def test_it_is_the_answer_of_another_solver():
    # one law with v'[x] = 10 v'[v]: rollouts of the one unknown and two starts, by SciPy
    given = recordings(StatedModel(None, [[0, 1], [-1.0, -0.1]], states=["x", "v"]), ([1, 1],))
    found = identified(given, ["x' = v", "v'[x] = 10 v'[v]", "v'[1] = 0"], n_modes=1)
    y = given[0]["x"].to_numpy()

    def left(unknowns):
        law = [[0.0, 1.0], [10.0 * unknowns[0], unknowns[0]]]
        run = solve_ivp(
            lambda _, z: np.dot(law, z), (0, T[-1]), unknowns[1:], t_eval=T, rtol=1e-9, atol=1e-9
        )
        return ((run.y.T - y) / found.noise_).ravel()

    other = least_squares(left, [-0.12, 1.0, 1.0], xtol=1e-12, ftol=1e-12)
    error = np.sqrt(np.linalg.inv(other.jac.T @ other.jac)[0, 0])
    coef, sure = found.estimator_.coef_[0, 1], found.coef_errors_[0, 1]
    assert coef[2] == pytest.approx(other.x[0], abs=0.05 * error)  # ties are not quite rigid
    np.testing.assert_allclose(sure[1:] / found.report_.samples_that_count_as_one**0.5,
                               [10.0 * error, error], rtol=0.05)  # fmt: skip


def test_a_bound_that_is_reached_holds_and_says_what_the_data_would_rather_have():
    given = recordings(StatedModel(None, [[0, 1], [-1.0, 0.02]], states=["x", "v"]), ([1, 1],))
    known = Known().equal("x' = v").bound("v'", "v", upper=0.0)
    found = identified(given, known, n_modes=1)
    assert -1e-15 < found.estimator_.coef_[0, 1, 2] <= 0.0
    bound = found.known_[1]
    assert bound.questioned and bound.name == "v'[v]"
    assert bound.value == pytest.approx(0.02, abs=4.0 * bound.error)


def test_the_error_of_a_coefficient_on_its_bound_is_that_without_it():
    given = recordings(StatedModel(None, [[0, 1], [-1.0, 0.0]], states=["x", "v"]), ([1, 1],))
    free = identified(given, "x' = v", n_modes=1)
    beyond = free.estimator_.coef_[0, 1, 2] - 0.5 * free.coef_errors_[0, 1, 2]
    found = identified(given, Known().equal("x' = v").bound("v'", "v", upper=beyond), n_modes=1)
    assert found.estimator_.coef_[0, 1, 2] == pytest.approx(beyond, abs=1e-12)
    np.testing.assert_allclose(found.coef_errors_, free.coef_errors_, rtol=0.1)
    assert 0.1 < found.known_[1].p_value < 0.5 and not found.known_[1].questioned


def test_what_is_wrong_is_found_and_its_neighbours_are_not_blamed():
    found = identified(softer(), ["x' = v", "v'[v] = -0.105"])
    law, damping = found.known_
    assert damping.questioned and not law.questioned
    assert damping.value == pytest.approx(-0.1, abs=5.0 * damping.error)
    assert "the data would rather have v'[v]" in str(found.report_)


def test_a_tie_that_leaves_one_mode_is_found():
    plant = StatedModel(
        None, [[[0, 1], [-1, -0.1]], [[0, 1], [-1, -0.5]]],
        states=["x", "v"], surface=StatedSurface([[0, 1, 0]], 1),
    )  # fmt: skip
    found = identified(
        recordings(plant, ([3, 1], [-4, 0], [2, -3])), ["x' = v", "v' same in all modes"]
    )
    assert found.n_modes_ == 1
    law, tie = found.known_
    assert tie.questioned and not law.questioned
    assert abs(tie.value) == pytest.approx(0.4, abs=5.0 * tie.error)


def test_columns_far_from_zero_change_nothing():
    known = ["x' = v", "v'[v] = -0.1"]
    near = identified(softer(), known)
    far = identified(recordings(SOFTER, ([1, 1], [-2, 0], [1.5, -1]), offset=1e3), known)
    np.testing.assert_allclose(
        far.estimator_.coef_[:, :, 1:], near.estimator_.coef_[:, :, 1:], atol=1e-4
    )
    np.testing.assert_allclose(far.estimator_.coef_[:, 1, 2], -0.1, atol=1e-9)


def test_few_terms_and_a_number_of_modes_that_is_sought():
    found = identified(softer(), ["x' = v", "v'[v] same in all modes"], "auto", sparsity="auto")
    assert found.n_modes_ == 2
    coef = found.estimator_.coef_
    assert coef[0, 1, 2] == pytest.approx(coef[1, 1, 2], abs=1e-12)


def test_recordings_without_noise():
    found = identified(recordings(SOFTER, ([1, 1], [-2, 0]), noise=0.0), ["x' = v", "v'[v] = -0.1"])
    expected = [[0.0, -4.0, -0.1], [0.0, -1.0, -0.1]]
    np.testing.assert_allclose(sorted(found.estimator_.coef_[:, 1].tolist(), key=lambda a: a[1]),
                               expected, atol=1e-4)  # fmt: skip


def test_what_speeds_are_is_known_already():
    positions = [{"t": one["t"], "x": one["x"][["x"]]} for one in softer()]
    estimator = SwitchingSystemRegressor(1, feature_library=1, random_state=0)
    with pytest.raises(ValueError, match="contradicts order=2"):
        TrajectoryIdentifier(estimator, order=2, known="x' = 2 x'").fit(positions)


def test_it_is_refused_before_anything_is_fitted():
    with pytest.raises(ValueError, match="the terms are 1, x, v"):
        identified(softer(), "v' has no u")
    with pytest.raises(TypeError, match="must be a Known"):
        TrajectoryIdentifier(known=3).fit(softer())


def test_it_is_saved(tmp_path):
    given = recordings(StatedModel(None, [[0, 1], [-1.0, -0.1]], states=["x", "v"]), ([1, 1],))
    found = identified(given, Known().equal("x' = v"), n_modes=1)
    save_model(found, tmp_path / "model.json")
    again = load_model(tmp_path / "model.json")
    assert again.known == found.known and again.known_ == found.known_


def test_recordings_without_noise_contradict_what_is_false_and_nothing_else():
    """Samples that laws follow to rounding leave nothing by which to divide."""
    t = np.arange(0.0, 5.0, 0.05)
    x, u = np.column_stack([1.0 - np.cos(t), np.sin(t)]), np.cos(0.3 * t)[:, None]
    for sentence, questioned in (("x0' = x1", False), ("x1'[x0] = 0.3", True)):
        switching = SwitchingSystemRegressor(1, feature_library=1, random_state=0)
        found = TrajectoryIdentifier(switching, known=sentence).fit(x, t, inputs=u)
        (check,) = found.report_.known
        assert check.questioned == questioned and check.p_value in (0.0, pytest.approx(1.0))
