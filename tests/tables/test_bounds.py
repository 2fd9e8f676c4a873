"""Files that unpack to more than memory should hold, are cut or foreign, or bring code along."""

import gzip
import os
import pickle

import h5py
import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

from swsysid import HybridAutomaton, read_recordings
from swsysid._tables import bounds

T = np.linspace(0.0, 1.0, 400)
FRAME = pd.DataFrame({"t": T, "x": T**2})


def _hdf5(path):
    with h5py.File(path, "w") as file:
        for name, column in FRAME.items():
            file.create_dataset(name, data=column, compression="gzip")


WRITERS = {
    "log.csv": lambda path: FRAME.to_csv(path, index=False),
    "log.csv.gz": lambda path: path.write_bytes(gzip.compress(FRAME.to_csv(index=False).encode())),
    "log.npz": lambda path: np.savez_compressed(path, t=T, x=T**2),
    "log.xlsx": lambda path: FRAME.to_excel(path, index=False),
    "log.parquet": lambda path: FRAME.to_parquet(path),
    "log.mat": lambda path: savemat(path, {"t": T, "x": T**2}, do_compression=True),
    "log.h5": _hdf5,
    "log.fmu": lambda path: HybridAutomaton.stated([{"x": "-x"}], states=["x"]).to_fmu(path),
}


@pytest.mark.parametrize("name", WRITERS)
def test_what_would_fill_the_memory_is_refused(name, tmp_path, monkeypatch):
    if name.endswith("parquet"):
        pytest.importorskip("pyarrow")
    WRITERS[name](tmp_path / name)
    monkeypatch.setattr(bounds, "LARGEST", 2000)
    with pytest.raises(ValueError, match="unpacks to more than .* keep fewer rows or channels"):
        read_recordings(tmp_path / name, states=["x"])


@pytest.mark.parametrize("name", sorted({*WRITERS} - {"log.fmu", "log.csv"}))
def test_cut_and_foreign_files_are_one_sentence(name, tmp_path):
    if name.endswith("parquet"):
        pytest.importorskip("pyarrow")
    WRITERS[name](tmp_path / name)
    content = (tmp_path / name).read_bytes()
    for wrong in (content[: len(content) // 2], b"\x00\x01 nothing", b""):
        (tmp_path / name).write_bytes(wrong)
        with pytest.raises(ValueError, match=name) as told:
            read_recordings(tmp_path / name, states=["x"])
        assert "\n" not in str(told.value)


class _Opens:
    """Makes a folder where it is unpickled."""

    def __init__(self, path):
        self.path = str(path)

    def __reduce__(self):
        return os.mkdir, (self.path,)


def test_pickles_are_never_opened(tmp_path):
    trap = tmp_path / "opened"
    np.savez(tmp_path / "inside.npz", t=T, x=np.array([_Opens(trap)], dtype=object))
    (tmp_path / "alone.npz").write_bytes(pickle.dumps(_Opens(trap)))
    savemat(tmp_path / "bytes.mat", {"t": np.frombuffer(pickle.dumps(_Opens(trap)), np.uint8)})
    with h5py.File(tmp_path / "inside.h5", "w") as file:
        file["x"] = np.void(pickle.dumps(_Opens(trap)))
        file["t"] = T
    for name in ("inside.npz", "alone.npz", "bytes.mat", "inside.h5"):
        with pytest.raises(ValueError, match=name):
            read_recordings(tmp_path / name, states=["x"])
    assert not trap.exists()
    assert pickle.loads(pickle.dumps(_Opens(trap))) is None and trap.exists()  # it would have
