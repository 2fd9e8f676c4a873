"""Recordings in steps as long as their noise allows; parts of a descent that are told apart."""

from dataclasses import replace

import numpy as np
import pytest
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler

from swsysid import SwitchingSystemRegressor, TrajectoryIdentifier
from swsysid._data.recordings import Record
from swsysid._stays.flow import ends_of
from swsysid._stays.guards import Guards
from swsysid._stays.laws import Laws
from swsysid._stays.lifted import Estimate, Objective, recombined
from swsysid._stays.nodes import Nodes
from swsysid._stays.polynomial_laws import AffineLaws
from swsysid._stays.recordings import Recordings, durations, in_exact_steps, sharp_enough
from swsysid._stays.settings import SETTINGS
from swsysid._stays.stays import Stays
from swsysid.refinement import StatedModel, StatedSurface

DECAY = Laws(np.array([[[-1.0]]]), lambda X: X, np.ones(1), np.zeros((1, 1, 1), dtype=bool))
SPRINGS = StatedModel(
    None,
    [[[0, 1], [-1, -0.1]], [[0, 1], [-4, -0.1]]],
    states=["x", "v"],
    surface=StatedSurface([[0, 1, 0]], 1),
)


def decaying(interval: float) -> Recordings:
    """exp(-t), one recording of eleven samples."""
    t = interval * np.arange(11.0)
    return Recordings.of([Record(t, np.exp(-t)[:, None], np.empty((11, 0)))])


def test_divided_steps_keep_the_samples():
    recordings = decaying(0.5)
    fine = recordings.divided(3)
    np.testing.assert_allclose(fine.times[0][fine.sampled[0]], recordings.times[0])
    np.testing.assert_allclose(fine.joined(fine.y), recordings.joined(recordings.y))
    np.testing.assert_allclose(fine.steps, 0.5 / 3)
    assert fine.interval == pytest.approx(0.5)
    assert np.isnan(fine.y[1:3]).all()
    middle = fine.guess[1, 0, 0]
    np.testing.assert_allclose(middle, 1.0 + (np.exp(-0.5) - 1.0) / 3)


@pytest.mark.parametrize("interval", [0.02, 0.3, 2.0])
@pytest.mark.parametrize("noise", [1e-2, 1e-4])
def test_a_rollout_is_as_exact_as_its_noise_asks_for(interval, noise):
    recordings = in_exact_steps(decaying(interval), DECAY, np.array([noise]), SETTINGS)
    stays = [Stays(np.zeros(1, dtype=np.intp), np.zeros(0))]
    nodes = Nodes(recordings, stays)
    states = np.ones((len(nodes), 1))
    for k in range(len(nodes) - 1):
        states[k + 1] = ends_of(DECAY, nodes, states)[k]
    error = np.abs(states[:, 0] - np.exp(-recordings.times[0])).max()
    assert error <= SETTINGS.exact * noise


def test_no_step_is_shorter_than_needed():
    # (dt)^5 / 120 a step; ten of .02 gather 3e-10
    assert in_exact_steps(decaying(0.02), DECAY, np.array([0.01]), SETTINGS).first_step == 1.0
    assert in_exact_steps(decaying(2.0), DECAY, np.array([0.01]), SETTINGS).per_sample > 1


def test_a_wild_law_that_explains_no_step_asks_for_no_finer_ones():
    coef = np.array([[[-1.0]], [[-400.0]]])
    both = Laws(coef, DECAY.features, DECAY.spread, np.zeros(coef.shape, dtype=bool))
    recordings, noise = decaying(0.02), np.array([0.01])
    assert in_exact_steps(recordings, both, noise, SETTINGS).per_sample == 1
    wild = Laws(coef[1:], DECAY.features, DECAY.spread, np.zeros((1, 1, 1), dtype=bool))
    assert in_exact_steps(recordings, wild, noise, SETTINGS).per_sample > 1


def test_laws_that_can_be_stepped_more_exactly_need_no_finer_steps():
    affine = AffineLaws(DECAY.coef, DECAY.features, DECAY.spread, DECAY.free, np.ones((1, 1), int))
    recordings, noise = decaying(2.0), np.array([1e-3])
    sharp = sharp_enough(affine, recordings, noise, SETTINGS)
    assert in_exact_steps(recordings, affine, noise, SETTINGS).per_sample > 1
    assert sharp.order > affine.order
    assert in_exact_steps(recordings, sharp, noise, SETTINGS).per_sample == 1
    assert sharp_enough(affine, decaying(0.02), noise, SETTINGS).order == affine.order
    # other laws are what they are
    assert sharp_enough(DECAY, recordings, noise, SETTINGS) is DECAY


def test_steps_that_differ_by_the_rounding_of_times_last_equally_long():
    t = 0.1 * np.arange(100_000)
    assert len(np.unique(np.diff(t))) > 1
    assert len(np.unique(durations(t))) == 1
    t[500] += 1e-9
    np.testing.assert_array_equal(durations(t)[498:502] != durations(t)[0], [0, 1, 1, 0])


def crossing() -> tuple[Estimate, Objective]:
    """Two recordings of a mass between two springs, estimated wrongly, with a surface."""
    t = np.linspace(0.0, 6.0, 61)
    runs = [SPRINGS.simulate(start, t) for start in ([1.0, 1.0], [-2.0, 0.0])]
    rng = np.random.default_rng(0)
    records = [
        Record(t, run.x + 0.01 * rng.standard_normal(run.x.shape), np.empty((61, 0)))
        for run in runs
    ]
    spread = np.vstack([run.x for run in runs]).std(axis=0)
    free = np.ones(SPRINGS.coef_.shape, dtype=bool)
    laws = Laws(SPRINGS.coef_ * 1.02, SPRINGS.feature_map.at_rows, spread, free)
    recordings = Recordings.of(records)
    stays = [
        Stays(
            np.array([run.events[0].before, *(event.after for event in run.events)]),
            np.array([event.time for event in run.events]) + 0.02,
        )
        for run in runs
    ]
    columns = recordings.joined(recordings.y)
    modes = np.concatenate([run.modes for run in runs])
    guards = Guards.of(SPRINGS.surface, spread, 2)
    guards = guards.with_sides(columns, np.ones_like(columns), modes, 0.1)
    objective = Objective(np.full(2, 0.01), 0.3, 0.1)
    nodes = Nodes(recordings, stays)
    return Estimate(laws, nodes, nodes.y, guards), objective


def test_recordings_share_the_value_between_them():
    estimate, objective = crossing()
    shares = objective.by_recording(estimate)
    assert (shares > 1.0).all()
    # two sums of the same squares
    assert shares.sum() == pytest.approx(objective.normal_equations(estimate).value, rel=1e-10)


def test_what_is_crossed_most_surely_holds_the_scale_of_a_surface():
    estimate, _ = crossing()  # of x = 0
    wiggly = PolynomialFeatures(3).fit(np.zeros((1, 2)))
    guards = replace(
        estimate.guards,
        coef=np.array([[0.0, 0.1, 0.0, -5.0, 0.3, 0.2, 7.0, 0.0, 0.0, 0.0]]),  # 1 x ... 7 x^3
        features=wiggly.transform,
        free=np.ones((1, 10), dtype=bool),
        sides=None,
    )
    exact = np.array([[0.0, 1.0], [0.0, -1.4], [0.0, 0.8]])
    at = estimate.crossings._replace(
        old=np.zeros(3, dtype=int), new=np.ones(3, dtype=int), columns=exact, rates=exact[:, ::-1]
    )
    held = wiggly.get_feature_names_out(["x", "v"])[~guards.pivoted(at).free[0]]
    assert list(held) == ["x v"]  # .3 v x' at x = 0, v = 1; squares and cubes of x vanish there
    # nobody knows where it is crossed: the largest
    assert list(wiggly.get_feature_names_out(["x", "v"])[~guards.pivoted().free[0]]) == ["x^3"]


def test_recordings_are_recombined_one_by_one():
    estimate, objective = crossing()
    moved = estimate.nodes.moved(estimate.nodes.instants + 0.03)
    other = replace(estimate, nodes=moved, states=estimate.states + 0.01)
    mixed = replace(recombined([estimate, other]), guards=estimate.guards)
    parts = [objective.by_recording(one) for one in (estimate, other)]
    expected = [parts[0][0], parts[1][1]]
    np.testing.assert_allclose(objective.by_recording(mixed), expected, rtol=1e-10)


def test_starts_give_the_same_answer_side_by_side():
    t = np.linspace(0.0, 8.0, 121)
    rng = np.random.default_rng(1)
    recordings = []
    for start in ([1.0, 1.0], [-2.0, 0.0], [1.5, -1.0]):
        x = SPRINGS.simulate(start, t).x
        recordings.append({"t": t, "x": x + 0.02 * rng.standard_normal(x.shape)})
    estimator = SwitchingSystemRegressor(random_state=0)
    one, two = (TrajectoryIdentifier(estimator, n_jobs=n_jobs).fit(recordings) for n_jobs in (1, 2))
    np.testing.assert_array_equal(one.estimator_.coef_, two.estimator_.coef_)
    np.testing.assert_array_equal(one.modes_, two.modes_)


@pytest.mark.parametrize("missing", [0.1, 0.5])
def test_the_noise_is_that_of_the_values_that_were_measured(missing):
    t = np.linspace(0.0, 8.0, 241)
    rng = np.random.default_rng(3)
    recordings = []
    for start in ([1.0, 1.0], [-2.0, 0.0], [1.5, -1.0]):
        x = SPRINGS.simulate(start, t).x
        x = x + 0.02 * rng.standard_normal(x.shape)
        x[rng.random(x.shape) < missing] = np.nan
        recordings.append({"t": t, "x": x})
    found = TrajectoryIdentifier(SwitchingSystemRegressor(random_state=0)).fit(recordings)
    # the median of some hundred differences that overlap is known to 7 %; what lies off the line
    # between its neighbours is some curvature too
    assert (found.report_.noise_of_differences >= 0.85 * 0.02).all()
    assert (found.report_.noise_of_differences <= 1.4 * 0.02).all()
    np.testing.assert_allclose(found.noise_, 0.02, rtol=0.12)
    assert found.report_.advice == "The rollouts leave nothing but noise."


@pytest.mark.nightly
def test_a_library_that_learns_from_its_data_is_learnt_once():
    t = np.linspace(0.0, 8.0, 161)
    rng = np.random.default_rng(4)
    recordings, states = [], []
    for start in ([1.0, 1.0], [-2.0, 0.0], [1.5, -1.0]):
        x = SPRINGS.simulate(start, t).x
        states.append(x)
        recordings.append({"t": t, "x": x + 0.01 * rng.standard_normal(x.shape)})
    scaled = make_pipeline(PolynomialFeatures(1), StandardScaler(with_mean=False))
    estimator = SwitchingSystemRegressor(feature_library=scaled, random_state=0)
    found = TrajectoryIdentifier(estimator).fit(recordings)
    columns = np.vstack(states)
    truth = SPRINGS.switching_model.predict(columns)
    error = (found.predict(columns) - truth) / truth.std(axis=0)
    # with features of two different scales it is some 3 %; the surface is off by as little as noise
    assert np.median(np.abs(error)) < 0.005
    assert found.score(recordings) > 0.999


def test_laws_that_overflow_in_a_step_take_the_finest_ones():
    # x' = 1e9 x^3 leaves all bounds within a step, as a start whose law is still wrong may
    wild = replace(DECAY, coef=np.array([[[1e9]]]), features=lambda X: X**3)
    with np.errstate(over="ignore", invalid="ignore"):
        fine = in_exact_steps(decaying(0.5), wild, np.array([0.01]), SETTINGS)
    assert fine.per_sample == SETTINGS.most_steps
