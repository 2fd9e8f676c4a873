"""Fits of Dask arrays on a cluster: bit-equal to those without one, though workers are lost."""

import os
import signal

import numpy as np
import pytest
from dask_cluster import executed, two_workers
from many_rows import fitted, oscillator, take_for_many

dask = pytest.importorskip("dask")
distributed = pytest.importorskip("dask.distributed")
da = pytest.importorskip("dask.array")

ANSWER = ("coef_", "modes_", "membership_", "objective_")


@pytest.fixture(scope="module")
def cluster():
    with two_workers() as cluster:
        yield cluster


@pytest.fixture
def client(cluster):
    with distributed.Client(cluster) as client:
        yield client


@pytest.fixture(autouse=True)
def many(monkeypatch):
    take_for_many(monkeypatch)


def chunked(X, Xdot, size=500):
    return da.from_array(X, chunks=(size, 2)), da.from_array(Xdot, chunks=(size, 2))


def alone(*arguments, **options):
    """A fit in this process, whatever clusters there are."""
    with dask.config.set(scheduler="threads"):
        return fitted(*arguments, **options)


def assert_bit_equal(one, two):
    for name in ANSWER:
        assert np.array_equal(getattr(one, name), getattr(two, name)), name
    records = [[(each.objective, each.loss) for each in model.history_] for model in (one, two)]
    assert records[0] == records[1]


@pytest.mark.parametrize("loss", ["l1", "l2", "squared"])
def test_cluster_gives_what_one_process_gives(client, loss):
    X, Xdot, _ = oscillator()
    arrays, before = chunked(X, Xdot), executed(client)
    spread = fitted(*arrays, loss=loss)
    assert (executed(client) > before).all()  # both workers had work
    assert_bit_equal(spread, alone(*arrays, loss=loss))
    whole = fitted(X, Xdot, loss=loss)
    assert np.array_equal(spread.modes_, whole.modes_)
    assert np.abs(spread.coef_ - whole.coef_).max() < 1e-9


def test_weights_groups_and_arrays_on_the_workers(client):
    X, Xdot, _ = oscillator()
    weight = np.random.default_rng(0).integers(0, 3, len(X)).astype(float)
    options = {
        "sample_weight": da.from_array(weight, chunks=700),
        "groups": np.repeat(np.arange(40), 100),
        "coupling": 0,
    }
    arrays = chunked(X, Xdot)
    persisted = client.persist(arrays)
    distributed.wait(persisted)
    spread = fitted(*persisted, **options)
    assert_bit_equal(spread, alone(*arrays, **options))
    whole = fitted(X, Xdot, sample_weight=weight, coupling=0)
    assert np.array_equal(spread.modes_, whole.modes_)


def test_arrays_of_unknown_length(client):
    X, Xdot, _ = oscillator()
    A, Y = chunked(X, Xdot)
    kept = A[:, 1] > -2.0
    spread = fitted(A[kept], Y[kept])
    assert_bit_equal(spread, alone(A[kept], Y[kept]))
    assert len(spread.modes_) == np.sum(X[:, 1] > -2.0)


@pytest.mark.parametrize(("loss", "time"), [("l1", 0), ("l1", 3), ("squared", 3)])
def test_a_killed_worker_changes_nothing(client, tmp_path, loss, time):
    """The third block kills its worker, once: when it is read for the first or the fourth time."""
    X, Xdot, _ = oscillator()
    first = X[1000, 0]

    def deadly(block):
        if len(block) and block[0, 0] == first:
            count = len(list(tmp_path.iterdir()))
            (tmp_path / str(count)).touch()
            if count == time:
                os.kill(os.getpid(), signal.SIGKILL)
        return block

    A, Y = chunked(X, Xdot)
    doomed = A.map_blocks(deadly, meta=np.empty((0, 2)))
    before = set(client.run(os.getpid).values())
    spread = fitted(doomed, Y, loss=loss)
    client.wait_for_workers(2)
    assert len(set(client.run(os.getpid).values()) - before) == 1
    assert len(list(tmp_path.iterdir())) > time + 1  # the block was read again
    assert_bit_equal(spread, alone(A, Y, loss=loss))


def test_data_that_make_no_sense_are_refused(client):
    X, Xdot, _ = oscillator()
    X[2007, 1] = np.nan
    with pytest.raises(ValueError, match="Block 4: Input X contains NaN"):
        fitted(*chunked(X, Xdot))
