"""Inputs that keep their value: where they step, and what laws make of them."""

import re
from dataclasses import replace

import numpy as np
import pytest

from swsysid import SwitchingSystemRegressor, TrajectoryIdentifier
from swsysid._data.recordings import Hold
from swsysid._stays import input_holds
from swsysid._stays.given import read_given
from swsysid._stays.laws import Laws
from swsysid._stays.lifted import Estimate, Objective
from swsysid._stays.nodes import Nodes
from swsysid._stays.recordings import Recordings
from swsysid._stays.search import Search
from swsysid._stays.settings import LIMITS, SETTINGS
from swsysid._stays.stays import Stays

DECAY, GAIN, NOISE, STEP = 0.5, 2.0, 0.005, 0.1
TRUE = [0.0, -DECAY, GAIN]


def affine(n_modes=1, **options):
    return SwitchingSystemRegressor(n_modes, feature_library=1, random_state=0, **options)


def response(instants, levels, t, x=0.3):
    """x' = -x / 2 + 2 u, exactly, with the levels of u from each instant on."""
    values, now = np.zeros(len(t)), t[0]
    for end, level in zip(np.append(instants, np.inf), levels, strict=True):
        goal, own = GAIN * level / DECAY, (t >= now) & (t < end)
        values[own] = goal + (x - goal) * np.exp(-DECAY * (t[own] - now))
        x, now = goal + (x - goal) * np.exp(-DECAY * (min(end, t[-1]) - now)), end
    return values


def relay(seed=0, n_steps=40, origin=0.0):
    """A relay that steps between the rows: t, x, u and its instants."""
    rng = np.random.default_rng(seed)
    instants = np.cumsum(rng.uniform(0.55, 1.35, n_steps))
    levels = np.arange(n_steps + 1) % 2.0
    t = np.arange(0.0, instants[-1] + 1.0, STEP)
    x = response(instants, levels, t) + NOISE * rng.standard_normal(len(t))
    u = levels[np.searchsorted(instants, t, side="right")]
    return origin + t, x[:, None], u[:, None], origin + instants


def command(seed=0, n_steps=40):
    """A command that is held for ten rows at a time."""
    rng = np.random.default_rng(seed)
    levels = rng.normal(size=n_steps)
    t = STEP * np.arange(10 * n_steps)
    x = response(t[10::10] - 1e-9, levels, t) + NOISE * rng.standard_normal(len(t))
    return t, x[:, None], np.repeat(levels, 10)[:, None]


@pytest.mark.parametrize("origin", [0.0, 1.7e9])
def test_instants_of_a_relay_between_the_rows_are_found_with_the_law(origin):
    t, x, u, instants = relay(origin=origin)
    found = TrajectoryIdentifier(affine()).fit(x, t, inputs=u)
    assert found.input_holds_ == ("between",)
    off = np.abs(found.estimator_.coef_[0, 0] - TRUE)
    assert (off <= 2.0 * found.coef_errors_[0, 0]).all()
    assert off.max() <= 0.02  # a line from row to row is off by .1
    assert found.noise_[0] == pytest.approx(NOISE, rel=0.15)
    assert f"{len(instants)} instants" in str(found.report_)
    assert found.states_.shape == x.shape and found.report_.n_samples == len(t)


@pytest.mark.parametrize("n_steps", [150, 1200])
def test_what_inputs_do_is_asked_in_a_part_of_long_recordings(n_steps, monkeypatch):
    asked = []

    class Counting(Search):
        def begun(self, n_modes):
            asked.append(sum(len(record.t) for record in self.given.records))
            return super().begun(n_modes)

    monkeypatch.setattr(input_holds, "Search", Counting)
    t, x, u = command(n_steps=n_steps)
    told = input_holds.holds_of(read_given(x, t, None, u), affine(), 1, "auto", SETTINGS)
    assert told == (Hold.ROW,)
    assert asked and max(asked) < 2 * LIMITS.samples_of_holds


@pytest.mark.parametrize(
    ("hold", "late", "words"),
    [
        ("zero", 0, "keeps its value until the next row"),
        ("next", 1, "acts a row before it is logged"),
    ],
)
def test_a_command_acts_from_its_row_on_or_from_the_one_before(hold, late, words):
    """A logger writes at the end of an interval what has acted in it, a controller at the begin."""

    def logged(u):
        return np.append(np.repeat(u[:1], late, axis=0), u[: len(u) - late], axis=0)

    t, x, u = command()
    found = TrajectoryIdentifier(affine()).fit(x, t, inputs=logged(u))
    assert found.input_holds_ == (hold,)
    off = np.abs(found.estimator_.coef_[0, 0] - TRUE)
    assert (off <= 2.0 * found.coef_errors_[0, 0]).all() and off.max() <= 0.01
    assert words in str(found.report_)
    run = found.simulate(x[0], t, logged(u))
    np.testing.assert_allclose(run.x, x, atol=6.0 * NOISE)  # the start is as noisy as all samples
    unseen = command(seed=1)
    assert found.score(unseen[1], unseen[0], inputs=logged(unseen[2])) > 0.9995


def test_what_is_told_of_inputs_is_taken_and_nothing_else_is_tried(monkeypatch):
    t, x, u = command()
    asked = TrajectoryIdentifier(affine()).fit(x, t, inputs=u)
    tried = "swsysid._stays.search.Search.begun"
    monkeypatch.setattr(tried, lambda *_: pytest.fail("what was told was tried"))
    for told in ("zero", ("zero",)):
        found = TrajectoryIdentifier(affine(), input_hold=told).fit(x, t, inputs=u)
        assert found.input_holds_ == asked.input_holds_
        off = np.abs(found.estimator_.coef_ - asked.estimator_.coef_)
        assert (off <= 0.02 * asked.coef_errors_).all()  # another start of the same descent
    line = TrajectoryIdentifier(affine(), input_hold="linear").fit(x, t, inputs=u)
    assert line.input_holds_ == ("linear",)
    assert np.abs(line.estimator_.coef_[0, 0] - TRUE).max() > 0.05


def test_instants_are_sought_where_it_is_told_that_they_lie_between_rows():
    t, x, u, instants = relay()
    found = TrajectoryIdentifier(affine(), input_hold="between").fit(x, t, inputs=u)
    off = np.abs(found.estimator_.coef_[0, 0] - TRUE)
    assert (off <= 2.0 * found.coef_errors_[0, 0]).all() and off.max() <= 0.02
    assert f"{len(instants)} instants" in str(found.report_)


@pytest.mark.parametrize(
    ("told", "sentence"),
    [
        (
            "cubic",
            "input_hold='cubic' is unknown; choose 'auto', 'linear', 'zero', 'next' or 'between'.",
        ),
        (
            ("zero", "cubic"),
            "input_hold='cubic' is unknown; choose 'linear', 'zero', 'next' or 'between'.",
        ),
        (
            ("zero",) * 3,
            "must be 'auto', or say of each of 2 inputs whether it is",
        ),
        (None, "input_hold=None must be 'auto', or say"),
    ],
)
def test_what_inputs_do_between_rows_is_refused_in_words(told, sentence):
    t, x, u = command()
    with pytest.raises(ValueError, match=re.escape(sentence)):
        TrajectoryIdentifier(affine(), input_hold=told).fit(x, t, inputs=np.hstack([u, u**2]))


def test_a_line_between_rows_of_equal_values_is_one():
    t, _, u = command()
    plant = TrajectoryIdentifier(affine()).fit(*command()[1::-1], inputs=u).estimator_
    plant.coef_ = np.array([[TRUE]])
    x = plant.simulate([0.3], t, u, input_hold="linear").x
    x = x + NOISE * np.random.default_rng(2).standard_normal(x.shape)
    found = TrajectoryIdentifier(affine()).fit(x, t, inputs=u)
    assert found.input_holds_ == ("linear",)
    off = np.abs(found.estimator_.coef_[0, 0] - TRUE)
    assert (off <= 2.0 * found.coef_errors_[0, 0]).all()


def test_a_smooth_input_is_on_lines_and_nothing_else_is_tried(monkeypatch):
    t = STEP * np.arange(300)
    u = np.sin(0.7 * t)[:, None]
    x = np.exp(-DECAY * t)[:, None] + 0.3 * np.sin(t)[:, None]
    tried = "swsysid._stays.search.Search.begun"
    monkeypatch.setattr(tried, lambda *_: pytest.fail("a smooth input was tried to step"))
    noisy = x + NOISE * np.random.default_rng(0).standard_normal(x.shape)
    assert TrajectoryIdentifier(affine()).fit(noisy, t, inputs=u).input_holds_ == ("linear",)


@pytest.mark.parametrize("parts", [1, 2])
def test_what_an_instant_of_an_input_changes_is_what_differences_say(parts):
    t, x, u, _ = relay(n_steps=4)
    u = np.column_stack([u, np.sin(t)])
    given = read_given(x, t, None, u).stepped([Hold.BETWEEN, Hold.LINE])
    guess = [record.filled for record in given.records]
    recordings = Recordings.of(given.records, guess).divided(parts)
    nodes = Nodes(recordings, [Stays(np.zeros(1, dtype=np.intp), np.zeros(0))])
    assert len(nodes.stepping) == 4
    laws = Laws(
        np.array([[[0.1, -0.4, 1.8, 0.3]]]),
        lambda X: np.column_stack([np.ones(len(X)), X]),
        np.ones(1),
        np.ones((1, 1, 4), dtype=bool),
    )
    estimate = Estimate(laws, nodes, recordings.in_a_row(recordings.guess))
    for k in range(len(nodes.begins)):
        estimate.states[k + 1] = estimate.ends(np.array([k]))
    # at a law that is a little off what the nodes follow
    estimate = replace(estimate, laws=replace(laws, coef=1.001 * laws.coef))
    objective = Objective(np.full(1, 0.05), 0.4)
    equations = objective.normal_equations(estimate)
    assert equations.value == pytest.approx(objective.value(estimate), rel=1e-9)
    gradient = -equations.negative_gradient
    for place in range(laws.n_free + estimate.states.size, len(gradient)):
        step = np.zeros(len(gradient))
        step[place] = 1e-6
        change = objective.value(estimate.moved(step)) - objective.value(estimate.moved(-step))
        # how tightly a node is tied changes with an instant, too: by what it misses, twice
        assert change / 2e-6 == pytest.approx(gradient[place], rel=0.01)


def test_a_step_stays_between_the_samples_around_it():
    t, x, u, _ = relay(n_steps=4)
    given = read_given(x, t, None, u).stepped([Hold.BETWEEN])
    recordings = Recordings.of(given.records)
    (own,) = recordings.step_times
    moved = recordings.with_step_times([own + [-1.0, -0.01, 0.01, 1.0]])
    (now,) = moved.step_times
    rows = np.searchsorted(t, own)
    np.testing.assert_allclose(now[1:3] - own[1:3], [-0.01, 0.01], atol=1e-9)
    assert t[rows[0] - 1] < now[0] < t[rows[0] - 1] + 0.02 * STEP
    assert t[rows[3]] - 0.02 * STEP < now[3] < t[rows[3]]
    assert (np.diff(moved.times[0]) > 0.0).all()
    np.testing.assert_array_equal(moved.u, recordings.u)


@pytest.mark.nightly
def test_a_staircase_is_held_beside_modes_that_it_decides():
    """A dead zone of a command: one law, and two, make up for the third by lines between rows."""
    rng = np.random.default_rng(3)
    u = np.repeat(rng.uniform(-3.0, 3.0, 40), 10)
    drive = 5.0 * np.sign(u) * np.maximum(np.abs(u) - 0.8, 0.0)
    kept, w = np.exp(-2.0 * 0.05), np.zeros(400)
    for k in range(399):
        w[k + 1] = kept * w[k] + (1.0 - kept) / 2.0 * drive[k]
    noisy = w[:, None] + 0.02 * rng.standard_normal((400, 1))
    regressor = SwitchingSystemRegressor("auto", feature_library=1, random_state=0)
    found = TrajectoryIdentifier(regressor).fit(noisy, 0.05 * np.arange(400), inputs=u[:, None])
    assert found.input_holds_ == ("zero",) and found.n_modes_ == 3
    gains = np.sort(found.estimator_.coef_[:, 0, 2])
    np.testing.assert_allclose(gains, [0.0, 5.0, 5.0], atol=0.15)
