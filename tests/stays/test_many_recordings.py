"""Many recordings that are read where they are worked on: the answer is that of all of them."""

import os
import pickle
import signal
from functools import partial

import numpy as np
import pytest
from dask_cluster import executed, two_workers

from swsysid import SwitchingSystemRegressor, TrajectoryIdentifier
from swsysid._data.recordings import many_recordings
from swsysid._stays.condensed import Shared
from swsysid.refinement import StatedModel, StatedSurface

dask = pytest.importorskip("dask")
distributed = pytest.importorskip("dask.distributed")
bag = pytest.importorskip("dask.bag")

PLANT = StatedModel(
    None, [[[0, 1], [-1, -0.1]], [[0, 1], [-4, -0.1]]],
    states=["x", "v"], surface=StatedSurface([[0, 1, 0]], 1),
)  # fmt: skip
N, T, NOISE = 6, np.linspace(0.0, 7.0, 101), 0.01
ANSWER = ("coef_errors_", "surface_errors_", "modes_", "noise_")


def recording(number):
    """A swing of a mass whose spring is softer on one side."""
    rng = np.random.default_rng(number)
    x = PLANT.simulate(rng.uniform(-2.0, 2.0, 2), T).x
    return {"t": T, "x": x + NOISE * rng.standard_normal(x.shape)}


def some(first, count):
    return [recording(number) for number in range(first, first + count)]


def identifier(**options):
    return TrajectoryIdentifier(
        SwitchingSystemRegressor(sparsity="auto", random_state=0, **options)
    )


@pytest.fixture(scope="module")
def known():
    """The answer to all in memory, side by side."""
    return identifier().fit(some(0, N))


@pytest.fixture(autouse=True)
def few(monkeypatch):
    """Every second recording begins."""
    monkeypatch.setattr("swsysid._trajectory_identifier._OF_MANY", N // 2 * len(T))


@pytest.fixture(scope="module")
def one_by_one():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("swsysid._trajectory_identifier._OF_MANY", N // 2 * len(T))
        return identifier().fit([partial(recording, number) for number in range(N)])


def assert_bit_equal(one, other):
    for name in ANSWER:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    np.testing.assert_array_equal(one.estimator_.coef_, other.estimator_.coef_)
    np.testing.assert_array_equal(one.estimator_.surface_.coef_, other.estimator_.surface_.coef_)
    for own, theirs in zip(one.switch_times_, other.switch_times_, strict=True):
        np.testing.assert_array_equal(own, theirs)


@pytest.mark.nightly
def test_what_single_recordings_say_adds_up_to_what_all_say(known, one_by_one):
    free = known.coef_errors_ > 0.0
    off = np.abs(one_by_one.estimator_.coef_ - known.estimator_.coef_)  # .02 nats: .2 errors
    assert (off <= 0.1 * known.coef_errors_).all()
    ratio = one_by_one.coef_errors_[free] / known.coef_errors_[free]
    np.testing.assert_allclose(ratio, 1.0, atol=0.05)
    assert (one_by_one.coef_errors_ > 0.0).tolist() == free.tolist()
    np.testing.assert_allclose(one_by_one.noise_, known.noise_, rtol=0.02)
    assert np.mean(one_by_one.modes_ == known.modes_) > 0.995
    assert len(one_by_one.switch_times_) == N
    report = one_by_one.report_
    assert (report.n_recordings, report.n_samples) == (N, N * len(T))
    with pytest.raises(AttributeError, match="a fit of many"):
        _ = one_by_one.verdict_


def test_parts_of_several_recordings_change_nothing(one_by_one):
    parts = [partial(some, 0, 3), partial(some, 3, 1), list, partial(some, 4, N - 4)]
    assert_bit_equal(identifier().set_params(n_jobs=2).fit(parts), one_by_one)


def test_what_travels_is_small():
    sent, original = [], Shared.condensed

    def condensed(self, number, recording):
        answer = original(self, number, recording)
        sent.append((len(pickle.dumps(self)), len(pickle.dumps(answer.without_modes))))
        return answer

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Shared, "condensed", condensed)
        identifier().fit([partial(recording, number) for number in range(2)])
    assert np.max(sent, axis=0)[0] < 10_000 and np.max(sent, axis=0)[1] < 2_000  # bytes


@pytest.fixture(scope="module")
def cluster():
    with two_workers() as cluster:
        yield cluster


@pytest.fixture
def client(cluster):
    with distributed.Client(cluster) as client:
        yield client


def test_a_bag_on_a_cluster_gives_what_one_process_gives(client, one_by_one):
    before = executed(client)
    recordings = bag.from_sequence(range(N), npartitions=4).map(recording)
    assert_bit_equal(identifier().fit(recordings), one_by_one)
    assert (executed(client) > before).all()  # both workers had work


def test_a_killed_worker_changes_nothing(client, one_by_one, tmp_path, time=4):
    """The third recording kills its worker, once: when it is asked what it says of the laws."""

    def deadly(number):
        if number == 2:
            count = len(list(tmp_path.iterdir()))
            (tmp_path / str(count)).touch()
            if count == time:
                os.kill(os.getpid(), signal.SIGKILL)
        return recording(number)

    before = set(client.run(os.getpid).values())
    found = identifier().fit([dask.delayed(deadly)(number) for number in range(N)])
    client.wait_for_workers(2)
    assert len(set(client.run(os.getpid).values()) - before) == 1
    assert len(list(tmp_path.iterdir())) > time + 1  # it was read again
    assert_bit_equal(found, one_by_one)


def test_held_inputs_and_positions_alone_are_worked_on():
    def forced(number):
        rng = np.random.default_rng(number)
        u = np.repeat(rng.normal(size=12), 10)[:120, None]
        t = 0.05 * np.arange(120)
        x, v = np.zeros((120, 2)), rng.normal(size=2)
        for k in range(120):  # a damped mass, exactly from row to row
            x[k] = v
            for _ in range(50):
                v = v + 0.001 * np.array([v[1], -2.0 * v[0] - 0.4 * v[1] + 3.0 * u[k, 0]])
        noisy = x[:, :1] + 0.002 * rng.standard_normal((120, 1))
        return {"t": t, "x": noisy, "inputs": u}

    found = TrajectoryIdentifier(
        SwitchingSystemRegressor(1, feature_library=1, sparsity="auto", random_state=0),
        order=2, input_hold="zero",
    ).fit([partial(forced, number) for number in range(4)])  # fmt: skip
    law = found.estimator_.coef_[0, 1]
    assert (np.abs(law - [0.0, -2.0, -0.4, 3.0]) <= 3.0 * found.coef_errors_[0, 1] + 0.01).all()


@pytest.mark.parametrize(
    ("listed", "arguments", "error", "sentence"),
    [
        ([partial(some, 0, 2)], {"t": T}, ValueError, "leave out t, groups and inputs"),
        ([list], {}, ValueError, "x holds no recording"),
        ([partial(np.zeros, 3)], {}, TypeError, "recording 0 is a float64; give a dict with t, x"),
        (
            [partial(recording, 0), lambda: {"t": T[:5], "x": recording(0)["x"][:5]}],
            {}, ValueError, "recording 1 has 5 samples",
        ),
    ],
)  # fmt: skip
def test_recordings_that_make_no_sense_are_refused(listed, arguments, error, sentence):
    with pytest.raises(error, match=sentence):
        identifier().fit(listed, **arguments)


@pytest.mark.nightly
def test_a_list_in_memory_is_no_such_source():
    assert many_recordings(some(0, 2)) is None and many_recordings(np.zeros((3, 2))) is None
