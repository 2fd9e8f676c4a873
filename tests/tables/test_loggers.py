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


def test_channels_of_a_tdms_file_begin_at_their_own_instants(tmp_path):
    nptdms = pytest.importorskip("nptdms")
    ten = np.datetime64("2026-11-30T10:00:00", "us")
    starts = {
        "x": ten + np.timedelta64(250, "ms"),
        "y": ten + np.timedelta64(250, "ms"),
        "u": ten,
        "w": np.datetime64("1904-01-01T00:00:00", "us"),  # LabVIEW's zero: nobody set it
    }
    with nptdms.TdmsWriter(tmp_path / "log.tdms") as file:
        file.write_segment([
            nptdms.ChannelObject(f"of {name}", name, np.arange(8.0) + k,
                                 {"wf_increment": 0.5, "wf_start_time": start})
            for k, (name, start) in enumerate(starts.items())
        ])  # fmt: skip
    [run] = read_recordings(tmp_path / "log.tdms", states=list(starts))
    instants = {"x": 0.25, "y": 0.25, "u": 0.0, "w": 0.0}
    for k, (name, first) in enumerate(instants.items()):
        there = run["x"][name].notna().to_numpy()
        np.testing.assert_allclose(run["t"][there], first + 0.5 * np.arange(8), atol=1e-12)
        np.testing.assert_array_equal(run["x"][name][there], np.arange(8.0) + k)


def test_times_of_pytables_are_read_where_numpy_has_no_type_for_them(tmp_path):
    h5py = pytest.importorskip("h5py")
    # by hand as PyTables writes Time64: microseconds, then seconds, in one number of HDF5's time
    t = np.array([-1.25, 0.0, 0.5, 1.000001, 1.7e9])
    seconds = np.trunc(t).astype("<i4")
    parts = np.column_stack([np.round((t - seconds) * 1e6).astype("<i4"), seconds])
    with h5py.File(tmp_path / "log.h5", "w") as file:
        kind, space = h5py.h5t.UNIX_D64LE, h5py.h5s.create_simple(t.shape)
        written = h5py.h5d.create(file.id, b"t", kind, space)
        written.write(h5py.h5s.ALL, h5py.h5s.ALL, np.ascontiguousarray(parts), mtype=kind)
        file["x"] = np.arange(5.0)
        file["nothing"] = h5py.Empty("f8")
    [run] = read_recordings(tmp_path / "log.h5", states=["x"])
    np.testing.assert_allclose(run["t"], t, rtol=1e-15, atol=1e-12)
    np.testing.assert_array_equal(run["x"]["x"], np.arange(5.0))


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
