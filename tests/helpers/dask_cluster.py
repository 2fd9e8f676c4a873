"""A cluster of two workers on this machine."""

from contextlib import contextmanager

import numpy as np
import pytest

# As docs/large_data.md recommends: with Dask's own threshold fits spend half their time on memory.
SETTING = {"distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": None}


@contextmanager
def two_workers():
    """Two processes of one thread each."""
    dask = pytest.importorskip("dask")
    distributed = pytest.importorskip("dask.distributed")
    with (
        dask.config.set(SETTING),
        distributed.LocalCluster(
            n_workers=2,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",  # any free port: others may run a cluster too
            silence_logs=50,  # a worker that is killed is told of
        ) as cluster,
    ):
        yield cluster


def executed(client):
    """Tasks that each worker has run so far."""
    counts = client.run(lambda dask_worker: dask_worker.state.executed_count)
    return np.array([counts[name] for name in sorted(counts)])
