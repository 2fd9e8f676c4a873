"""Run the commands of `formats.md`: a recording of each tool to an answer and to a unit that runs.

``--write`` puts what they print into the page.
"""

import re
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

import asammdf
import fmpy
import numpy as np
from fmpy.build import build_platform_binary
from scipy.io import savemat

from swsysid import HybridAutomaton

PAGE = Path(__file__).with_name("formats.md")
PLACE = re.compile(r"(?<=<!-- printed by docs/formats.py -->\n\n).*?(?=<!-- end -->)", re.S)
T = np.arange(0.0, 24.0, 0.1)


def recorded(start):
    """Heats towards 30 below 20, cools towards 10 above 22; noise of 5 thousandths."""
    stated = HybridAutomaton.stated(
        [{"T": "-0.1 (T - 30)"}, {"T": "-0.1 (T - 10)"}],
        [(0, 1, "T >= 22"), (1, 0, "T <= 20")],
        states=["T"],
    )
    noise = 0.005 * np.random.default_rng(int(10 * start)).standard_normal(len(T))
    return stated.simulate([start], T, mode=0).x[:, 0] + noise


def texts(folder):
    """A folder of three runs."""
    folder.mkdir()
    for run, start in enumerate((17.0, 18.5, 20.0)):
        rows = np.column_stack([T, recorded(start)])
        np.savetxt(folder / f"run{run}.csv", rows, delimiter=",", header="t,T", comments="")


def mdf(path, x):
    """A group with one channel."""
    with asammdf.MDF(version="4.10") as file:
        file.append([asammdf.Signal(x, T, name="T", unit="degC")])
        file.save(path)


def ulog(path, x):
    """A topic with one field."""

    def message(kind, content):
        return struct.pack("<HB", len(content), ord(kind)) + content

    rows = zip(T, x, strict=True)
    data = [message("D", struct.pack("<HQd", 0, int(t * 1e6), one)) for t, one in rows]
    path.write_bytes(b"".join([
        b"ULog\x01\x12\x35\x01", struct.pack("<Q", 0), message("B", bytes(40)),
        message("F", b"box:uint64_t timestamp;double T;"),
        message("A", struct.pack("<BH", 0, 0) + b"box"), *data,
    ]))  # fmt: skip


def dymola(path, x):
    """A result with one variable."""

    def words(names):
        wide = [name.ljust(max(map(len, names))) for name in names]
        return np.array(["".join(row) for row in zip(*wide, strict=True)])

    savemat(path, {
        "Aclass": np.array(["Atrajectory", "1.1        ", "           ", "binTrans   "]),
        "name": words(["Time", "T"]), "description": words(["Time in [s]", "[degC]"]),
        "dataInfo": np.array([[0, 2], [1, 2], [0, 0], [-1, -1]], dtype=np.int32),
        "data_1": np.array([[T[0], T[-1]]]), "data_2": np.array([T, x]),
    }, format="4")  # fmt: skip


def command(words, folder):
    """What a command prints."""
    python = [sys.executable, *words.split()[1:]]
    done = subprocess.run(python, cwd=folder, capture_output=True, text=True, check=True)
    return done.stdout


def told(name, folder):
    """The commands for one recording, the lines of laws and guards, and what the unit does."""
    identify = f"python -m swsysid {name} --states T --automaton --modes 2"
    export = "python -m swsysid export swsysid_output/model.json --to fmu --output box.fmu"
    answer = command(identify, folder)
    kept = [line for line in answer.splitlines() if re.match(r"mode \d|.* -> |\d+ recording", line)]
    command(export, folder)
    unit, build = folder / f"unit of {name}", folder / f"build of {name}"
    build.mkdir()
    fmpy.extract(folder / "box.fmu", unit)
    build_platform_binary(unit, build)
    start = {"T": 21.0}
    done = fmpy.simulate_fmu(str(unit), stop_time=24.0, output=["T"], start_values=start)
    runs = f"box.fmu by FMPy: T from {done['T'].min():.2f} to {done['T'].max():.2f}"
    return "\n".join([f"$ {identify}", *kept, f"$ {export}", runs])


def main():
    """Print, or write."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        texts(folder / "runs")
        for name, write in (("log.mf4", mdf), ("flight.ulg", ulog), ("result.mat", dymola)):
            write(folder / name, recorded(17.0))
        names = ("runs", "log.mf4", "flight.ulg", "result.mat")
        text = "\n\n".join(told(name, folder) for name in names)
    if "--write" in sys.argv:
        page = PAGE.read_text(encoding="utf-8")
        block = f"```text\n{text}\n```\n\n"
        PAGE.write_text(PLACE.sub(lambda match: block, page, count=1), encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
