"""Slides along a surface as modes of their own: a block that rests until a ramp moves it."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from benchmarks.trajectories.figures import figures
from benchmarks.trajectories.methods import METHODS, identified
from benchmarks.trajectories.plants import PLANTS
from benchmarks.trajectories.recordings import Scenario, record
from swsysid._data.features import FeatureMap
from swsysid._data.recordings import Record
from swsysid._stays.assign import assign, disturbances, prior_of_guards
from swsysid._stays.flow import crossings_of, ends_of, steady_legs, switching
from swsysid._stays.guards import Guards
from swsysid._stays.laws import Laws
from swsysid._stays.lifted import Estimate
from swsysid._stays.nodes import Nodes
from swsysid._stays.polynomial_laws import laws_of
from swsysid._stays.recordings import Recordings
from swsysid._stays.samples import modes_of
from swsysid._stays.settings import SETTINGS
from swsysid._stays.sliding import SlidingLaws, pairs_of, slides_there, with_slides
from swsysid._stays.stays import Stays
from swsysid._stays.walk import walk_of
from swsysid.refinement._trajectories import read_trajectories

FRICTION, RAMP = 0.4, 0.2
# v = .2 - .4 t + .1 t^2 until it is zero; the force exceeds the friction at t = 2
RESTS, MOVES = 2.0 - np.sqrt(2.0), 2.0


def affine(columns):
    return np.column_stack([np.ones(len(columns)), columns])


def block():
    """A block with dry friction: its laws, and the surface v = 0 with every coefficient free."""
    coef = np.array([
        [[0.0, 0.0, 1.0, 0.0], [FRICTION, 0.0, 0.0, 1.0]],
        [[0.0, 0.0, 1.0, 0.0], [-FRICTION, 0.0, 0.0, 1.0]],
    ])  # fmt: skip
    laws = Laws(coef, affine, np.ones(2), np.ones(coef.shape, dtype=bool))
    surface, book = np.array([[0.0, 0.0, 1.0, 0.0]]), np.array([[-1], [1]])
    free = np.array([[True, True, False, True]])
    return SlidingLaws.of(laws, Guards(surface, affine, np.ones(3), book, free))


def truth(t):
    """Position and speed of the block that starts at 0 with .2."""
    braked = np.minimum(t, RESTS)
    x = 0.2 * braked - 0.2 * braked**2 + 0.1 * braked**3 / 3.0
    v = 0.2 - 0.4 * braked + 0.1 * braked**2
    pushed = np.maximum(t - MOVES, 0.0)
    return np.column_stack([x + 0.1 * pushed**3 / 3.0, v + 0.1 * pushed**2])


def ramp(n_times=31, noise=0.0):
    t = np.linspace(0.0, 3.0, n_times)
    x = truth(t)
    y = x + noise * np.random.default_rng(0).standard_normal(x.shape)
    return Recordings.of([Record(t, y, RAMP * t[:, None])], [x])


def test_a_block_that_rests_has_no_velocity_and_the_forces_share_it():
    laws = block()
    slide, x, u = np.array([2]), np.array([[1.0, 0.0]]), np.array([[0.1]])
    slope = np.array([[RAMP]])
    np.testing.assert_array_equal(laws.velocities(slide, x, u, slope), 0.0)
    both = [laws.velocities(np.array([mode]), x, u) for mode in (0, 1)]
    share = laws.slide(slide, *both, x, u, slope).share
    np.testing.assert_allclose(share, (0.1 + FRICTION) / (2.0 * FRICTION), rtol=1e-6)
    assert laws.larger(slide, x, u, slope).tolist() == [1]
    # beyond the friction one law goes on alone
    np.testing.assert_allclose(
        laws.velocities(slide, x, np.array([[0.5]]), slope), [[0.0, 0.1]], atol=1e-12
    )


def test_a_moving_surface_carries_what_slides_along_it():
    laws = block()
    guards = replace(laws.guards, coef=np.array([[0.0, 0.0, 1.0, -1.0]]))  # v = u
    velocity = SlidingLaws.of(laws, guards).velocities(
        np.array([2]), np.array([[0.0, 0.1]]), np.array([[0.1]]), np.array([[RAMP]])
    )
    np.testing.assert_allclose(velocity, [[0.1, RAMP]], rtol=1e-6)


def test_a_rollout_rests_until_the_force_exceeds_the_friction():
    recordings, laws = ramp(), block()
    nodes = Nodes(recordings, [Stays(np.array([1, 2, 1]), np.array([RESTS, MOVES]))])
    states = truth(recordings.times[0])
    # polynomials of third degree are integrated exactly
    np.testing.assert_allclose(ends_of(laws, nodes, states), states[1:], atol=1e-12)
    # it begins to rest on its surface; where it ends to, no surface is crossed
    crossings = crossings_of(laws, nodes, states)
    assert (crossings.old.tolist(), crossings.new.tolist()) == ([0, 0], [1, 0])


def test_a_slide_of_affine_laws_is_as_exact_as_they_are():
    """Along v = 0 the speed of x is a ratio of polynomials of x; SciPy's solver follows it."""
    columns = np.random.default_rng(0).normal(size=(20, 2))
    coef = np.array([[[0.5, 1.0, 0.0], [1.0, 0.8, 0.0]], [[-1.0, 0.3, 0.0], [-1.0, -0.2, 0.0]]])
    affine_laws = laws_of(
        coef, FeatureMap(1, columns, ["x", "v"]), np.ones(2), np.ones(coef.shape, dtype=bool)
    )
    guards = Guards(
        np.array([[0.0, 0.0, 1.0]]),
        affine,
        np.ones(2),
        np.array([[-1], [1]]),
        np.zeros((1, 3), bool),
    )

    def speed(t, x):
        (up, down), (own, other) = (coef[:, row, 0] + coef[:, row, 1] * x[0] for row in (1, 0))
        return [(up * other - down * own) / (up - down)]

    true = solve_ivp(speed, (0.0, 0.8), [0.3], rtol=1e-12, atol=1e-14).y[0, -1]
    none, slide, duration = np.zeros((1, 0)), np.array([2]), np.array([0.8])
    errors, unknowns = [], affine_laws.n_free
    for laws in affine_laws.sharper:
        sliding, x = SlidingLaws.of(laws, guards), np.array([[0.3, 0.0]])
        end = sliding.step(slide, x, none, none, duration)
        varied = sliding.varied_step(slide, x, np.zeros((1, 2, 2 + unknowns)), none, none, duration)
        np.testing.assert_allclose(varied[0], end, rtol=1e-12)
        errors.append(abs(end[0, 0] - true))
    # of order 4 in one, two and three parts of a step
    assert errors[1] < errors[0] / 12.0 and errors[2] < errors[0] / 50.0


def test_sensitivities_are_those_of_differences():
    recordings, laws = ramp(), block()
    rng = np.random.default_rng(1)
    surface = laws.guards.coef + np.array([[0.03, 0.1, 0.0, -0.2]])
    laws = replace(
        laws,
        coef=laws.coef + rng.normal(0.0, 0.02, laws.coef.shape),
        guards=replace(laws.guards, coef=surface),
    )
    nodes = Nodes(recordings, [Stays(np.array([1, 2, 1]), np.array([0.53, 1.94]))])
    states = truth(recordings.times[0]) + rng.normal(0.0, 0.01, (len(nodes), 2))
    switches = switching(laws, nodes, states)
    for legs in [*steady_legs(laws, nodes, states), switches.legs]:
        for state in range(2):
            move = 1e-5 * np.eye(2)[state]
            ahead, behind = (ends_of(laws, nodes, states + sign * move) for sign in (1, -1))
            slope = ((ahead - behind) / 2e-5)[legs.rows]
            np.testing.assert_allclose(legs.by_state[state].T, slope, rtol=1e-4, atol=1e-5)
        for place, column in enumerate(legs.columns):
            ahead, behind = (
                ends_of(with_unknown(laws, column, size), nodes, states) for size in (1e-5, -1e-5)
            )
            # gradients of the surface are one-sided differences
            slope = ((ahead - behind) / 2e-5)[legs.rows]
            np.testing.assert_allclose(legs.by_law[place].T, slope, rtol=1e-4, atol=1e-5)
    ahead, behind = (
        ends_of(laws, nodes.moved(nodes.instants + size), states) for size in (1e-5, -1e-5)
    )
    slope = ((ahead - behind) / 2e-5)[nodes.at]
    np.testing.assert_allclose(switches.by_instant, slope, rtol=1e-4, atol=1e-5)


def with_unknown(laws, number, size):
    """Laws with one of the coefficients of laws and surface moved."""
    coef, surface = laws.coef.copy(), laws.guards.coef.copy()
    if number < coef.size:
        coef.reshape(-1)[number] += size
    else:
        surface[0, np.array([0, 1, 3])[number - coef.size]] += size
    return replace(laws, coef=coef, guards=replace(laws.guards, coef=surface))


def test_a_rest_is_decoded():
    recordings, laws = ramp(n_times=61, noise=0.005), block()
    noise = np.full(2, 0.005)
    plain = Laws(laws.coef, laws.features, laws.spread, laws.free)
    prior = prior_of_guards(laws.guards, None, recordings, SETTINGS.trust[-1], SETTINGS.blurred)
    candidates = disturbances(plain, recordings, SETTINGS)
    found = assign(
        plain, recordings, noise, prior, candidates, SETTINGS.prices[-1], SETTINGS, laws.guards
    )
    estimate = found.estimate(plain, recordings, None)
    (stays,) = estimate.nodes.stays
    assert stays.modes.tolist() == [1, 2, 1]
    # v falls by .03 in an interval, six deviations of the noise; where it ends to rest it begins
    # to move with the square of time, so that .15 s after it has moved by half a deviation
    assert abs(stays.instants[0] - RESTS) < 0.1
    assert abs(stays.instants[1] - MOVES) < 0.35
    assert modes_of(replace(estimate, guards=laws.guards)).tolist().count(2) > 20


def test_slides_keep_their_modes_when_these_are_renamed():
    assert pairs_of(3).tolist() == [[0, 1], [0, 2], [1, 2]]
    # mode 0 is called 2 from now on, 1 is called 0, 2 is called 1
    assert with_slides(np.array([2, 0, 1])).tolist() == [2, 0, 1, 4, 5, 3]
    laws = block()
    nodes = Nodes(ramp(), [Stays(np.array([1, 2, 1]), np.array([RESTS, MOVES]))])
    plain = Laws(laws.coef, laws.features, laws.spread, laws.free)
    estimate = Estimate(plain, nodes, nodes.y, laws.guards)
    other = estimate.renamed(np.array([1, 0]))
    assert other.nodes.stays[0].modes.tolist() == [0, 2, 0]
    ends = [ends_of(e.motion, e.nodes, e.states) for e in (estimate, other)]
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-14)


def test_beside_a_rest_what_moves_the_states_is_no_walk():
    laws, size = block(), 0.01
    nodes = Nodes(ramp(301, size), [Stays(np.array([1, 2, 1]), np.array([RESTS, MOVES]))])
    plain = Laws(laws.coef, laws.features, laws.spread, laws.free)
    found = walk_of(Estimate(plain, nodes, nodes.y, laws.guards), np.full(2, size), SETTINGS)
    # of 301 samples; a law that went on in place of a rest would move v by .24, its noise .01
    np.testing.assert_allclose(found.sensor, size, rtol=0.15)
    assert (found.walk < 0.1 * size).all()


@pytest.mark.parametrize("name", ["contact", "linear oscillator", "tank with overflow"])
def test_nothing_slides_where_the_laws_do_not_point_at_the_surface(name):
    plant, rng = PLANTS[name], np.random.default_rng(0)
    campaign, truth = record(plant, Scenario(0.01, 60, 4), 1), plant.truth()
    n_inputs = len(plant.input_names)
    recordings = Recordings.of(read_trajectories(campaign.recordings(), n_inputs, 2))
    spread = np.ones(2 + n_inputs)
    guards = Guards.of(truth.surface, spread, 2)
    coef = truth.coef_ + rng.normal(0.0, 0.003, truth.coef_.shape)  # as well as laws are known
    laws = Laws(coef, truth.feature_map.at_rows, campaign.x.std(axis=0), np.ones_like(coef) > 0)
    noise = 0.01 * campaign.x.std(axis=0)
    there = slides_there(SlidingLaws.of(laws, guards), recordings, noise, SETTINGS.beyond_slide)
    assert not there.any()


@cache
def friction():
    plant = PLANTS["dry friction, forced"]
    campaign = record(plant, Scenario(0.03, 60, 6), 2)
    return plant, campaign, identified(plant, campaign, 0)


@pytest.mark.nightly
def test_dry_friction_that_sticks_is_found_as_well_as_recordings_allow():
    plant, campaign, found = friction()
    ours = figures(plant, found.estimator_)
    oracle = figures(plant, METHODS["oracle"](plant, campaign, 0))
    assert ours["field"] <= 1.3 * oracle["field"]
    assert ours["balanced"] >= oracle["balanced"] - 0.01
    # the surface is where the mass turns, and nothing else
    surface = found.estimator_.surface_.coef_[0]
    np.testing.assert_allclose(surface / surface[2], [0.0, 0.0, 1.0, 0.0], atol=1e-12)


def test_a_rest_belongs_to_a_mode_that_the_user_knows():
    _, campaign, found = friction()
    assert set(found.modes_) == {0, 1} and found.modes_.shape == campaign.modes.shape
    rests = np.abs(campaign.states[:, 1]) < 1e-9
    # it is measured with a noise of 3 %, and a rest lasts for some samples
    assert np.abs(found.states_[rests, 1]).max() < 0.02 < 0.3 * found.noise_[1]
    assert all(len(times) == len(e) for times, e in zip(
        found.switch_times_, found.switch_time_errors_, strict=True))  # fmt: skip
