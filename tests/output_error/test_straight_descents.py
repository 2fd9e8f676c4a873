"""From where a nearly equal law has led nodes are not let go again, unless that gets stuck."""

import numpy as np
import pytest

from swsysid._data.records import make_records
from swsysid._output_error import estimate
from swsysid._output_error.estimate import fitted
from swsysid._output_error.law import Law
from swsysid._output_error.stretches import Stretches
from swsysid._stays.lifted import Objective
from swsysid.effects import PlacedEffect, QuadraticDrag


@pytest.fixture(scope="module")
def swings():
    """x' = v, v' = -4 x - .2 v - .1 v |v| from six starts, with noise of a hundredth."""
    rng, t, substeps = np.random.default_rng(0), np.linspace(0.0, 6.0, 121), 20
    h, parts = t[1] / substeps, []
    for start in rng.uniform(0.5, 2.0, 6):
        x, v, rows = start, 0.0, []
        for _ in t:
            rows.append((x, v))
            for _ in range(substeps):  # symplectic steps, whose error is below the noise
                v += h * (-4.0 * x - 0.2 * v - 0.1 * v * abs(v))
                x += h * v
        parts.append(np.array(rows) + 0.01 * rng.standard_normal((len(t), 2)))
    groups = np.repeat(np.arange(6), len(t))
    records = make_records(np.vstack(parts), 2, t=np.tile(t, 6), groups=groups, names=["x", "v"])
    stretches = Stretches.of(records, records, np.arange(len(records)))
    declared = np.array([[False, False], [True, True]])
    law = Law.of(lambda X: X[:, :2], declared, np.array([[0.0, 1.0], [0.0, 0.0]]))
    return stretches, fitted(law, stretches)


def asked(monkeypatch):
    """How often equations of a descent are made."""
    counts, made = [], Objective.normal_equations

    def counted(self, one):
        counts.append(self.tie)
        return made(self, one)

    monkeypatch.setattr(Objective, "normal_equations", counted)
    return counts


def test_it_ends_where_nodes_that_are_let_go_end_in_fewer_turns(swings, monkeypatch):
    stretches, fit = swings
    wider = fit.law.beside([PlacedEffect(QuadraticDrag(), 1, 1)])
    counts = asked(monkeypatch)
    near = fitted(wider, stretches, fit.courses, fit.noise, turns=1)
    n_near = len(counts)
    assert len(set(counts)) == 1  # all of them with nodes tied tightly
    monkeypatch.setattr(estimate, "straight_to", lambda *_: None)
    counts.clear()
    let_go = fitted(wider, stretches, fit.courses, fit.noise, turns=1)
    assert len(set(counts)) == 2 and n_near < len(counts)
    # a thousandth of the squares may stay, a twentieth of them is worth telling
    assert np.sum(near.left**2) == pytest.approx(np.sum(let_go.left**2), rel=2e-3)
    errors = np.sqrt(np.diag(let_go.reached.covariance.of_laws))
    gaps = np.abs(near.law.coef - let_go.law.coef)[let_go.law.free]
    assert (gaps < 0.5 * errors).all()


def test_the_last_turns_of_a_fit_leave_no_trifle(swings):
    """A step from where it ends promises next to nothing."""
    _, fit = swings
    equations = fit.reached.objective.normal_equations(fit.reached.estimate)
    _, promised = equations.step(estimate.STAYS.damping)
    assert promised < estimate.STAYS.nearly_converged < 1e-3 * equations.value
