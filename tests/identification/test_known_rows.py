"""Rows with velocities, and laws of which something is known."""

import cvxpy as cp
import numpy as np
import pandas as pd
import pytest
from many_rows import take_for_many
from sklearn.base import clone

from swsysid import Known, SwitchingSystemRegressor
from swsysid._losses import LOSSES, get_loss
from swsysid._losses.within import Block, least_within
from swsysid.relaxations._base import one_hot

COEF = np.array([[[0.0, 1.0, 0.0], [-1.0, -0.1, 0.5]], [[0.0, 1.0, 0.0], [-4.0, -0.1, 0.5]]])


def rows(n_samples=300, noise=0.3, seed=0):
    rng = np.random.default_rng(seed)
    X = rng.uniform(-2, 2, (n_samples, 3))
    modes = (X[:, 0] > 0).astype(int)
    Xdot = np.einsum("isf,if->is", COEF[modes], X) + noise * rng.standard_normal((n_samples, 2))
    return pd.DataFrame(X, columns=["x", "v", "u"]), Xdot, modes


KNOWN = Known.from_text(
    ["x' = v", "v'[v] same in all modes", "v'[x] + v'[u] <= -0.6", "v'[u] >= 0.55"]
)


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("soft", [False, True], ids=["hard", "soft"])
def test_vector_fields_are_those_of_another_solver(loss, soft):
    X, Xdot, modes = rows(80)
    weight = np.random.default_rng(1).uniform(0.5, 2.0, 80)
    features = X.to_numpy()
    membership = one_hot(modes, 2)
    if soft:
        membership = 0.8 * membership + 0.1
    region = KNOWN.region(["x", "v"], ["x", "v", "u"], 2)
    coef = cp.Variable(12)
    design = (membership[:, :, None] * features[:, None, :]).reshape(80, 6)
    residuals = cp.vstack([
        Xdot[:, s] - design @ cp.hstack([coef[m * 6 + s * 3 : m * 6 + s * 3 + 3] for m in (0, 1)])
        for s in (0, 1)
    ]).T  # fmt: skip
    matrix, equal = region.matrix.reshape(-1, 12), region.equal
    constraints = [
        matrix[equal] @ coef == region.lower[equal],
        matrix[~equal] @ coef <= np.minimum(region.upper[~equal], 1e9),
        matrix[~equal] @ coef >= np.maximum(region.lower[~equal], -1e9),
    ]
    objective = weight @ get_loss(loss).expression(cp, residuals)
    other = cp.Problem(cp.Minimize(objective), constraints).solve(solver="CLARABEL")
    places = np.arange(12).reshape(2, 2, 3)
    blocks = [
        Block(design[own][:, columns], Xdot[own, s], weight[own], own, places[each, s].ravel())
        for each, own, columns in (
            [([0, 1], np.arange(80), np.arange(6))] if soft else
            [([m], np.flatnonzero(modes == m), np.arange(3 * m, 3 * m + 3)) for m in (0, 1)]
        )
        for s in (0, 1)
    ]  # fmt: skip
    start = np.zeros((2, 2, 3))
    steps = region.steps(start, np.ones(start.shape, bool))
    found = least_within(loss, blocks, steps)
    near = least_within(loss, blocks, steps, found + 0.1)  # a start changes no least
    np.testing.assert_allclose(near, found, atol=1e-6)
    found = found.reshape(start.shape)
    left = Xdot - np.einsum("im,msf,if->is", membership, found, features)
    # Clarabel is 1e-8 off, Weiszfeld's turns 1e-9
    assert weight @ get_loss(loss).values(left) == pytest.approx(other, rel=1e-6)
    values = np.einsum("rmsf,msf->r", region.matrix, found)
    assert (values <= region.upper + 1e-7).all() and (values >= region.lower - 1e-7).all()


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("sparsity", [None, "auto"])
def test_laws_are_as_known_and_closer_to_the_truth(loss, sparsity):
    X, Xdot, _ = rows()
    model = SwitchingSystemRegressor(loss=loss, sparsity=sparsity, random_state=0)
    known = ["x' = v", "v'[v] same in all modes", "v'[u] = 0.5"]
    found = clone(model).set_params(known=known).fit(X, Xdot).coef_
    np.testing.assert_array_equal(found[:, 0], COEF[:, 0])
    np.testing.assert_array_equal(found[:, 1, 2], 0.5)
    assert found[0, 1, 1] == pytest.approx(found[1, 1, 1], abs=1e-9)


def test_laws_are_closer_to_the_truth():
    off = []
    for seed in range(8):
        X, Xdot, _ = rows(seed=seed)
        model = SwitchingSystemRegressor(random_state=0)
        tied = clone(model).set_params(known=Known().tie("v'", "v"))
        off.append(
            [np.square(one.fit(X, Xdot).coef_[:, 1, 1] + 0.1).sum() for one in (tied, model)]
        )
    tied, free = np.mean(off, axis=0)
    assert tied < 0.75 * free  # 0.5 is expected of two modes that are alike


def test_the_paper_recipe_and_a_number_of_modes_that_is_sought():
    X, Xdot, _ = rows(noise=0.01)
    known = Known().equal("x' = v").tie("v'", "u")
    paper = SwitchingSystemRegressor(relaxation="simplex", coupling=0, known=known, random_state=0)
    counted = SwitchingSystemRegressor("auto", known=known, random_state=0)
    for model in (paper, counted):
        coef = model.fit(X, Xdot).coef_
        assert len(coef) == 2
        np.testing.assert_allclose(sorted(coef[:, 1, 0]), [-4.0, -1.0], atol=0.02)
        assert coef[0, 1, 2] == pytest.approx(coef[1, 1, 2], abs=1e-9)


def test_terms_that_are_joined_stay_or_go_together():
    region = Known.from_text(["v'[x] = w'[x]", "v'[v] = 0"]).region(["v", "w"], ["x", "v"], 1)
    support = np.array([[[True, True], [False, True]]])
    np.testing.assert_array_equal(region.closed(support), [[[True, False], [True, True]]])


def test_what_makes_no_sense_is_refused():
    X, Xdot, _ = rows()
    with pytest.raises(ValueError, match="the terms are x, v, u"):
        SwitchingSystemRegressor(known="v' has no w").fit(X, Xdot)
    with pytest.raises(ValueError, match="exclude each other"):
        SwitchingSystemRegressor(known="x' = v", coef_bound=3.0).fit(X, Xdot)
    with pytest.raises(ValueError, match="leaves modes nothing to differ in"):
        SwitchingSystemRegressor(known=["x' = v", "v' same in all modes"]).fit(X, Xdot)


@pytest.mark.parametrize("loss", LOSSES)
def test_passes_over_blocks_end_where_another_solver_does(loss, monkeypatch):
    take_for_many(monkeypatch)
    X, Xdot, _ = rows(4000)
    known = [one.replace("x", "x0").replace("v", "x1").replace("u", "x2") for one in KNOWN]
    cuts = np.split(X.to_numpy(), 4), np.split(Xdot, 4)
    model = SwitchingSystemRegressor(loss=loss, known=known, random_state=0).fit(*cuts)
    coef = [cp.Variable((2, 3)) for _ in model.coef_]
    rules = [coef[0][1, 1] == coef[1][1, 1]]
    for one in coef:
        rules += [one[0] == [0, 1, 0], one[1, 0] + one[1, 2] <= -0.6, one[1, 2] >= 0.55]
    own = [model.modes_ == k for k in range(2)]
    left = [Xdot[rows] - X.to_numpy()[rows] @ one.T for rows, one in zip(own, coef, strict=True)]
    value = sum(cp.sum(get_loss(loss).expression(cp, one)) for one in left)
    least = cp.Problem(cp.Minimize(value), rules).solve(solver="CLARABEL")
    # Clarabel is 1e-8 off, Weiszfeld's turns 1e-9; norms beyond what passes keep are quadratic
    assert model.objective_ == pytest.approx(least, rel=1e-6)
    np.testing.assert_array_equal(model.coef_[:, 0], COEF[:, 0])
    assert (model.coef_[:, 1, 2] >= 0.55 - 1e-9).all()


def test_rows_may_be_many():
    X, Xdot, modes = rows(60_000)
    known = ["x' = v", "v'[v] same in all modes", "v'[u] = 0.5", "guard x >= 0"]
    found = SwitchingSystemRegressor(known=known, random_state=0).fit(X, Xdot)
    assert np.mean(found.modes_ == modes) in (0.0, 1.0)
    coef = found.coef_[np.argsort(-found.coef_[:, 1, 0])]
    np.testing.assert_array_equal(coef[:, 0], COEF[:, 0])
    assert coef[0, 1, 1] == pytest.approx(coef[1, 1, 1], abs=1e-9)
    # 0.3 / sqrt(20,000) of noise, four standard errors
    np.testing.assert_allclose(coef[:, 1], COEF[:, 1], atol=0.009)
    passes = SwitchingSystemRegressor(known="guard x >= 0", random_state=0).fit(X, Xdot)
    assert (passes.surface_.coef_[:, [0, 2, 3]] == 0.0).all()
    assert np.mean(passes.modes_ == modes) in (0.0, 1.0)
