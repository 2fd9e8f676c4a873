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
