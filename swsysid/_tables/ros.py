"""ROS bags of both generations and MCAP files: each topic is a table of the numbers in it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from operator import attrgetter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swsysid._tables.table import Table, on_clock

BAG_FOLDER = "metadata.yaml"  # a folder that holds it is a bag of ROS 2
_LONGEST = 64  # numbers of an array that are channels; scans and pictures are none
_STAMP = ("header.stamp.sec", "header.stamp.nanosec")


def read_ros(path: Path, described: Sequence[Path]) -> Iterator[Table]:
    """Topics, their fields called ``topic.field``; seconds since the start of the bag.

    The instants are those of the messages' stamps; where there are none, or they lie outside the
    time of the bag and so are of another clock, those at which it received them.
    """
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as bag:
        found: dict[str, list[tuple[int, object]]] = {}
        for connection, received, raw in bag.messages():
            if connection.msgtype in bag.typestore.fielddefs:
                message = bag.deserialize(raw, connection.msgtype)
                found.setdefault(connection.topic, []).append((received, message))
        for topic, told in found.items():
            arrived = np.array([instant for instant, _ in told])
            messages = [message for _, message in told]
            columns = dict(_numbers(messages))
            t: NDArray = (arrived - bag.start_time) * 1e-9
            if set(_STAMP) <= set(columns):
                seconds, nano = (columns.pop(name).astype(np.int64) for name in _STAMP)
                stamp: NDArray = (seconds * 10**9 + nano - bag.start_time) * 1e-9
                t = stamp if 0.0 <= np.median(stamp) <= t[-1] else t
            if columns:
                label = topic.strip("/").replace("/", ".")
                yield on_clock(path, t, {f"{label}.{n}": one for n, one in columns.items()}, {})


def _numbers(messages: Sequence[object]) -> Iterator[tuple[str, NDArray]]:
    """The numbers in some messages of one type, by their place in it."""
    for name in _places(messages[0], ""):
        values = list(map(attrgetter(name), messages))
        if np.ndim(values[0]) == 0:
            yield name, np.array(values)
        elif len(set(map(len, values))) == 1 and 0 < np.size(values[0]) <= _LONGEST:
            for place, column in enumerate(np.array(values).T):
                yield f"{name}_{place}", column


def _places(message: object, before: str) -> Iterator[str]:
    """Where a message has numbers and arrays of them."""
    for name, value in vars(message).items():
        if name.startswith("_"):
            continue
        match value:
            case int() | float() | np.ndarray():
                yield before + name
            case object(__msgtype__=_):
                yield from _places(value, f"{before}{name}.")
