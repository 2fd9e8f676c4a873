"""`TrajectoryIdentifier` as a user meets it: recordings in, laws, modes and instants out."""

from functools import cache

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.model_selection import GridSearchCV, KFold
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer

from benchmarks.trajectories.plants import PLANTS
from benchmarks.trajectories.recordings import Scenario, record
from swsysid import (
    IdentificationWarning,
    PolynomialSurfaceClassifier,
    SwitchingSystemRegressor,
    TrajectoryIdentifier,
)
from swsysid.metrics import balanced_mode_accuracy

NOISE = 0.01
TRUTH = np.array([[[0.0, 1.0], [-1.0, -0.5]], [[0.0, 1.0], [-1.0, -0.1]]])


@cache
def oscillator():
    """Six recordings of the paper's oscillator, damped differently on the two sides of x = 0."""
    return record(PLANTS["linear oscillator"], Scenario(NOISE, 60, 6), 3)


def estimator(**options):
    surface = PolynomialSurfaceClassifier(degree=1)
    return SwitchingSystemRegressor(**({"surface": surface, "random_state": 0} | options))


@cache
def identified():
    data = oscillator()
    return TrajectoryIdentifier(estimator()).fit(data.x, data.t, data.groups)


def in_order(coef):
    """Laws, the more damped one first."""
    return coef[np.argsort(coef[:, 1, 1])]


def test_laws_modes_states_and_instants_are_right_within_their_errors():
    found, data = identified(), oscillator()
    order = np.argsort(found.estimator_.coef_[:, 1, 1])
    off = (found.estimator_.coef_[order] - TRUTH) / found.coef_errors_[order]
    assert np.abs(off).max() < 4.0  # standard errors, of 8 coefficients
    assert found.coef_errors_.max() < 3e-3
    assert balanced_mode_accuracy(data.modes, found.modes_) > 0.99
    assert (found.states_ - data.states).std() < 0.25 * (data.x - data.states).std()
    for (_, instants), times, errors in zip(
        data.stays, found.switch_times_, found.switch_time_errors_, strict=True
    ):
        assert np.abs((times - instants) / errors).max() < 5.0  # of 23 instants
    measured = (data.x - data.states).std(axis=0)
    np.testing.assert_allclose(found.noise_, measured, rtol=0.05)


def test_it_predicts_simulates_and_scores_recordings_that_it_has_not_seen():
    found = identified()
    unseen = record(PLANTS["linear oscillator"], Scenario(NOISE, 60, 2), 99)
    assert found.score(unseen.recordings()) > 0.999
    truth = PLANTS["linear oscillator"].truth()
    start, t = np.array([3.0, -1.0]), np.linspace(0.0, 12.0, 121)
    run, true = found.simulate(start, t), truth.simulate(start, t)
    assert np.abs(run.x - true.x).max() < 0.02
    assert (
        found.predict_modes(unseen.states) == found.estimator_.predict_modes(unseen.states)
    ).all()
    assert np.abs(found.predict(unseen.states) - truth.predict(unseen.states)).std() < 0.02


def test_positions_alone_are_enough():
    data = oscillator()
    found = TrajectoryIdentifier(estimator(), order=2).fit(data.x[:, 0], data.t, data.groups)
    coef = in_order(found.estimator_.coef_)
    np.testing.assert_allclose(coef, TRUTH, atol=0.01)
    assert (found.coef_errors_[:, 0] == 0.0).all()  # a position changes as its speed, exactly
    assert found.states_.shape == data.x.shape
    assert found.noise_.shape == (1,)


def test_missing_values_uneven_times_and_names_of_a_frame():
    pandas = pytest.importorskip("pandas")
    data, rng = oscillator(), np.random.default_rng(0)
    x = np.where(rng.random(data.x.shape) < 0.1, np.nan, data.x)
    kept = rng.random(len(x)) < 0.8
    frame = pandas.DataFrame(x[kept], columns=["position", "speed"])
    found = TrajectoryIdentifier(estimator()).fit(frame, data.t[kept], data.groups[kept])
    np.testing.assert_allclose(in_order(found.estimator_.coef_), TRUTH, atol=0.01)
    assert list(found.estimator_.feature_names_in_) == ["position", "speed"]
    assert "speed" in str(found.report_)
    assert len(found.modes_) == kept.sum()


def test_a_gap_and_another_rate_do_no_harm():
    data = oscillator()
    recordings = data.recordings()
    first, second = recordings[:2]
    gap = np.r_[:40, 70:121]
    recordings[0] = {"t": first["t"][gap], "x": first["x"][gap]}
    recordings[1] = {"t": second["t"][::2], "x": second["x"][::2]}
    found = TrajectoryIdentifier(estimator()).fit(recordings)
    np.testing.assert_allclose(in_order(found.estimator_.coef_), TRUTH, atol=0.01)
    assert len(found.switch_times_[0]) == len(data.stays[0][1])  # one of them within the gap


def test_samples_at_the_end_of_a_range_count_as_missing():
    data = oscillator()
    clipped = np.clip(data.x, None, [3.0, np.inf])
    with pytest.warns(IdentificationWarning, match="end of the range of their sensor"):
        found = TrajectoryIdentifier(estimator()).fit(clipped, data.t, data.groups)
    np.testing.assert_allclose(in_order(found.estimator_.coef_), TRUTH, atol=0.01)
    beyond = data.states[:, 0] > 3.0
    assert np.abs(found.states_ - data.states)[beyond].max() < 0.1  # up to 1.6 is cut off


def test_an_encoder_does_no_harm():
    data = oscillator()
    quantum = 0.05
    rounded = quantum * np.round(data.states / quantum)
    found = TrajectoryIdentifier(estimator()).fit(rounded, data.t, data.groups)
    np.testing.assert_allclose(in_order(found.estimator_.coef_), TRUTH, atol=0.01)
    np.testing.assert_allclose(found.noise_, quantum / np.sqrt(12.0), rtol=0.1)


def test_the_order_of_recordings_and_their_labels_mean_nothing():
    data = oscillator()
    names = np.array(list("fbdaec"))[data.groups]
    turned = np.concatenate([np.flatnonzero(data.groups == k) for k in (3, 1, 5, 0, 2, 4)])
    found = TrajectoryIdentifier(estimator()).fit(data.x[turned], data.t[turned], names[turned])
    np.testing.assert_allclose(
        in_order(found.estimator_.coef_), in_order(identified().estimator_.coef_), atol=1e-3
    )
    assert (found.modes_ == identified().modes_[turned]).mean() in (0.0, 1.0)


def test_recordings_that_begin_anew_need_no_labels():
    data = oscillator()
    found = TrajectoryIdentifier(estimator()).fit(data.x, data.t)
    np.testing.assert_array_equal(found.estimator_.coef_, identified().estimator_.coef_)


@pytest.mark.nightly
def test_the_number_of_modes_is_found():
    data = oscillator()
    found = TrajectoryIdentifier(estimator(n_modes="auto", max_modes=3)).fit(
        data.x, data.t, data.groups
    )
    assert found.n_modes_ == 2
    assert [one.n_modes for one in found.mode_selection_] == [1, 2, 3]


@pytest.mark.nightly
def test_one_mode_is_found_where_there_is_one():
    data = record(PLANTS["one mode, linear"], Scenario(NOISE, 60, 4), 5)
    found = TrajectoryIdentifier(estimator(n_modes="auto", max_modes=3)).fit(
        data.x, data.t, data.groups
    )
    assert found.n_modes_ == 1
    assert found.surface_errors_ is None
    assert not any(len(times) for times in found.switch_times_)


def test_few_terms_where_the_estimator_asks_for_few():
    data = oscillator()
    found = TrajectoryIdentifier(estimator(sparsity="auto")).fit(data.x, data.t, data.groups)
    zero = in_order(found.estimator_.coef_)[:, 0, 0]
    np.testing.assert_array_equal(zero, 0.0)


def test_unknowns_of_stretches_apart_when_rollouts_mean_nothing():
    data = oscillator()
    found = TrajectoryIdentifier(estimator(), refine=False).fit(data.x, data.t, data.groups)
    np.testing.assert_allclose(in_order(found.estimator_.coef_), TRUTH, atol=0.02)


@pytest.mark.nightly
def test_a_grid_search_over_recordings():
    search = GridSearchCV(
        TrajectoryIdentifier(estimator()),
        {"estimator__n_modes": [1, 2]},
        cv=KFold(2),
        error_score="raise",
    )
    search.fit(oscillator().recordings()[:4])
    assert search.best_params_["estimator__n_modes"] == 2


def test_a_pipeline_ends_with_it():
    data = oscillator()
    halved = FunctionTransformer(lambda x: x / 2.0)
    pipeline = make_pipeline(halved, TrajectoryIdentifier(estimator())).fit(data.x, data.t)
    np.testing.assert_allclose(in_order(pipeline[-1].estimator_.coef_), TRUTH, atol=0.01)


def test_a_copy_has_the_same_parameters_and_the_default_estimator_is_reached():
    given = clone(TrajectoryIdentifier(order=2, refine=False))
    assert (given.order, given.refine, given.estimator) == (2, False, None)
    assert given.set_params(estimator__n_modes=3).estimator.n_modes == 3


REFUSED = {
    "no t": (lambda d: (d.x,), {}, "t is missing"),
    "short": (lambda d: (d.x[:5], d.t[:5]), {}, "has 5 samples; at least 8"),
    "repeated": (lambda d: (d.x[:50], np.minimum(d.t[:50], 3.0)), {}, "repeats a time"),
    "backwards": (lambda d: (d.x[:50], np.r_[d.t[:30], d.t[20:40]]), {}, "goes back in time"),
    "reversed": (lambda d: (d.x[:50], d.t[49::-1]), {}, "recording 0 goes back in time at every"),
    "one of two reversed": (
        lambda d: ([{"t": d.t[:50], "x": d.x[:50]}, {"t": d.t[49::-1], "x": d.x[:50]}],),
        {},
        "^recording 1 goes back in time at every sample; sort its rows by time.$",
    ),
    "shuffled": (
        lambda d: (d.x[:50], np.random.default_rng(0).permutation(d.t[:50])),
        {},
        "recording 0 goes back in time at its sample .* sort the rows by time",
    ),
    "constant": (lambda d: (d.x * [1, 0] + [0, 2], d.t, d.groups), {}, "2 at all of its 726"),
    "nothing": (lambda d: (d.x * [1, np.nan], d.t, d.groups), {}, "holds no finite value"),
    "order": (lambda d: (d.x, d.t, d.groups), {"order": 3}, "order=3"),
    "observed": (lambda d: (d.x[:, 0], d.t, d.groups), {"observed": ["q", "v"]}, "StatedModel"),
    "no speeds": (
        lambda d: (d.x[:, 0], d.t, d.groups),
        {"order": 2, "estimator": estimator(feature_library=FunctionTransformer(np.sin))},
        "needs every speed",
    ),
    "map": (
        lambda d: (d.x, d.t, d.groups),
        {"estimator": SwitchingSystemRegressor(discrete_time=True)},
        "discrete_time=True",
    ),
    "refine": (lambda d: (d.x, d.t, d.groups), {"refine": 2}, "refine=2"),
    "twice": (lambda d: (d.recordings(), d.t), {}, "leave out t"),
    "no x": (lambda d: ([{"t": d.t}],), {}, "recording 0 has no x"),
    "u": (lambda d: ([{"t": d.t, "x": d.x, "u": d.x}],), {}, "recording 0 has 'u'; name it 'in"),
}


@pytest.mark.parametrize(
    ("columns", "inputs", "expected"),
    [
        (["p", "v"], None, ["p", "v", "x2"]),
        (None, ["F"], ["x0", "x1", "F"]),
        (["p", "v"], ["F"], ["p", "v", "F"]),
        (None, None, ["x0", "x1", "x2"]),
    ],
)
def test_names_are_those_of_the_table_that_has_them(columns, inputs, expected):
    """And what is known may be said by them."""
    pandas = pytest.importorskip("pandas")
    t = np.arange(0.0, 5.0, 0.05)
    u, x = np.sin(t)[:, None], np.column_stack([1.0 - np.cos(t), np.sin(t)])
    x, u = (
        one if names is None else pandas.DataFrame(one, columns=names)
        for one, names in ((x, columns), (u, inputs))
    )
    switching = SwitchingSystemRegressor(1, feature_library=1, random_state=0)
    known = f"{expected[0]}' = {expected[1]}"
    found = TrajectoryIdentifier(switching, known=known).fit(x, t, inputs=u)
    assert found.equations(1)[0] == f"mode 0: {known.replace('= ', '= 1.0 ')}"
    unnamed = columns is None and inputs is None
    names = getattr(found.estimator_, "feature_names_in_", None)
    assert names is None if unnamed else list(names) == expected


@pytest.mark.parametrize("case", REFUSED)
def test_a_wrong_call_ends_in_one_sentence(case):
    given, options, words = REFUSED[case]
    with pytest.raises(ValueError, match=words) as refusal:
        TrajectoryIdentifier(**options).fit(*given(oscillator()))
    assert "\n" not in str(refusal.value)


def test_an_estimator_of_another_kind_is_refused():
    with pytest.raises(TypeError, match="SwitchingSystemRegressor"):
        TrajectoryIdentifier(PolynomialSurfaceClassifier()).fit(oscillator().recordings())


def test_what_a_law_lacks_is_said():
    """A cubic spring, told to be linear."""
    data = record(PLANTS["one mode, cubic spring"], Scenario(NOISE, 60, 4), 2)
    found = TrajectoryIdentifier(estimator(n_modes=1)).fit(data.x, data.t, data.groups)
    assert "times its noise" in found.report_.advice
    assert found.report_.samples_that_count_as_one > 2.0
