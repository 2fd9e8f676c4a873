"""Laws and states of highest likelihood, and the modes that go with them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from lagged_plants import switched_arx
from scipy.linalg import block_diag

from swsysid._data.features import FeatureMap
from swsysid._data.recordings import Record
from swsysid._discrete_stays.data import DiscreteData
from swsysid._discrete_stays.lagged import lagged_rows
from swsysid._discrete_stays.modes import reassigned
from swsysid._discrete_stays.rows import as_fit, fitted, row_costs, scale_of
from swsysid._discrete_stays.states import (
    PATIENT_STEPS,
    LawsAndStates,
    StateProblem,
    with_states,
)


def with_true_modes(planted, lags, library=1):
    """The rows of a plant, and their fit by least squares in the true modes."""
    rows = lagged_rows(planted.recordings, lags)
    data = DiscreteData.of(rows, FeatureMap(library, rows.columns, rows.names))
    modes = np.array(
        [planted.modes[r][k] for r, k in zip(rows.recording, rows.sample, strict=True)]
    )
    n_modes, n_features = len(planted.coef), len(data.feature_unit)
    free = np.ones((n_modes, n_features), dtype=bool)
    empty = np.zeros((n_modes, rows.n_states, n_features))
    coef = fitted(data.problem, modes, empty, free)
    scale = scale_of(data.problem, coef, modes)
    return data, as_fit(
        data.problem, coef, scale, 0.03, modes, row_costs(data.problem, coef, scale)
    )


def every_feature(fit):
    return np.ones(fit.coef[:, 0].shape, dtype=bool)


def error(planted, data, coef):
    return np.abs(data.coef(coef) - planted.coef).max()


@pytest.mark.parametrize("library", [1, 2])
def test_the_gradient_of_the_sum_of_squares(library):
    planted = switched_arx(3, 2, 1, n_states=2, n_recordings=2, n=30, noise=0.02)
    data, fit = with_true_modes(planted, 1, library)
    lawful = fit.modes.copy()
    lawful[10:12] = -1
    problem = StateProblem(data, lawful, every_feature(fit), np.array([0.1, 0.2]), 0.5)
    rng, step = np.random.default_rng(0), 1e-5
    states = problem.y + 0.05 * rng.standard_normal(problem.y.shape)
    trial = LawsAndStates(fit.coef, np.ones(fit.coef.shape, dtype=bool), states)
    right = problem.normal_equations(trial).right
    laws = states.size + rng.integers(0, fit.coef.size, 3)
    for place in [*rng.integers(0, states.size, 6), *laws]:
        move = np.zeros(len(right))
        move[place] = step
        ends = [problem.normal_equations(trial.moved(sign * move)).value for sign in (1, -1)]
        slope = -(ends[0] - ends[1]) / (2 * step)
        assert slope == pytest.approx(right[place], rel=1e-3, abs=1e-3)


def test_the_step_is_that_of_the_dense_equations():
    planted = switched_arx(4, 2, 1, n_recordings=2, n=80, noise=0.02)
    data, fit = with_true_modes(planted, 1)
    noise, tie = np.array([0.1]), 0.5
    problem = StateProblem(data, fit.modes, every_feature(fit), noise, tie)
    start = LawsAndStates(fit.coef, np.ones(fit.coef.shape, dtype=bool), problem.y)
    equations = problem.normal_equations(start)
    n_states, n_free = problem.y.size, fit.coef.size
    # rows of the residuals: samples, then rows; columns: states, then coefficients
    slopes = np.zeros((len(problem.now), n_states + n_free))
    every = np.arange(len(problem.now))
    slopes[every, problem.now + 1] = 1.0
    units = data.target_unit[0] / data.feature_unit
    for mode in range(2):
        own = fit.modes == mode
        for lag in (0, 1):  # the constant is the first feature
            slopes[every[own], problem.now[own] - lag] -= (
                fit.coef[mode, 0, 1 + lag] * units[1 + lag]
            )
        first = n_states + mode * fit.coef.shape[2]
        slopes[own, first : first + fit.coef.shape[2]] = -data.problem.features[own]
    left = problem.left(fit.coef, problem.y, data.problem.features)
    weighted = slopes / (tie * noise)
    matrix = block_diag(np.eye(n_states) / noise**2, np.zeros((n_free, n_free)))
    matrix += weighted.T @ weighted
    damped = matrix + 1e-9 * np.diag(np.diag(matrix))
    dense = np.linalg.solve(damped, -weighted.T @ (left[:, 0] / (tie * noise)))
    step, promised = equations.step(0.0)
    np.testing.assert_allclose(step, dense, rtol=1e-4, atol=1e-7)
    assert promised == pytest.approx(0.5 * dense @ equations.right, rel=1e-4)


def test_a_part_has_the_states_of_its_rows_alone():
    planted = switched_arx(3, 2, 1, n_states=2, n_recordings=1, n=300, noise=0.02)
    data, fit = with_true_modes(planted, 1, 1)
    kept = np.concatenate([np.arange(40, 90), np.arange(200, 250)])
    part, fit = data.take(kept), fit.take(kept)
    recording, sample = np.repeat([0, 1], 50), np.tile(np.arange(1, 51), 2)
    alone = replace(part, rows=replace(part.rows, recording=recording, sample=sample))
    found, other = with_states(part, fit, 0.1), with_states(alone, fit, 0.1)
    # a row sees three samples: those of a piece are two more than its rows
    assert len(found.states) == len(other.states) == 2 * (50 + 2)
    np.testing.assert_allclose(found.coef, other.coef, rtol=1e-9)  # rounding
    assert found.cost == pytest.approx(other.cost, rel=1e-9)


def test_noise_in_the_features_no_longer_biases_the_laws():
    planted = switched_arx(5, 2, 2, n=1000, noise=0.03)
    data, fit = with_true_modes(planted, 2)
    found = None
    for tie in (1.0, 0.1, 0.01):
        found = with_states(data, fit, tie, found)
    assert error(planted, data, fit.coef) > 0.1
    assert error(planted, data, found.coef) < 0.03
    np.testing.assert_allclose(found.noise, 0.03, rtol=0.1)


def test_the_modes_are_told_by_the_states():
    planted = switched_arx(5, 2, 2, n=400, noise=0.03)
    data, truth = with_true_modes(planted, 2)
    found = None
    for tie in (1.0, 0.1):
        found = with_states(data, truth, tie, found)
    # the same laws by rows alone leave more of them in the wrong mode
    by_states, _ = reassigned(data, truth, found)
    assert np.mean(by_states.modes == truth.modes) > 0.995
    assert not by_states.unexplained.any()


def test_few_steps_reach_the_best_of_laws_about_an_offset():
    """Vibrations of two stiffnesses about 300: there the constant and a state are alike."""
    x, rows, modes = np.array([1.0, 0.0]), [], []
    for k in range(1200):
        modes.append(k // 300 % 2)
        rows.append(x)
        x = x + 0.01 * np.array([x[1], -(1.0, 4.0)[modes[-1]] * x[0] - 0.1 * x[1]])
    noise = 0.01 * np.random.default_rng(2).standard_normal((len(rows), 2))
    record = Record(np.arange(1200.0), np.array(rows) + noise + [300.0, 0.0], np.empty((1200, 0)))
    planted = SimpleNamespace(recordings=[record], modes=[modes], coef=np.zeros((2, 2, 3)))
    data, fit = with_true_modes(planted, 0)
    best = with_states(data, fit, 0.3, most_steps=PATIENT_STEPS).cost
    soon = with_states(data, fit, 0.3, most_steps=4).cost
    assert abs(soon - best) < 0.01  # 1.7 from a damping of 1e-3
