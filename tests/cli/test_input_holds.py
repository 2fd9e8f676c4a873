"""Inputs that keep their value until the next row, in a table of complete rows."""

import numpy as np
import pytest

from swsysid._cli.job import run_job
from swsysid._cli.measurement import Measurement
from swsysid._cli.options import JobOptions
from swsysid._tables.table import Table
from tests.stays.test_input_steps import DECAY, GAIN, command


def job(hold=None):
    t, x, u = command()
    table = Table("log", {"t": t, "x": x[:, 0], "u": u[:, 0]}, {})
    what = Measurement(states=("x",), inputs=("u",), time="t", hold=hold)
    return run_job(table, JobOptions(measurement=what, modes=1))


def test_a_command_is_held_where_laws_are_fitted_and_where_they_are_judged():
    done = job()
    assert "u keeps its value until the next row." in done.found.identifier.report_.doubts
    coef, errors = done.found.identifier.estimator_.coef_, done.found.identifier.coef_errors_
    assert (np.abs(coef - [0.0, -DECAY, GAIN]) <= 2.0 * errors).all()
    unseen = done.found.verdict.free_of_held_out
    assert unseen.holds and unseen.left[0] <= 1.2
    assert len(done.modes) == len(done.samples.X)


def test_what_is_said_to_hold_is_held_and_not_asked(monkeypatch):
    found = job().model.coef_
    monkeypatch.setattr("swsysid._stays.search.Search.begun", lambda *_: pytest.fail("was asked"))
    done = job(hold=("u",))
    np.testing.assert_array_equal(done.model.coef_, found)


@pytest.mark.nightly
def test_a_heater_of_a_plant_with_two_laws_is_held():
    """T' = 6 heater - (T - 20) / 20, and .15 (T - 60) less above 60; exact from row to row."""
    rng, rows = np.random.default_rng(3), []
    for run, start in enumerate((25.0, 80.0, 50.0)):
        temperature = start
        for k in range(600):
            heater = float((k // 100 + run) % 2)
            rows.append((run, 0.1 * k, temperature, heater))
            for _ in range(50):
                loss = 0.05 * (temperature - 20.0) + 0.15 * max(0.0, temperature - 60.0)
                temperature += 0.002 * (6.0 * heater - loss)
    run, t, x, u = np.array(rows).T
    seen = x + 0.1 * rng.standard_normal(len(x))
    table = Table("log", {"run": run, "t": t, "T": seen, "u": u}, {})
    what = Measurement(states=("T",), inputs=("u",), time="t", groups="run")
    found = run_job(table, JobOptions(measurement=what, modes=2)).found
    assert "u keeps its value until the next row." in found.identifier.report_.doubts
    coef, errors = found.identifier.estimator_.coef_[:, 0], found.identifier.coef_errors_[:, 0]
    order = np.argsort(coef[:, 1])
    truth = [[10.0, -0.2, 6.0], [1.0, -0.05, 6.0]]
    assert (np.abs(coef[order] - truth) <= 3.0 * errors[order]).all()
