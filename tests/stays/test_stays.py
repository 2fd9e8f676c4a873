"""Identification on stays: its filter, its derivatives, its decoding, and what it finds."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.trajectories.figures import figures
from benchmarks.trajectories.methods import METHODS
from benchmarks.trajectories.plants import PLANTS
from benchmarks.trajectories.recordings import Scenario, record
from swsysid._data.recordings import Record
from swsysid._stays.assign import prior_of_model
from swsysid._stays.count import fewest_modes, order_of_switches
from swsysid._stays.decoding import decode
from swsysid._stays.descent import Reached
from swsysid._stays.filtering import Belief, FlowFilter, corrected
from swsysid._stays.identification import StayIdentification
from swsysid._stays.laws import Laws
from swsysid._stays.lifted import Estimate, Objective
from swsysid._stays.nodes import Nodes
from swsysid._stays.recordings import Recordings
from swsysid._stays.stays import Stays
from swsysid.refinement._trajectories import read_trajectories

NOISE = 0.01


def contact():
    """A mass on a spring that it may leave: plant, campaign, recordings, true laws and stays."""
    plant = PLANTS["contact"]
    campaign = record(plant, Scenario(NOISE, 60, 2), 1)
    recordings = Recordings.of(read_trajectories(campaign.recordings(), 0, 2))
    truth = plant.truth()
    laws = Laws(
        truth.coef_,
        truth.feature_map.at_rows,
        campaign.x.std(axis=0),
        np.ones(truth.coef_.shape, dtype=bool),
    )
    stays = []
    for rows in (campaign.groups == 0, campaign.groups == 1):
        run = truth.simulate(campaign.states[rows][0], campaign.t[rows])
        instants = np.array([event.time for event in run.events])
        modes = (run.modes[0] + np.arange(len(instants) + 1)) % 2
        stays.append(Stays(modes.astype(np.intp), instants))
    return plant, campaign, recordings, laws, stays


def at_rest(y, states):
    """States of a law that does not move, at the times of some samples."""
    t = np.arange(float(len(y)))
    rest = Laws(np.zeros((1, 1, 1)), lambda X: X, np.ones(1), np.zeros((1, 1, 1), dtype=bool))
    recordings = Recordings.of([Record(t, y, np.empty((len(y), 0)))])
    nodes = Nodes(recordings, [Stays(np.zeros(1, dtype=np.intp), np.zeros(0))])
    return Estimate(rest, nodes, states)


def resting(y):
    """Samples of a state that does not move, with unit noise, and the nodes of highest likelihood.

    A linear problem: one step leads there.
    """
    estimate = at_rest(y, np.zeros((len(y), 1)))
    step, promised = Objective(np.ones(1), 1e-5).normal_equations(estimate).step(0.0)
    return estimate.moved(step).states, promised


def test_without_motion_nodes_average():
    y = np.random.default_rng(0).normal(3.0, 1.0, (50, 1))
    states, promised = resting(y)
    np.testing.assert_allclose(states[:, 0], y.mean(), atol=1e-5)
    # half of sum y^2 less sum (y - mean)^2
    assert promised == pytest.approx(25.0 * y.mean() ** 2, rel=1e-6)


def test_a_missing_value_says_nothing():
    states, _ = resting(np.array([[1.0], [np.nan], [3.0]]))
    np.testing.assert_allclose(states[:, 0], 2.0, atol=1e-5)


@pytest.mark.parametrize("tie", [0.4, 0.0055])
def test_states_that_follow_the_samples_and_no_law_leave_their_gaps(tie):
    # a state that does not move, said to be wherever it was measured: 0, 1, 3
    y = np.array([[0.0], [1.0], [3.0]])
    reached = Reached(at_rest(y, y), Objective(np.array([2.0]), tie), 0.0)
    # no misfit; steps of 1 and 2, each by tie times the noise: that of the noise cancels
    assert reached.squares == pytest.approx((1.0 + 4.0) / tie**2)
    assert not reached.is_joined
    mean = np.full_like(y, 4.0 / 3.0)
    joined = Reached(at_rest(y, mean), Objective(np.array([2.0]), tie), 0.0)
    assert joined.squares == pytest.approx(np.square(y - mean).sum())
    assert joined.is_joined


def near_the_truth(rng):
    """An estimate of a contact, its laws and states a little off, and its objective."""
    _, campaign, recordings, laws, stays = contact()
    laws = replace(laws, coef=laws.coef + rng.normal(0, 0.01, laws.coef.shape))
    states = campaign.states + rng.normal(0, 0.01, campaign.states.shape)
    objective = Objective(NOISE * campaign.states.std(axis=0), 0.3)
    return Estimate(laws, Nodes(recordings, stays), states), objective


def test_the_gradient_by_all_unknowns_is_that_of_differences():
    rng = np.random.default_rng(0)
    estimate, objective = near_the_truth(rng)
    right = objective.normal_equations(estimate).negative_gradient
    for unknown in rng.choice(len(right), 12, replace=False).tolist() + [0, len(right) - 1]:
        move = np.zeros(len(right))
        move[unknown] = 1e-6
        ahead, behind = (objective.value(estimate.moved(sign * move)) for sign in (1, -1))
        slope = (ahead - behind) / 2e-6
        assert -right[unknown] == pytest.approx(slope, rel=1e-3, abs=1e-4 * abs(right).max())


def test_nodes_inside_of_stays_may_be_eliminated_in_pairs(monkeypatch):
    estimate, objective = near_the_truth(np.random.default_rng(3))
    steps = []
    for joined in ((1,), (2, 1), (16, 4, 1)):
        monkeypatch.setattr("swsysid._stays.nodes._JOINED", joined)
        nodes = estimate.nodes.with_stays(estimate.nodes.stays)
        step, promised = objective.normal_equations(replace(estimate, nodes=nodes)).step(1e-3)
        steps.append(np.append(step, promised))
    for step in steps[1:]:
        np.testing.assert_allclose(step, steps[0], rtol=1e-7, atol=1e-9)


def test_a_step_keeps_its_promise():
    estimate, objective = near_the_truth(np.random.default_rng(1))
    equations = objective.normal_equations(estimate)
    step, promised = equations.step(0.0)
    # along the step a quadratic: its slope at the start is twice what it promises, but for what
    # holds the instants
    assert step @ equations.negative_gradient == pytest.approx(2.0 * promised, rel=1e-6)
    gained = equations.value - objective.value(estimate.moved(step))
    assert gained == pytest.approx(promised, rel=0.02)


def test_the_stays_of_known_laws_are_decoded():
    _, campaign, recordings, laws, stays = contact()
    spread = campaign.x.std(axis=0)
    filter_ = FlowFilter.of(laws, recordings, NOISE * spread, 0.01 * spread)
    found = decode(filter_, recordings, price=4.0, n_kept=6)
    for place, (true, t) in enumerate(zip(stays, recordings.times, strict=True)):
        decoded = Stays.of_intervals(found.modes[: len(t) - 1, place], t)
        assert decoded.modes.tolist() == true.modes.tolist()
        # a switch is put in the middle of an interval; noise moves a few by one more
        assert np.abs(decoded.instants - true.instants).max() <= 1.6 * (t[1] - t[0])


def test_instants_that_meet_leave_one_switch():
    stays, t = Stays(np.array([0, 1, 0, 1]), np.array([1.5, 3.5, 5.5])), np.arange(8.0)
    moved = stays.moved(np.array([3.7, 3.2, 5.5]), t)
    assert moved.modes.tolist() == [0, 1] and moved.instants.tolist() == [3.7]
    assert stays.at(np.array([1.0, 2.0, 4.0, 6.0])).tolist() == [0, 1, 0, 1]
    assert stays.between(t).tolist() == [0, 0, 1, 1, 0, 0, 1]


def test_of_nodes_that_are_moved_only_stays_that_are_passed_are_others():
    t, stays = np.arange(8.0), Stays(np.array([0, 1, 0]), np.array([1.5, 3.5]))
    records = [Record(t, np.zeros((8, 1)), np.empty((8, 0)))] * 3
    nodes = Nodes(Recordings.of(records), [stays] * 3)
    instants = np.array([[1.6, 3.4], [1.6, 2.5], [3.7, 3.6]])
    moved = nodes.moved(instants.ravel())
    assert [one.modes.tolist() for one in moved.stays] == [[0, 1, 0], [0, 1, 0], [0, 1]]
    assert [one.instants.tolist() for one in moved.stays] == [[1.6, 3.4], [1.6, 2.5], [3.7]]
    assert moved.modes.reshape(3, 8)[1].tolist() == [0, 0, 1, 0, 0, 0, 0, 0]
    assert moved.instants.tolist() == [1.6, 3.4, 1.6, 2.5, 3.7]


def test_the_order_of_switches_costs_what_it_takes_to_say_it():
    cycle = Stays(np.array([0, 1, 2, 0, 1, 2, 0]), np.arange(6.0))
    assert order_of_switches([cycle]) == 0.0
    # mode 0 is left for 1 twice and for 2 once, in one of three orders
    mixed = Stays(np.array([0, 1, 0, 2, 0, 1]), np.arange(5.0))
    np.testing.assert_allclose(order_of_switches([mixed]), np.log(3.0), rtol=1e-12)
    # of three recordings without a switch, one begins in another mode than the others
    alone = [Stays(np.array([mode]), np.zeros(0)) for mode in (0, 1, 0)]
    np.testing.assert_allclose(order_of_switches(alone), np.log(3.0), rtol=1e-12)


@pytest.mark.parametrize(
    "name", [pytest.param("contact", marks=pytest.mark.nightly), "linear oscillator"]
)
def test_twelve_noisy_recordings_give_nearly_what_they_allow(name):
    plant = PLANTS[name]
    campaign = record(plant, Scenario(NOISE, 60, 12), 1)
    ours = figures(plant, METHODS["recordings"](plant, campaign, 0))
    oracle = figures(plant, METHODS["oracle"](plant, campaign, 0))
    assert ours["field"] <= 1.3 * oracle["field"]
    assert ours["balanced"] >= oracle["balanced"] - 0.01


@pytest.mark.parametrize("gain", [1.0, -3.0])
def test_a_filter_takes_inputs_for_lines_between_the_rows(gain):
    """x' = g u with u = 0, 1, 4 at 0, 1, 3: its means and integrals over intervals and halves."""
    t, u = np.array([0.0, 1.0, 3.0]), np.array([[0.0], [1.0], [4.0]])
    coef = np.array([[[0.0, gain]]])
    laws = Laws(coef, lambda X: X, np.ones(1), np.ones(coef.shape, dtype=bool))
    recordings = Recordings.of([Record(t, np.zeros((3, 1)), u)])
    found = FlowFilter.of(laws, recordings, np.ones(1), np.ones(1))
    np.testing.assert_allclose(found.rates.offset.ravel(), [0.5 * gain, 2.5 * gain], atol=1e-12)
    moved = [half.offset.ravel() for half in found.halves]
    np.testing.assert_allclose(moved[0], [0.125 * gain, 1.75 * gain], atol=1e-12)
    np.testing.assert_allclose(moved[1], [0.375 * gain, 3.25 * gain], atol=1e-12)


def test_a_lost_sample_tells_nothing_of_the_mode():
    """Of two modes alike but for their spread, which filters of modes take for evidence."""
    spread = np.array([0.01, 0.25])
    ahead = Belief(np.zeros((1, 1, 1, 2)), spread.reshape(1, 1, 1, 1, 2))
    after, likelihood = corrected(ahead, np.array([[np.nan]]), np.array([0.1]))
    np.testing.assert_array_equal(likelihood, 0.0)
    np.testing.assert_array_equal(after.covariance, ahead.covariance)
    # and beside a recording that has its sample
    both = Belief(np.zeros((1, 2, 1, 2)), np.tile(ahead.covariance, (1, 1, 2, 1, 1)))
    after, likelihood = corrected(both, np.array([[np.nan], [0.0]]), np.array([0.1]))
    np.testing.assert_array_equal(likelihood[0], 0.0)
    np.testing.assert_array_equal(after.covariance[:, :, 0], ahead.covariance[:, :, 0])
    assert likelihood[1, 0, 0] > likelihood[1, 0, 1]


def test_a_surface_tells_of_modes_that_its_rows_do_not_have():
    plant, _, recordings, _, _ = contact()
    prior = prior_of_model(plant.truth().switching_model, recordings, 0.01, 3)
    assert prior.shape == (*recordings.steps.shape, 3)
    np.testing.assert_array_equal(prior[..., 2], np.log(0.01))
    np.testing.assert_array_equal(
        prior[..., :2], prior_of_model(plant.truth().switching_model, recordings, 0.01, 2)
    )


def test_a_number_of_modes_without_a_solution_ends_the_search():
    _, _, recordings, laws, stays = contact()
    estimate = Estimate(laws, Nodes(recordings, stays), recordings.in_a_row(recordings.guess))
    objective = Objective(np.full(2, NOISE), 1e-5)
    reached = Reached(estimate, objective, objective.value(estimate))
    known = StayIdentification(None, reached, (), reached.value)

    def identified(n_modes, _):
        if n_modes != 2:
            raise np.linalg.LinAlgError("not positive definite")
        return known

    found, tried = fewest_modes(identified, lambda one: None, [2, 3, 4])
    assert found is known and len(tried) == 1
    with pytest.raises(np.linalg.LinAlgError):
        fewest_modes(identified, lambda one: None, [1, 2])


def test_a_number_of_modes_that_explains_enough_is_the_last_one():
    _, _, recordings, laws, stays = contact()
    estimate = Estimate(laws, Nodes(recordings, stays), recordings.in_a_row(recordings.guess))
    objective = Objective(np.full(2, NOISE), 1e-5)
    reached = Reached(estimate, objective, objective.value(estimate))
    answers = {n: StayIdentification(None, reached, (), reached.value) for n in (2, 3, 4)}
    _, tried = fewest_modes(
        lambda n, _: answers[n], lambda one: None, [2, 3, 4], lambda one: one is answers[2]
    )
    assert [one.n_modes for one in tried] == [2]


def test_nodes_eliminated_in_pairs_move_as_those_eliminated_one_after_the_other():
    _, _, recordings, laws, stays = contact()
    nodes = Nodes(recordings, stays)
    estimate = Estimate(laws, nodes, recordings.in_a_row(recordings.guess))
    objective = Objective(np.full(2, NOISE), 5.5e-5)  # the tightest tie of a descent
    paired, _ = objective.normal_equations(estimate).step(1e-3)
    nodes.segments, nodes.kept = nodes.segments_of((1,))
    single, _ = objective.normal_equations(estimate).step(1e-3)
    # rounding takes 1.6e-7 of the largest move; a node that is lost moves by all of it
    np.testing.assert_allclose(paired, single, atol=2e-6 * np.abs(single).max(), rtol=0.0)
