"""Visits beyond a surface that are so brief that noise hides them."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.trajectories.figures import figures
from benchmarks.trajectories.methods import METHODS
from benchmarks.trajectories.plants import PLANTS
from benchmarks.trajectories.recordings import Scenario, record
from swsysid._data.recordings import Record
from swsysid._stays.guards import Guards
from swsysid._stays.laws import Laws
from swsysid._stays.lifted import Estimate
from swsysid._stays.nodes import Nodes
from swsysid._stays.recordings import Recordings
from swsysid._stays.retold import Turns, with_visits, without_visits
from swsysid._stays.stays import Stays

NEAR, BEYOND_SLIDE, NOISE = 2.0, 0.2, np.full(2, 0.01)


def affine(columns):
    return np.column_stack([np.ones(len(columns)), columns])


def turning(stays, surface):
    """x = cos t, which turns at pi; both modes have the same law, with a surface at x = surface."""
    t = np.linspace(1.0, 5.0, 41)
    x = np.column_stack([np.cos(t), -np.sin(t)])
    coef = np.tile([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0]], (2, 1, 1))
    laws = Laws(coef, affine, np.ones(2), np.ones(coef.shape, dtype=bool))
    recordings = Recordings.of([Record(t, x, np.empty((len(t), 0)))])
    guards = Guards(
        np.array([[-surface, 1.0, 0.0]]),
        affine,
        np.ones(2),
        np.array([[1], [-1]]),
        np.array([[True, False, True]]),
    )
    return Estimate(laws, Nodes(recordings, [stays]), x, guards)


def test_a_turn_near_the_surface_may_be_a_visit():
    estimate = turning(Stays(np.array([0]), np.zeros(0)), surface=-1.005)
    (visit,) = Turns(estimate, NOISE, BEYOND_SLIDE).missed(NEAR)
    # it turns half a deviation before the surface, at a sample within .05 of pi
    assert visit.distance == pytest.approx(0.5, abs=0.15)
    assert (visit.recording, visit.mode) == (0, 1)
    # within a deviation of its turn: 1 - cos(.14) = .01
    assert visit.begin == pytest.approx(np.pi - 0.14, abs=0.06)
    assert visit.end == pytest.approx(np.pi + 0.14, abs=0.06)
    (stays,) = with_visits(estimate, [visit]).nodes.stays
    assert stays.modes.tolist() == [0, 1, 0]
    assert stays.instants.tolist() == [visit.begin, visit.end]


def test_a_turn_far_from_the_surface_is_none():
    estimate = turning(Stays(np.array([0]), np.zeros(0)), surface=-1.03)
    assert Turns(estimate, NOISE, BEYOND_SLIDE).missed(NEAR) == []


def test_a_brief_visit_may_be_none():
    half = np.arccos(0.995)
    estimate = turning(Stays(np.array([0, 1, 0]), np.pi + np.array([-half, half])), surface=-0.995)
    turns = Turns(estimate, NOISE, BEYOND_SLIDE)
    (visit,) = turns.made(NEAR)
    assert visit.distance == pytest.approx(0.5, abs=0.15) and visit.mode == 1
    assert turns.made(0.2) == [] and turns.missed(NEAR) == []
    (stays,) = without_visits(estimate, [visit]).nodes.stays
    assert stays.modes.tolist() == [0] and not stays.instants.size


def test_a_recording_may_begin_and_end_beyond_the_surface():
    estimate = turning(Stays(np.array([0]), np.zeros(0)), surface=-1.5)
    surface = replace(estimate.guards, coef=np.array([[0.555, -1.0, 0.0]]))  # at x = .555
    estimate = replace(estimate, guards=surface)  # x falls from .54
    begins = [visit for visit in Turns(estimate, NOISE, BEYOND_SLIDE).missed(NEAR)]
    assert [visit.begin for visit in begins] == [-np.inf]
    (stays,) = with_visits(estimate, begins).nodes.stays
    assert stays.modes.tolist() == [1, 0] and stays.instants.tolist() == [begins[0].end]
    (again,) = without_visits(with_visits(estimate, begins), begins).nodes.stays
    assert again.modes.tolist() == [0]


@pytest.mark.nightly
def test_positions_tell_a_bumper_that_is_hardly_touched():
    plant = PLANTS["positions only"]
    campaign = record(plant, Scenario(0.01, 60, 12), 100)  # recording 8 touches it for .25 s
    ours = figures(plant, METHODS["recordings"](plant, campaign, 100))
    oracle = figures(plant, METHODS["oracle"](plant, campaign, 100))
    assert ours["field"] <= 1.3 * oracle["field"]
    assert ours["balanced"] >= oracle["balanced"] - 0.01
