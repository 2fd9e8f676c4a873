"""Sensors that are late, and whose samples a velocity is made of: a turning point by hand."""

from dataclasses import replace

import numpy as np
import pytest
from effect_fits import fit_by_hand

from swsysid import SwitchingSystemRegressor
from swsysid._data.records import make_records
from swsysid._effect_model.joint_fit import fit_jointly
from swsysid._effect_model.models import declared_model
from swsysid._effect_model.velocities import as_shown, as_they_were
from swsysid.effects import ClockLag, PlacedEffect

TURNING = [[[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]]  # x' = y, y' = -x
LATE = 0.13
T = np.linspace(0.0, 5.0, 101)
INSIDE = slice(10, -10)  # where the late sensor has read all that is asked for
# x is recorded late, and so is the velocity that is made of what was recorded
RECORDED = np.column_stack([np.sin(T - LATE), np.cos(T)])
VELOCITIES = np.column_stack([np.cos(T - LATE), -np.sin(T)])
ON_TIME = np.column_stack([np.cos(T), -np.sin(T)])


def late_sensor(same_sensor):
    return PlacedEffect(ClockLag(same_sensor=same_sensor), 0, 0, theta=(LATE,))


def records():
    return make_records(RECORDED, 2, t=T, names=["x", "y"])


@pytest.mark.parametrize(("same_sensor", "expected"), [(True, VELOCITIES), (False, ON_TIME)])
def test_a_velocity_is_late_where_it_is_made_of_late_samples(same_sensor, expected):
    fit = fit_by_hand(TURNING, [late_sensor(same_sensor)], [[]])
    predicted = fit.predict(records())
    # Akima's interpolation between samples a twentieth apart
    np.testing.assert_allclose(predicted[INSIDE], expected[INSIDE], atol=1e-4)


def test_targets_are_brought_to_the_time_of_the_others():
    rows = np.arange(len(T))[INSIDE]
    fit = fit_by_hand(TURNING, [late_sensor(True)], [[]])
    own = replace(fit, modes=np.zeros(len(rows), dtype=np.intp))
    moved = own.on_time(records(), rows, VELOCITIES[rows])
    np.testing.assert_allclose(moved, ON_TIME[rows], atol=1e-4)
    np.testing.assert_array_equal(moved[:, 1], VELOCITIES[rows][:, 1])


def test_laws_of_a_late_record_are_those_of_the_plant():
    rows, seen = np.arange(len(T))[INSIDE], records()
    declared = declared_model(SwitchingSystemRegressor(n_modes=1, random_state=0), seen)
    fit = fit_jointly(declared.with_modes(1), [late_sensor(True)], seen, rows, VELOCITIES[rows])
    np.testing.assert_allclose(fit.residuals(seen, rows, VELOCITIES[rows]), 0.0, atol=2e-4)
    states = make_records(np.column_stack([np.sin(T), np.cos(T)]), 2, t=T, names=["x", "y"])
    laws = fit.library(states)[INSIDE] @ fit.laws.coef[0].T
    np.testing.assert_allclose(laws, ON_TIME[INSIDE], atol=1e-3)


def test_modes_that_a_late_velocity_shows_are_those_of_earlier_instants():
    modes = np.repeat([0, 1, 0], [30, 40, 31])  # of the states, a twentieth apart
    shown = as_shown(late_sensor(True), records(), modes)
    # late by 2.6 samples: to the nearest
    assert shown.tolist() == np.repeat([0, 1, 0], [33, 40, 28]).tolist()
    back = as_they_were(late_sensor(True), records(), shown)
    assert back.tolist() == [*modes[:-3], -1, -1, -1]  # of the end nothing has been shown
