"""Free rollouts side by side are those of a simulation that locates its events."""

import numpy as np
import pytest

from benchmarks.trajectories.plants import PLANTS
from benchmarks.trajectories.recordings import Scenario, record
from swsysid import SwitchingSystemRegressor, TrajectoryIdentifier
from swsysid._data.recordings import Record
from swsysid._free_rollouts.courses import Course
from swsysid._stays import rollouts
from swsysid._stays.free import FreeRuns
from swsysid._stays.guards import Guards
from swsysid._stays.origin import Origin
from swsysid._stays.polynomial_laws import laws_of
from swsysid._stays.recordings import Recordings


def side_by_side(name, offset, guess=()):
    """Rollouts of true laws from true starts, columns counted from an offset, and the truth's."""
    plant = PLANTS[name]
    campaign, truth = record(plant, Scenario(0.0, 60, 3), 5), plant.truth()
    spread = campaign.columns.std(axis=0)
    n = campaign.states.shape[1]
    laws = laws_of(truth.coef_, truth.feature_map, spread[:n], np.zeros(truth.coef_.shape, bool))
    origin = Origin(offset * np.ones(campaign.columns.shape[1]))
    courses = []
    for label in np.unique(campaign.groups):
        rows = campaign.groups == label
        u = np.empty((rows.sum(), 0)) if campaign.inputs is None else campaign.inputs[rows]
        x = campaign.states[rows] + offset
        courses.append(Course(f"{label}", Record(campaign.t[rows], x, u + offset), x[0]))
    guards = Guards.of(truth.surface, spread, plant.n_modes)
    records = [one.record for one in courses]
    grid = Recordings.of(records, [one.y for one in records])  # half a sample at a time
    runs = FreeRuns(laws, guards, origin, grid, courses, guess)
    return [runs(one, one.start, np.ones(n)) for one in courses], campaign, truth


@pytest.mark.parametrize("offset", [0.0, 100.0])
@pytest.mark.parametrize(
    "name", ["contact", "dry friction, forced", "backlash, three modes", "switched by the input"]
)
def test_states_and_events_are_those_of_the_simulation(name, offset):
    found, campaign, truth = side_by_side(name, offset)
    spread = campaign.states.std(axis=0)
    for label, run in enumerate(found):
        rows = campaign.groups == label
        states, t = campaign.states[rows], campaign.t[rows]
        inputs = None if campaign.inputs is None else campaign.inputs[rows]
        expected = truth.simulate(states[0], t, inputs, input_hold="linear")
        assert run.status.ok
        # steps of a hundred and twentieth of a period, and events to a thousandth of a step
        np.testing.assert_allclose(run.x - offset, states, atol=2e-3 * spread.max())
        told = [(one.kind, one.before, one.after) for one in run.events if one.kind != "leaving"]
        known = [
            (one.kind.replace("input", "crossing"), one.before, one.after)
            for one in expected.events
            if one.kind != "leaving"
        ]
        assert told == known


@pytest.mark.parametrize("name", ["contact", "dry friction, forced", "switched by the input"])
def test_steps_of_a_rollout_that_are_worked_at_once_meet(name, monkeypatch):
    whole, campaign, _ = side_by_side(name, 0.0)
    spread, rng = campaign.states.std(axis=0), np.random.default_rng(0)
    guess = [run.x + 0.01 * spread * rng.standard_normal(run.x.shape) for run in whole]
    used, at_once = [], rollouts.at_once
    monkeypatch.setattr(rollouts, "at_once", lambda *args: used.append(at_once(*args)) or used[-1])
    found, _, _ = side_by_side(name, 0.0, guess)
    assert used[0] is not None
    for run, expected in zip(found, whole, strict=True):
        np.testing.assert_allclose(run.x, expected.x, atol=1e-6 * spread.max())
        np.testing.assert_array_equal(run.modes, expected.modes)
        assert [one.kind for one in run.events] == [one.kind for one in expected.events]


def test_long_recordings_in_steps_shorter_than_their_samples_are_rolled_out_at_once():
    turn, step, n = 2.0, 0.6, 700  # ten samples a turn
    t = step * np.arange(n)
    x = np.exp(-0.02 * t)[:, None] * np.column_stack([np.cos(turn * t), -np.sin(turn * t)])
    noisy = x + 0.002 * np.random.default_rng(0).standard_normal(x.shape)
    estimator = SwitchingSystemRegressor(1, feature_library=1, random_state=0)
    found = TrajectoryIdentifier(estimator).fit(noisy, t)
    assert found.report_.rollouts.holds
    np.testing.assert_allclose(found.states_, x, atol=0.002)
