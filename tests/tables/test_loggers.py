"""Files of loggers, written by the formats' own packages and read as recordings."""

import gc
import sys

import numpy as np
import pytest
from logged_files import FAST, LOG_U, LOG_X, SLOW, write_hdf5, write_mdf, write_tdms

from swsysid import read_recordings

WRITERS = {
    "log.mf4": write_mdf,
    "log.tdms": write_tdms,
    "log.h5": write_hdf5,
    "log.mat": write_hdf5,
}


@pytest.mark.parametrize("name", WRITERS)
def test_channels_come_with_their_own_instants_and_units(name, tmp_path):
    WRITERS[name](tmp_path / name)
    runs = read_recordings(tmp_path / name, states=["x", "u"])
    [run] = runs
    x, u = run["x"].to_numpy().T
    np.testing.assert_allclose(run["t"][np.isfinite(x)], FAST, atol=1e-15)
    np.testing.assert_allclose(run["t"][np.isfinite(u)], SLOW, atol=1e-15)
    np.testing.assert_array_equal(x[np.isfinite(x)], LOG_X)
    np.testing.assert_array_equal(u[np.isfinite(u)], LOG_U)
    assert [one.unit for one in runs.columns] == ["m", "V"]


def test_samples_that_a_file_calls_invalid_are_missing(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    counts, at = np.arange(10), {"x": 4, "u": 7}  # as many in each
    signals = [
        asammdf.Signal(
            np.where(counts == lost, -9999, counts), FAST, name=name,
            invalidation_bits=counts == lost,
        )
        for name, lost in at.items()
    ]  # fmt: skip
    with asammdf.MDF(version="4.10") as file:
        file.append(signals)
        file.save(tmp_path / "log.mf4")
    [run] = read_recordings(tmp_path / "log.mf4", states=["x", "u"])
    for name, lost in at.items():
        np.testing.assert_array_equal(run["x"][name], np.where(counts == lost, np.nan, counts))


# asammdf's own finaliser fails on what it could not open
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("name", WRITERS)
def test_files_that_are_cut_or_foreign_are_refused(name, tmp_path):
    WRITERS[name](tmp_path / name)
    content = (tmp_path / name).read_bytes()
    for number, wrong in enumerate((content[: len(content) // 3], b"t,x\n0,1\n")):
        path = tmp_path / f"{number}_{name}"
        path.write_bytes(wrong)
        with pytest.raises(ValueError, match=path.name):
            read_recordings(path, states=["x"])
        gc.collect()
    with pytest.raises(ValueError, match=r"no column 'v'; its columns are: .*x \[m\]"):
        read_recordings(tmp_path / name, states=["v"])


@pytest.mark.parametrize(("name", "package", "words"), [
    ("a.mf4", "asammdf", "swsysid\\[mdf\\]"), ("a.tdms", "nptdms", "swsysid\\[tdms\\]"),
    ("a.h5", "h5py", "swsysid\\[hdf5\\]"),
])  # fmt: skip
def test_the_extra_that_is_missing_is_named(name, package, words, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    (tmp_path / name).write_bytes(b"anything")
    with pytest.raises(ValueError, match=words):
        read_recordings(tmp_path / name, states=["x"])
