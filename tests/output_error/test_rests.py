"""A mass that friction holds most of the time, moved by steps of an input that is on lines."""

from dataclasses import replace

import numpy as np
import pytest

from swsysid._data.records import make_records
from swsysid._output_error.estimate import cost, fitted
from swsysid._output_error.law import Law
from swsysid._output_error.likeness import names_for
from swsysid._output_error.scan import all_candidates
from swsysid._output_error.stretches import Stretches
from swsysid.effects import (
    CoulombFriction,
    Overflow,
    PlacedEffect,
    Polynomial,
    Saturation,
    UnknownFunction,
)

FRICTION, NOISE, STEP = 1.5, 0.002, 0.02
LAW = np.array([[0.0, 1.0, 0.0], [-16.0, -2.0, 10.0]])


def recorded(friction=0.0, contact=0.0, n_rows=1500, seed=0):
    """q'' = -16 q - 2 q' + 10 u - friction sign(q') - contact max(q - .2, 0), from rest to rest."""
    rng, fine = np.random.default_rng(seed), 20
    u = np.repeat(rng.uniform(-1.0, 1.0, n_rows // 100), 100)
    q, state, h = np.empty(n_rows), np.zeros(2), STEP / fine
    for k in range(n_rows):
        q[k] = state[0]
        for part in range(fine):
            # between two rows the input is on a line, as it is taken to be
            pushed = u[k] + part / fine * (u[min(k + 1, n_rows - 1)] - u[k])
            force = LAW[1] @ [*state, pushed] - contact * max(state[0] - 0.2, 0.0)
            if state[1] == 0.0 and abs(force) <= friction:
                continue
            side = np.sign(state[1]) or np.sign(force)
            speed = state[1] + h * (force - friction * side)
            state = np.array([state[0] + h * speed, 0.0 if speed * state[1] < 0.0 else speed])
    return q + NOISE * rng.standard_normal(n_rows), u


def stretches_of(q, u):
    columns = np.column_stack([q, np.gradient(q, STEP), u])
    records = make_records(columns, 2, t=STEP * np.arange(len(q)), names=["q", "v", "u"])
    records = replace(records, n_hidden=1)
    return replace(Stretches.of(records, records, np.arange(len(q))), disturbance=0.1)


def declared():
    """v' = a q + b v + c u, with q' = v known."""
    sought = np.array([[False] * 3, [True] * 3])
    return Law.of(lambda X: X, sought, np.where(sought, 0.0, LAW))


def test_a_law_that_sticks_is_fitted_from_where_it_was_measured():
    """Steps of all nodes, loosely tied at first, ended at 38 times the noise here."""
    stretches = stretches_of(*recorded(FRICTION))
    moving = np.abs(np.gradient(stretches.records.X[:, 0], STEP)) > 0.2
    assert moving.mean() < 0.5
    fit = fitted(declared().beside([PlacedEffect(CoulombFriction(), 1, 1)]), stretches)
    # the standard errors are a thousandth; rests are known to the noise, and steps of 1 ms
    np.testing.assert_allclose(fit.law.coef[1], [*LAW[1], FRICTION], rtol=0.03)
    assert fit.errors == pytest.approx([NOISE], rel=0.3)


def test_a_function_without_a_name_is_asked_which_name_it_looks_like():
    """A spring beyond .2, four times as stiff as the other: an overflow, and where it begins."""
    stretches = stretches_of(*recorded(contact=64.0))
    effects = [Overflow(), Polynomial(), Saturation(), UnknownFunction()]
    listed = all_candidates(effects, stretches.seen, [1])
    fits = [
        fitted(declared().beside([one.placed]), stretches)
        for one in listed
        if one.placed.effect.kind in ("unknown_function", "polynomial")
        and one.placed.place in (0, (0,), (0, 0))
    ]
    first, *others = names_for(fits, listed, stretches, 100.0)
    assert (first.effect.kind, first.place) == ("overflow", 0)
    assert first.theta[0] == pytest.approx(0.2, abs=0.05)  # the next values of the scan
    assert all(one.place == 0 and one.effect.kind != "polynomial" for one in others)
    least = min(fits, key=cost)
    assert least.law.terms[-1].effect.kind == "unknown_function"
    # nothing looks like a name where a name explains as much
    named = fitted(declared().beside([replace(first, theta=(0.2,))]), stretches)
    assert names_for([*fits, named], listed, stretches, 100.0) == []
