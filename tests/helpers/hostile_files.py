"""Files of every format with something wrong in them, and how reading them ends.

    python tests/helpers/hostile_files.py FORMAT [FORMAT ...] FIRST LAST

A seed changes a good file: bytes flipped, cut, doubled, or filled; numbers that are huge, none, or
not finite; signs of the format out of place. Archives are also changed inside and packed again, and
a saved model is signed again, so that what is wrong gets past the sums that guard them. Each file
is read in a process of its own with bounds of memory and time. Printed is a line of JSON for each
that ends neither in what was asked for nor in a ValueError of one sentence.
"""

import gzip
import io
import json
import os
import resource
import signal
import sys
import tempfile
import traceback
import warnings
import zipfile
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path

import logged_files as files
import numpy as np
import pandas as pd
from scipy.io import savemat

from swsysid import HybridAutomaton, SwitchingSystemRegressor
from swsysid._saving.files import _checksum, load_model, save_model
from swsysid._tables import bounds
from swsysid._tables.fmu import _compile as compile_unit
from swsysid._tables.formats import read_tables

MEMORY, SECONDS = 3 * 2**30, 20  # of one file, the CPU's; ten times as many on the clock
T = np.linspace(0.0, 1.0, 40)
FRAME = pd.DataFrame({"t": T, "x [m]": T**2, "v": np.sin(T)})
NUMBERS = (b"1e308", b"-1e400", b"nan", b"-1", b"0", b"99999999999999999999", b"1e-320", b"", b"0x")
WORDS = (b'"', b",", b";", b"\n", b"\0", b"\xff", b"\xc3\xa9", b"<", b"&", b"/>", b"{", b"]", b"'",
         b"\\", b"=", b"%", b"-")  # fmt: skip


@dataclass(frozen=True)
class Kind:
    """How a good file is written, and how files are read."""

    write: Callable
    read: Callable = lambda path: read_tables(path, described=[*path.parent.glob("*.dbc")])


def _hysteresis() -> HybridAutomaton:
    return HybridAutomaton.stated(
        [{"h": "v", "v": "-9.81"}, {"h": "v", "v": "-9.81 - 0.1 v"}],
        [(0, 1, "h <= 0", {"v": "-0.8 v"}), (1, 0, "v >= 1")],
        states=["h", "v"],
    )  # fmt: skip


def _model(path):
    X = np.random.default_rng(0).uniform(-1.0, 1.0, (80, 2))
    y = np.where(X[:, :1] > 0.0, X @ [[0.0, -1.0], [1.0, -0.1]], -X)
    save_model(SwitchingSystemRegressor(2, n_init=2, random_state=0).fit(X, y), path)


def _unit(path):
    """With its program in it, which is never changed: it would be run."""
    files.write_unit(path)
    with tempfile.TemporaryDirectory() as folder:
        unit = Path(folder, "unit")
        with zipfile.ZipFile(path) as archive:
            archive.extractall(unit)
        compile_unit(unit, Path(folder, "build"))
        with zipfile.ZipFile(path, "w") as archive:
            for file in unit.rglob("*"):
                archive.write(file, file.relative_to(unit))


KINDS = {
    "log.csv": Kind(lambda path: FRAME.to_csv(path, index=False)),
    "log.csv.gz": Kind(lambda path: path.write_bytes(gzip.compress(FRAME.to_csv().encode()))),
    "log.npz": Kind(lambda path: np.savez(path, t=T, x=T**2)),
    "log.xlsx": Kind(lambda path: FRAME.to_excel(path, index=False)),
    "five.mat": Kind(lambda path: savemat(path, {"t": T, "x": T**2, "run": {"v": T}})),
    "log.h5": Kind(files.write_hdf5),
    "log.mf4": Kind(files.write_mdf),
    "log.tdms": Kind(files.write_tdms),
    "plant.mat": Kind(files.write_modelica),
    "flight.ulg": Kind(files.write_ulog),
    "run.mcap": Kind(files.write_ros),
    "old.bag": Kind(files.write_ros_1),
    "relay.cfg": Kind(files.write_comtrade),
    "relay.cff": Kind(files.write_comtrade),
    "drive.blf": Kind(files.write_bus),
    "drive.asc": Kind(files.write_bus),
    "drive.trc": Kind(files.write_bus),
    "model.json": Kind(_model, load_model),
    "automaton.json": Kind(
        lambda path: path.write_text(json.dumps(_hysteresis().to_dict())), load_model
    ),
    "plant.fmu": Kind(_unit),
    "ball.xml": Kind(lambda path: _hysteresis().to_spaceex(path), HybridAutomaton.from_spaceex),
}


# -- what may be wrong with a file -----------------------------------------------------------------


def changed(content: bytes, rng: np.random.Generator, name: str) -> bytes:
    """The file with one to three things wrong, inside where it is packed and half of the time."""
    if name.endswith(".json") and rng.random() < 0.8:
        return _other_values(content, rng)
    inside = rng.random() < 0.6 or name.endswith(".fmu")
    if inside and name.endswith(".gz"):
        return gzip.compress(_broken(gzip.decompress(content), rng))
    if inside and zipfile.is_zipfile(io.BytesIO(content)):
        return _packed_again(content, rng)
    return _broken(content, rng)


def _broken(content: bytes, rng: np.random.Generator) -> bytes:
    for _ in range(rng.integers(1, 4)):
        change = WRONG[rng.integers(len(WRONG))]
        content = change(content, rng) if content else content
    return content


def _stretch(content, rng):
    start = int(rng.integers(len(content)))
    return start, min(start + int(2 ** rng.uniform(0.0, 8.0)), len(content))


def _flipped(content, rng):
    places = rng.integers(len(content), size=rng.integers(1, 6))
    changed = np.frombuffer(content, np.uint8).copy()
    changed[places] ^= 1 << rng.integers(8, size=len(places)).astype(np.uint8)
    return changed.tobytes()


def _cut(content, rng):
    start, end = _stretch(content, rng)
    return content[:start] if rng.random() < 0.3 else content[:start] + content[end:]


def _doubled(content, rng):
    start, end = _stretch(content, rng)
    return content[:end] + content[start:end] * int(rng.integers(1, 20)) + content[end:]


def _filled(content, rng):
    start, end = _stretch(content, rng)
    fill = (b"\0", b"\xff", b"\x7f", b" ")[rng.integers(4)]
    return content[:start] + fill * (end - start) + content[end:]


def _binary_number(content, rng):
    numbers = (np.int32(-1), np.int32(2**31 - 1), np.int64(2**62), np.float64(np.nan),
               np.float64(1e308), np.float64(np.inf), np.int32(0), np.int16(2**15 - 1))  # fmt: skip
    raw = numbers[rng.integers(len(numbers))].tobytes()
    start = int(rng.integers(len(content)))
    return content[:start] + raw + content[start + len(raw) :]


def _number(content, rng):
    """A number in text is another one, or a word is put in where there is none."""
    digits = np.isin(np.frombuffer(content, np.uint8), np.frombuffer(b"0123456789.", np.uint8))
    starts = np.flatnonzero(digits & ~np.append(False, digits[:-1]))
    if not len(starts):
        return _word(content, rng)
    start = int(rng.choice(starts))
    rest = np.flatnonzero(~digits[start:])
    end = start + int(rest[0]) if len(rest) else len(content)
    return content[:start] + NUMBERS[rng.integers(len(NUMBERS))] + content[end:]


def _word(content, rng):
    start = int(rng.integers(len(content)))
    return content[:start] + WORDS[rng.integers(len(WORDS))] + content[start:]


def _line(content, rng):
    """A line, or an element of XML, that is missing, stands twice or elsewhere."""
    lines = content.split(b"\n")
    taken = lines.pop(int(rng.integers(len(lines))))
    for _ in range(rng.integers(3)):
        lines.insert(int(rng.integers(len(lines) + 1)), taken)
    return b"\n".join(lines)


WRONG = (_flipped, _cut, _doubled, _filled, _binary_number, _number, _number, _word, _line, _line)


def _packed_again(content: bytes, rng: np.random.Generator) -> bytes:
    """An archive of which one member is broken."""
    packed = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(content)) as before, zipfile.ZipFile(packed, "w") as after:
        names = before.namelist()
        told = "modelDescription.xml"  # of a unit
        chosen = told if told in names else names[rng.integers(len(names))]
        for name in names:
            member = before.read(name)
            after.writestr(name, _broken(member, rng) if name == chosen else member)
    return packed.getvalue()


def _other_values(content: bytes, rng: np.random.Generator) -> bytes:
    """A document of which values are others, with the sum that belongs to it."""
    whole = json.loads(content)
    for _ in range(rng.integers(1, 3)):
        place, key = _somewhere(whole, rng)
        others = (None, True, -1, 0, 1e308, 10**30, "", "nan", "swsysid.Known", "x", [], {}, [[]],
                  [0], {"list": [1]}, place)  # fmt: skip
        place[key] = json.loads(json.dumps(others[rng.integers(len(others))]))
    if "checksum" in whole:
        whole["checksum"] = _checksum(whole)
    return json.dumps(whole).encode()


def _somewhere(whole, rng):
    place, key = whole, rng.choice(["objects"] if "objects" in whole else list(whole))
    while True:
        inner = place[key]
        if not isinstance(inner, (dict, list)) or not inner:
            return place, key
        if place is not whole and rng.random() < 0.15:
            return place, key
        place = inner
        keys = list(inner) if isinstance(inner, dict) else range(len(inner))
        key = keys[rng.integers(len(keys))]


# -- how reading ends ------------------------------------------------------------------------------


def ending(name: str, content: bytes, folder: Path) -> str | None:
    """What is wrong with how a file is read, None if nothing is; in a process of its own."""
    path = folder / name
    path.write_bytes(content)
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        os.close(reading)
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))
        signal.alarm(10 * SECONDS)
        os.write(writing, (_read(name, path) or "").encode())
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading, "rb") as told:
        text = told.read().decode()
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    return text or None if status == 0 else f"the process ended with {status}"


def _read(name: str, path: Path) -> str | None:
    bounds.LARGEST = 2**26
    try:
        with warnings.catch_warnings(), redirect_stdout(io.StringIO()), \
             redirect_stderr(io.StringIO()):  # fmt: skip
            warnings.simplefilter("ignore")
            KINDS[name].read(path)
    except ValueError as error:
        told = str(error)
        sentence = "\n" not in told and told.endswith(".") and len(told) < 1000
        return None if sentence else f"no sentence: {told!r}"
    except BaseException as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        return f"{type(error).__name__} of {Path(last.filename).name}:{last.lineno}: {error}"
    return None


def faults(name: str, seeds: range):
    """Seeds whose files end otherwise, and how."""
    with tempfile.TemporaryDirectory() as folder:
        good = Path(folder, name)
        KINDS[name].write(good)
        content = good.read_bytes()
        assert ending(name, content, good.parent) is None, name
        for seed in seeds:
            rng = np.random.default_rng([seed, *name.encode()])
            told = ending(name, changed(content, rng, name), good.parent)
            if told is not None:
                yield {"format": name, "seed": seed, "told": told}


if __name__ == "__main__":
    *names, first, last = sys.argv[1:]
    for format_name in names or KINDS:
        for one in faults(format_name, range(int(first), int(last))):
            print(json.dumps(one), flush=True)
