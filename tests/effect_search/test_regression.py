"""The regressions of a scan, against the library and the candidate in one least-squares problem."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from swsysid._data.records import make_records
from swsysid._effect_model.models import declared_model
from swsysid._effect_search.folds import make_folds
from swsysid._effect_search.recording import from_states
from swsysid._effect_search.regression import Regression, SharedSums
from swsysid.datasets import make_undeclared

N_ROWS = 240


@pytest.fixture
def problem():
    rng = np.random.default_rng(0)
    folds = make_folds(
        make_records(np.empty((N_ROWS, 1)), 1, names=["x"]), 5, np.random.RandomState(0)
    )
    support = np.ones((2, 2, 3), dtype=bool)
    support[1, 0, 2] = False  # the law of one state lacks a term in one mode
    features = rng.standard_normal((N_ROWS, 3))
    features[:, 2] *= 1e5  # in another unit
    return Regression(
        features=features,
        targets=rng.standard_normal((N_ROWS, 2)),
        modes=np.arange(N_ROWS) % 2,
        n_modes=2,
        weight=rng.uniform(0.2, 1.0, N_ROWS),
        folds=folds,
        support=support,
    )


def in_one_problem(problem, train, column, target):
    """Coefficient of a column beside the library of each mode, and the fall of the squares."""
    design = np.hstack(
        [
            problem.features[:, problem.support[mode, target]] * (problem.modes == mode)[:, None]
            for mode in range(problem.n_modes)
        ]
    )
    root = np.sqrt(problem.weight[train])
    y = root * problem.targets[train, target]
    squares = []
    for columns in (design, np.column_stack([design, column])):
        scaled = root[:, None] * columns[train]
        scaled /= np.linalg.norm(scaled, axis=0)
        coef = np.linalg.lstsq(scaled, y, rcond=None)[0]
        squares.append(np.sum((y - scaled @ coef) ** 2))
    return coef[-1] / np.linalg.norm(root * column[train]), squares[0] - squares[1]


def test_a_candidate_is_worth_what_it_is_worth_in_one_problem_with_the_library(problem):
    columns = np.random.default_rng(1).standard_normal((N_ROWS, 4, 1))
    backgrounds = [problem.background(fold) for fold in (0, 3, None)]
    solved = SharedSums(backgrounds).normal_equations(columns).solve(None)
    for part, background in enumerate(backgrounds):
        alone = background.normal_equations(columns).solve(None)
        np.testing.assert_allclose(solved.coef[part], alone.coef[0], rtol=1e-9)
        np.testing.assert_allclose(solved.gain[part], alone.gain[0], rtol=1e-9)
        for candidate, target in product(range(4), range(2)):
            coef, gain = in_one_problem(problem, background.train, columns[:, candidate, 0], target)
            assert solved.coef[part, candidate, 0, target] == pytest.approx(coef, rel=1e-7)
            assert solved.gain[part, candidate, target] == pytest.approx(gain, rel=1e-7)


def test_what_the_library_leaves_of_rows_that_it_has_not_seen(problem):
    # Rows next to those of a fold are used for nothing, and one mode is never in one training.
    gap = [np.flatnonzero((np.arange(N_ROWS) > 60) & (problem.modes == 0)), np.arange(50)]
    folds = replace(problem.folds, parts=[*problem.folds.parts, tuple(gap)])
    problem = replace(problem, folds=folds)
    columns = np.random.default_rng(1).standard_normal((N_ROWS, 4, 2))
    backgrounds = [problem.background(fold) for fold in (*range(6), None)]
    equations, values = SharedSums(backgrounds).normal_equations(columns), np.array([1, 3])
    assert len(equations.parts) == 2  # laws of other terms: each state has a library of its own
    for part, (_, rows) in enumerate(folds.parts):
        features, modes = problem.features[rows], problem.modes[rows]
        for (target,), own in equations.parts:
            left = own.residuals(columns[rows][:, values], features, modes, part, values)
            alone = backgrounds[part].residuals(columns[:, values], rows, target)
            np.testing.assert_allclose(left, alone, atol=1e-9)


def test_a_candidate_that_the_library_spans_gains_nothing(problem):
    spanned = problem.features[:, [0]] @ [[1.0, 2.0]] + problem.features[:, [1]]
    equations = problem.background(None).normal_equations(spanned[:, :, None])
    assert equations.spanned.all()
    assert np.all(equations.solve(None).gain == 0.0)


def test_columns_of_a_recording_on_some_rows_are_those_of_all():
    data = make_undeclared("coulomb_friction", system="pendulum", n_samples=800, random_state=0)
    noise = 0.01 * np.random.default_rng(0).standard_normal(data.X.shape) * [1.0, 1.0, 0.0]
    recorded = make_records(data.X + noise, 2, t=data.t, groups=data.groups, names=["q", "v", "u"])
    measured = from_states(declared_model(data.estimator, recorded), recorded)
    records, columns = measured.records, np.sin(3.0 * measured.records.X)
    every = records.averaged(columns)
    assert not np.allclose(every, columns)  # the filter shows means
    for rows in (measured.rows, np.array([5, 0, 700]), measured.rows):
        np.testing.assert_allclose(records.averaged(columns, rows), every[rows], rtol=1e-12)
