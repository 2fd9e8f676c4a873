"""Time and memory of reading recordings, beside the format's own reader.

``python -m benchmarks.speed.reading --rows 1000000`` writes a file of each format (t, x, v, u),
reads it by its own package and by `read_recordings`, each in a process of its own, and prints
seconds, their ratio, and the peak of the memory (or that of this process, if it is larger). Files
of messages, which their packages read one by one in Python, have a twentieth of the rows.
"""

from __future__ import annotations

import argparse
import resource
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

NAMES = ("x", "v", "u")
DBC = """VERSION ""
BU_: ECU
BO_ 16 Body: 8 ECU
 SG_ x : 0|16@1- (0.001,0) [0|0] "m" ECU
 SG_ v : 16|16@1- (0.001,0) [0|0] "m/s" ECU
 SG_ u : 32|16@1- (0.001,0) [0|0] "N" ECU
"""


def columns(rows: int) -> dict[str, np.ndarray]:
    """Times and channels."""
    t = np.arange(rows) * 1e-3
    return {"t": t, "x": np.sin(t), "v": np.cos(t), "u": np.sign(np.sin(3 * t))}


# --- files, by the formats' own packages where they write -----------------------------------------


def write_csv(path: Path, known: dict[str, np.ndarray]) -> None:
    """Text."""
    import pandas as pd

    pd.DataFrame(known).to_csv(path, index=False)


def write_npz(path: Path, known: dict[str, np.ndarray]) -> None:
    """Arrays."""
    np.savez(path, **known)


def write_mat(path: Path, known: dict[str, np.ndarray]) -> None:
    """MATLAB 7."""
    from scipy.io import savemat

    savemat(path, known, do_compression=True)


def write_modelica(path: Path, known: dict[str, np.ndarray]) -> None:
    """As Dymola writes results."""
    from scipy.io import savemat

    def words(names: list[str]) -> np.ndarray:
        wide = [name.ljust(max(map(len, names))) for name in names]
        return np.array(["".join(row) for row in zip(*wide, strict=True)])

    n = len(known)
    places = [[2 if k else 0 for k in range(n)], range(1, n + 1), [0] * n, [-1] * n]
    savemat(path, {
        "Aclass": np.array(["Atrajectory", "1.1        ", "           ", "binTrans   "]),
        "name": words(["Time", *NAMES]), "description": np.array([" " * n]),
        "dataInfo": np.array([list(row) for row in places], dtype=np.int32),
        "data_1": np.array([[0.0, 1.0]]), "data_2": np.array(list(known.values())),
    }, format="4")  # fmt: skip


def write_hdf5(path: Path, known: dict[str, np.ndarray]) -> None:
    """A data set a column."""
    import h5py

    with h5py.File(path, "w") as file:
        for name, column in known.items():
            file.create_dataset(name, data=column, compression="gzip")


def write_mdf(path: Path, known: dict[str, np.ndarray]) -> None:
    """One group."""
    import asammdf

    with asammdf.MDF(version="4.10") as file:
        file.append([asammdf.Signal(known[name], known["t"], name=name) for name in NAMES])
        file.save(path, overwrite=True)


def write_tdms(path: Path, known: dict[str, np.ndarray]) -> None:
    """Waveforms."""
    import nptdms

    told = {"wf_increment": 1e-3, "wf_start_offset": 0.0}
    with nptdms.TdmsWriter(path) as file:
        file.write_segment([nptdms.ChannelObject("log", n, known[n], told) for n in NAMES])


def write_ulog(path: Path, known: dict[str, np.ndarray]) -> None:
    """One topic."""

    def message(kind: str, content: bytes) -> bytes:
        return struct.pack("<HB", len(content), ord(kind)) + content

    kinds = [
        ("size", "<u2"),
        ("kind", "u1"),
        ("id", "<u2"),
        ("t", "<u8"),
        *((n, "<f8") for n in NAMES),
    ]
    rows = np.zeros(len(known["t"]), dtype=kinds)
    rows["size"], rows["kind"], rows["t"] = rows.itemsize - 3, ord("D"), known["t"] * 1e6
    for name in NAMES:
        rows[name] = known[name]
    fields = b"rig:uint64_t timestamp;double x;double v;double u;"
    path.write_bytes(
        b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0) + message("B", bytes(40))
        + message("F", fields) + message("A", struct.pack("<BH", 0, 0) + b"rig") + rows.tobytes()
    )  # fmt: skip


def write_comtrade(path: Path, known: dict[str, np.ndarray]) -> None:
    """Binary data beside a .cfg."""
    rows = len(known["t"])
    kinds = [("n", "<u4"), ("t", "<u4"), *((n, "<i2") for n in NAMES)]
    data = np.zeros(rows, dtype=kinds)
    data["n"], data["t"] = np.arange(rows) + 1, known["t"] * 1e6
    for name in NAMES:
        data[name] = known[name] * 1e4
    path.with_suffix(".dat").write_bytes(data.tobytes())
    told = "".join(f"{k},{n},,,m,0.0001,0,0,-32767,32767,1,1,P\n" for k, n in enumerate(NAMES, 1))
    path.write_text(
        f"station,1,1999\n3,3A,0D\n{told}50\n1\n1000,{rows}\n"
        "01/01/2024,00:00:00.000000\n01/01/2024,00:00:00.000000\nBINARY\n1\n"
    )


def write_mcap(path: Path, known: dict[str, np.ndarray]) -> None:
    """A topic of ROS 2."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store, kind = get_typestore(Stores.LATEST), "geometry_msgs/msg/Point"
    with Writer(path.with_suffix(""), version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        link = bag.add_connection("/rig", kind, typestore=store)
        for t, *values in zip(*(known[name].tolist() for name in ("t", *NAMES)), strict=True):
            raw = store.serialize_cdr(store.types[kind](*values), kind)
            bag.write(link, 10**18 + int(t * 1e9), raw)
    next(path.with_suffix("").glob("*.mcap")).rename(path)


def write_blf(path: Path, known: dict[str, np.ndarray]) -> None:
    """Frames beside a .dbc."""
    import can
    import cantools

    path.with_name("rig.dbc").write_text(DBC)
    database = cantools.database.load_string(DBC)
    with can.Logger(str(path)) as log:
        for t, *values in zip(*(known[name].tolist() for name in ("t", *NAMES)), strict=True):
            data = database.encode_message("Body", dict(zip(NAMES, values, strict=True)))
            log(can.Message(timestamp=t, arbitration_id=16, data=data, is_extended_id=False))


# --- what the formats' own packages do ------------------------------------------------------------


def own_csv(path: Path) -> None:
    """Pandas."""
    import pandas as pd

    pd.read_csv(path)


def own_npz(path: Path) -> None:
    """NumPy."""
    with np.load(path) as archive:
        _ = [archive[name] for name in archive]


def own_mat(path: Path) -> None:
    """SciPy."""
    from scipy.io import loadmat

    loadmat(path)


def own_hdf5(path: Path) -> None:
    """h5py."""
    import h5py

    with h5py.File(path) as file:
        _ = [file[name][()] for name in file]


def own_mdf(path: Path) -> None:
    """Asammdf."""
    import asammdf

    with asammdf.MDF(path) as file:
        _ = [file.get(name) for name in NAMES]


def own_tdms(path: Path) -> None:
    """NpTDMS."""
    import nptdms

    _ = [
        channel[:] for group in nptdms.TdmsFile.read(path).groups() for channel in group.channels()
    ]


def own_ulog(path: Path) -> None:
    """Pyulog."""
    import pyulog

    pyulog.ULog(str(path))


def own_comtrade(path: Path) -> None:
    """Comtrade."""
    import comtrade

    comtrade.Comtrade(use_double_precision=True, use_numpy_arrays=True).load(str(path))


def own_mcap(path: Path) -> None:
    """Rosbags."""
    from rosbags.highlevel import AnyReader

    with AnyReader([path]) as bag:
        _ = [bag.deserialize(raw, link.msgtype) for link, _, raw in bag.messages()]


def own_blf(path: Path) -> None:
    """python-can and cantools."""
    import can
    import cantools

    database = cantools.database.load_file(path.with_name("rig.dbc"))
    with can.LogReader(str(path)) as log:
        _ = [database.decode_message(frame.arbitration_id, frame.data) for frame in log]


#: The ending, how a file is written, how its own package reads it, and the share of the rows.
FORMATS: dict[str, tuple[str, Callable, Callable, float]] = {
    "text": (".csv", write_csv, own_csv, 1.0),
    "NumPy": (".npz", write_npz, own_npz, 1.0),
    "MATLAB 7": (".mat", write_mat, own_mat, 1.0),
    "Modelica": (".mat", write_modelica, own_mat, 1.0),
    "HDF5": (".h5", write_hdf5, own_hdf5, 1.0),
    "MDF 4": (".mf4", write_mdf, own_mdf, 1.0),
    "TDMS": (".tdms", write_tdms, own_tdms, 1.0),
    "ULog": (".ulg", write_ulog, own_ulog, 1.0),
    "COMTRADE": (".cfg", write_comtrade, own_comtrade, 1.0),
    "MCAP": (".mcap", write_mcap, own_mcap, 0.05),
    "CAN": (".blf", write_blf, own_blf, 0.05),
}


def measured(name: str, how: str, path: Path) -> None:
    """Print seconds and the peak of the memory in MiB, what is loaded before reading left out."""
    from swsysid import read_recordings

    own = FORMATS[name][2]
    other = [path.with_name("rig.dbc")] if name == "CAN" else []
    options = {"time": "t"} if name not in ("Modelica", "ULog", "MCAP") else {}
    states = [f"rig.{n}" for n in (("x", "y", "z") if name == "MCAP" else NAMES)]
    states = states if name in ("ULog", "MCAP") else list(NAMES)
    # packages are loaded by a first reading of nothing, as in a session that has read before
    for _ in range(2):
        start = time.perf_counter()
        own(path) if how == "own" else read_recordings([path, *other], states=states, **options)
        seconds = time.perf_counter() - start
    print(seconds, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)


def main() -> None:
    """Print a line for each format."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=1_000_000)
    parser.add_argument("--only", nargs="+", choices=FORMATS, default=list(FORMATS))
    parser.add_argument("--one", nargs=3)
    arguments = parser.parse_args()
    if arguments.one:
        measured(arguments.one[0], arguments.one[1], Path(arguments.one[2]))
        return
    print("format          rows  own reader [s]  read_recordings [s]  ratio  peak [MiB]")
    for name in arguments.only:
        ending, write, _, share = FORMATS[name]
        rows = int(share * arguments.rows)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, f"log{ending}")
            write(path, columns(rows))
            found = {}
            for how in ("own", "ours"):
                command = [sys.executable, "-m", "benchmarks.speed.reading", "--one", name, how]
                done = subprocess.run([*command, str(path)], capture_output=True, text=True)
                if done.returncode:
                    sys.exit(f"{name}: {done.stderr.strip().splitlines()[-1]}")
                found[how] = [float(one) for one in done.stdout.split()]
        (own, _), (ours, peak) = found["own"], found["ours"]
        print(f"{name:<10}{rows:>10,}{own:>16.2f}{ours:>21.2f}{ours / own:>7.2f}{peak:>12.0f}")


if __name__ == "__main__":
    main()
