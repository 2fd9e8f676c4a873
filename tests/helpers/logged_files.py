"""Files of simulators, drones, robots, relays, buses and loggers that hold what was planted.

Written by the formats' own packages where they write.
"""

import struct

import numpy as np
from scipy.io import savemat

from swsysid import HybridAutomaton

T = np.arange(0.0, 1.0, 0.125)  # exact in every clock of integers
X, V = T**2, 2.0 * T
FAST, SLOW = np.arange(0.0, 1.0, 0.1), np.arange(0.0, 1.0, 0.25) + 0.01
LOG_X, LOG_U = FAST**2, np.array([0.0, 1.0, 1.0, 0.0])


def _characters(words, layout="binNormal"):
    width = max(map(len, words))
    rows = [word.ljust(width) for word in words]
    turned = ["".join(row) for row in zip(*rows, strict=True)]
    return np.array(turned if layout == "binTrans" else rows)


def write_modelica(path, layout="binTrans"):
    """x at two rows of one time, its alias, one of the other sign, and a parameter."""
    t, x = np.append(T, T[-1]), np.append(X, 7.0)
    names = ["time", "body.x", "alias", "minus", "m"]
    parts = {
        "name": _characters(names, layout),
        "description": _characters(["Time in [s]", "place [m|mm]", "", "", "mass [kg]"], layout),
        "dataInfo": np.array([[0, 1, 0, -1], [2, 2, 0, -1], [2, 2, 0, -1], [2, -2, 0, -1],
                              [1, 2, 0, 0]], dtype=np.int32),
        "data_1": np.array([[t[0], 3.0], [t[-1], 3.0]]),
        "data_2": np.column_stack([t, x]),
    }  # fmt: skip
    if layout == "binTrans":
        parts = {n: one.T if one.ndim == 2 else one for n, one in parts.items()}
    savemat(path, {"Aclass": _characters(["Atrajectory", "1.1", "", layout]), **parts}, format="4")


def write_ulog(path):
    """Two topics with clocks of their own, the second with an array."""

    def message(kind, content):
        return struct.pack("<HB", len(content), ord(kind)) + content

    slow = [message("D", struct.pack("<HQ2f", 1, int(t * 1e6) + 10, 5.0, v))
            for t, v in zip(T[::2], V[::2], strict=True)]  # fmt: skip
    path.write_bytes(b"".join([
        b"ULog\x01\x12\x35\x01", struct.pack("<Q", 0), message("B", bytes(40)),
        message("F", b"state:uint64_t timestamp;float x;"),
        message("F", b"rate:uint64_t timestamp;float[2] v;"),
        message("A", struct.pack("<BH", 0, 0) + b"state"),
        message("A", struct.pack("<BH", 0, 1) + b"rate"),
        *(message("D", struct.pack("<HQf", 0, int(t * 1e6), x))
          for t, x in zip(T, X, strict=True)),
        *slow,
    ]))  # fmt: skip


def write_ros(path):
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.LATEST)
    kinds = "geometry_msgs/msg/PointStamped", "std_msgs/msg/Float64"
    stamped, plain = (store.types[kind] for kind in kinds)
    time, head = (store.types[k] for k in ("builtin_interfaces/msg/Time", "std_msgs/msg/Header"))
    point, start = store.types["geometry_msgs/msg/Point"], 1_700_000_000 * 10**9
    plugin = StoragePlugin.MCAP if path.suffix == ".mcap" else StoragePlugin.SQLITE3
    folder = path.with_suffix("")
    with Writer(folder, version=9, storage_plugin=plugin) as bag:
        links = [bag.add_connection(topic, kind, typestore=store)
                 for topic, kind in zip(("/rig/at", "/v"), kinds, strict=True)]  # fmt: skip
        for t, x, v in np.transpose([T, X, V]).tolist():
            ns = start + int(t * 1e9)
            sent = stamped(head(time(ns // 10**9, ns % 10**9), ""), point(x, 0.0, 0.0))
            # received a little late, which the stamps say
            bag.write(links[0], ns + 3_000_000 * int(t > 0), store.serialize_cdr(sent, kinds[0]))
            bag.write(links[1], ns, store.serialize_cdr(plain(v), kinds[1]))
    if path.suffix == ".mcap":
        [written] = folder.glob("*.mcap")
        written.rename(path)
    else:
        folder.rename(path)


def write_ros_1(path):
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    kind = "std_msgs/msg/Float64"
    with Writer(path) as bag:
        links = [bag.add_connection(topic, kind, typestore=store) for topic in ("/x", "/v")]
        for t, *values in np.transpose([T, X, V]).tolist():
            for link, value in zip(links, values, strict=True):
                raw = store.serialize_ros1(store.types[kind](value), kind)
                bag.write(link, 1_700_000_000 * 10**9 + int(t * 1e9), raw)


def write_comtrade(path):
    """Eight samples a second; the second channel is skewed by 125 us."""
    data = "".join(f"{k + 1},,{round(x * 64)},{round(v * 8)},{k % 2}\n"
                   for k, (x, v) in enumerate(zip(X, V, strict=True)))  # fmt: skip
    described = (
        "station,1,1999\n3,2A,1D\n1,x,,,m,0.015625,0,0,-32767,32767,1,1,P\n"
        "2,v,,,m/s,0.125,0,125,-32767,32767,1,1,P\n1,on,,,0\n50\n1\n8,8\n"
        "01/01/2024,00:00:00.000000\n01/01/2024,00:00:00.000000\nASCII\n1\n"
    )
    if path.suffix == ".cff":
        described = described.replace("1999", "2013").replace("ASCII\n1\n", "ASCII\n1\n0,0\n0,0\n")
        parts = ("CFG", described), ("INF", ""), ("HDR", ""), ("DAT ASCII", data)
        path.write_text("".join(f"--- file type: {kind} ---\n{text}" for kind, text in parts))
        return
    path.with_suffix(".dat").write_text(data)
    path.write_text(described)


DBC = """VERSION ""
BU_: ECU
BO_ 16 Body: 8 ECU
 SG_ x : 0|32@1- (0.015625,0) [0|0] "m" ECU
 SG_ Gear : 32|8@1+ (1,0) [0|0] "" ECU
BO_ 17 Rate: 8 ECU
 SG_ v : 0|16@1- (0.125,0) [0|0] "m/s" ECU
VAL_ 16 Gear 0 "neutral" 1 "first" ;
"""


def write_bus(path):
    import can
    import cantools

    path.with_name("car.dbc").write_text(DBC)
    database = cantools.database.load_string(DBC)
    with can.Logger(str(path)) as log:
        for k, (t, x, v) in enumerate(zip(T, X, V, strict=True)):
            body = database.encode_message("Body", {"x": x, "Gear": k % 2})
            rate = database.encode_message("Rate", {"v": v})
            for moment, number, data in ((t, 16, body), (t + 0.0625, 17, rate)):
                log(can.Message(timestamp=1000.0 + moment, arbitration_id=number, data=data,
                                is_extended_id=False))  # fmt: skip


def write_unit(path):
    HybridAutomaton.stated([{"T": "-0.5 T"}], states=["T"]).to_fmu(path)


def write_mdf(path):
    import asammdf

    with asammdf.MDF(version="4.10") as file:
        file.append([asammdf.Signal(LOG_X, FAST, name="x", unit="m")])
        file.append([asammdf.Signal(LOG_U, SLOW, name="u", unit="V")])
        file.save(path, overwrite=True)


def write_tdms(path):
    import nptdms

    channels = [
        nptdms.ChannelObject(
            "log", name, values,
            {"wf_increment": t[1] - t[0], "wf_start_offset": t[0], "unit_string": unit},
        )
        for name, values, t, unit in (("x", LOG_X, FAST, "m"), ("u", LOG_U, SLOW, "V"))
    ]  # fmt: skip
    with nptdms.TdmsWriter(path) as file:
        file.write_segment(channels)


def write_hdf5(path):
    import h5py

    with h5py.File(path, "w") as file:
        for name, values, t, unit in (("x", LOG_X, FAST, "m"), ("u", LOG_U, SLOW, "V")):
            group = file.create_group(f"group of {name}")
            group["t"] = t
            group[name] = values[None]  # as MATLAB writes a row
            group[name].attrs["units"] = unit
