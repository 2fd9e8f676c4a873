"""Files of simulators, drones, robots, relays and buses: written by the formats' own packages where
they write, and read back as what was planted."""

import sys
from pathlib import Path

import buildingspy
import numpy as np
import pytest
from buildingspy.io.outputfile import Reader
from logged_files import (
    DBC,
    T,
    V,
    X,
    write_bus,
    write_comtrade,
    write_modelica,
    write_ros,
    write_ros_1,
    write_ulog,
    write_unit,
)

from swsysid import HybridAutomaton, read_recordings


@pytest.mark.parametrize("layout", ["binTrans", "binNormal"])
def test_modelica_results_by_name_alias_sign_and_parameter(layout, tmp_path):
    write_modelica(tmp_path / "plant.mat", layout)
    runs = read_recordings(tmp_path / "plant.mat", states=["body.x", "alias", "minus", "m"])
    [run] = runs
    np.testing.assert_array_equal(run["t"][-2:], T[-1])  # the limits of an event
    x, alias, minus, m = run["x"].to_numpy().T
    np.testing.assert_array_equal(x, np.append(X, 7.0))
    np.testing.assert_array_equal(alias, x)
    np.testing.assert_array_equal(minus, -x)
    assert (m == 3.0).all() and [one.unit for one in runs.columns] == ["m", "", "", "kg"]


def test_results_of_dymola_beside_another_reader():
    path = Path(buildingspy.__file__).parent / "examples" / "dymola" / "PlotDemo.mat"
    other = Reader(str(path), "dymola")
    names = [name for name in other.varNames() if not name.startswith("Time")]
    [run] = read_recordings(path, states=names)
    for name in names:
        t, values = other.values(name)
        mine = run["x"][name].to_numpy()
        np.testing.assert_array_equal(mine if len(t) > 2 else mine[[0, -1]], values)


@pytest.mark.parametrize(("write", "name", "columns", "late"), [
    (write_ulog, "flight.ulg", ["state.x", "rate.v[1]"], 1e-5),
    (write_ros, "run.mcap", ["rig.at.point.x", "v.data"], 0.0),
    (write_ros, "bag", ["rig.at.point.x", "v.data"], 0.0),
    (write_ros_1, "old.bag", ["x.data", "v.data"], 0.0),
    (write_comtrade, "relay.cfg", ["x", "v"], 1.25e-4),
    (write_comtrade, "relay.cff", ["x", "v"], 1.25e-4),
    (write_bus, "drive.trc", ["x", "v"], 0.0625),
    (write_bus, "drive.blf", ["x", "Rate.v"], 0.0625), (write_bus, "drive.asc", ["x", "v"], 0.0625),
    (write_bus, "drive.log", ["x", "v"], 0.0625),
])  # fmt: skip
def test_channels_keep_their_own_instants(write, name, columns, late, tmp_path):
    write(tmp_path / name)
    [run] = read_recordings([tmp_path / name, *tmp_path.glob("*.dbc")], states=columns)
    for k, (values, shift) in enumerate(((X, 0.0), (V, late))):
        found = run["x"].iloc[:, k].to_numpy()
        here = np.isfinite(found)
        every = 2 if write is write_ulog and k else 1
        # seconds of 1970 are told to 2e-7 by a double
        np.testing.assert_allclose(run["t"][here], T[::every] + shift, atol=5e-7)
        np.testing.assert_array_equal(found[here], values[::every])


def test_named_values_of_a_bus_are_their_numbers(tmp_path):
    pytest.importorskip("cantools")
    write_bus(tmp_path / "drive.blf")
    files = [tmp_path / "drive.blf", tmp_path / "car.dbc"]
    [run] = read_recordings(files, states=["x"], inputs=["Gear"])
    np.testing.assert_array_equal(run["inputs"]["Gear"], np.arange(len(T)) % 2)
    for paths, words in ((files[:1], "name its .dbc"), (files[1:], "no log")):
        with pytest.raises(ValueError, match=words):
            read_recordings(paths, states=["x"])


def test_a_log_of_a_bus_that_is_cut_is_said_to_be(tmp_path):
    pytest.importorskip("cantools")
    write_bus(tmp_path / "drive.blf")
    files = [tmp_path / "drive.blf", tmp_path / "car.dbc"]
    whole = read_recordings(files, states=["x"])
    content = files[0].read_bytes()
    files[0].write_bytes(content[:-40])
    cut = read_recordings(files, states=["x"])
    assert len(cut[0]["t"]) < len(whole[0]["t"]) and "cut" not in str(whole)
    size = len(content)
    assert f"The log is cut: {size - 40:,} of its {size:,} bytes are there." in cut.remarks


def test_a_log_of_a_bus_with_steps_from_line_to_line(tmp_path):
    pytest.importorskip("cantools")
    write_bus(tmp_path / "drive.asc")
    files = [tmp_path / "drive.asc", tmp_path / "car.dbc"]
    [from_start] = read_recordings(files, states=["x", "v"])
    steps, last = [], 0.0
    for line in files[0].read_text().splitlines():
        first = line.split()[0]
        if first.replace(".", "").isdigit():
            step, last = float(first) - last, float(first)
            # a line of another kind on the way to this one, whose step counts
            steps.append(f"{step / 2:.6f} 1 Statistic: D 1 R 0 XD 0 XR 0 E 0 O 0 B 0.00%")
            line = line.replace(first, f"{step / 2:.6f}", 1)
        steps.append(line.replace("timestamps absolute", "timestamps relative"))
    about = ["// what was driven, and where: the header comes after it"] * 40
    files[0].write_text("\n".join([*about, *steps]))
    [stepped] = read_recordings(files, states=["x", "v"])
    np.testing.assert_allclose(stepped["t"], from_start["t"], atol=1e-12)
    np.testing.assert_array_equal(stepped["x"], from_start["x"])


@pytest.mark.parametrize(
    ("there", "instead", "sentence"),
    [
        ("timestamps absolute", "timestamps sometimes", "has timestamps 'sometimes'; its head"),
        (" 0.125000 ", "-0.125000 ", r"line \d+ of drive.asc is at -0.125000 s, and no clock of a"),
    ],
)
def test_a_log_of_a_bus_whose_times_mean_nothing_is_refused(there, instead, sentence, tmp_path):
    pytest.importorskip("cantools")
    write_bus(tmp_path / "drive.asc")
    files = [tmp_path / "drive.asc", tmp_path / "car.dbc"]
    text = files[0].read_text()
    assert there in text
    for kind in ("absolute", "relative"):
        told = text.replace(there, instead, 1).replace("timestamps absolute", f"timestamps {kind}")
        files[0].write_text(told)
        with pytest.raises(ValueError, match=sentence):
            read_recordings(files, states=["x", "v"])


@pytest.mark.parametrize("name", ["drive.blf", "drive.asc", "drive.trc", "drive.log"])
def test_extended_frames_are_no_standard_ones_of_the_same_id(name, tmp_path):
    can, cantools = pytest.importorskip("can"), pytest.importorskip("cantools")
    words = DBC.replace("BO_ 17 Rate", f"BO_ {16 + 2**31} Rate")
    (tmp_path / "car.dbc").write_text(words)
    messages = cantools.database.load_string(words).messages
    with can.Logger(str(tmp_path / name)) as log:
        for t, x, v in zip(T, X, V, strict=True):
            for one, values in zip(messages, ({"x": x, "Gear": 0}, {"v": v}), strict=True):
                log(can.Message(timestamp=1000.0 + t, arbitration_id=16, data=one.encode(values),
                                is_extended_id=one.is_extended_frame))  # fmt: skip
    [run] = read_recordings([tmp_path / name, tmp_path / "car.dbc"], states=["x", "v"])
    np.testing.assert_array_equal(run["x"], np.column_stack([X, V]))


def test_a_unit_is_run_and_read(tmp_path):
    pytest.importorskip("fmpy")
    stated = HybridAutomaton.stated(
        [{"T": "-0.5 (T - 30)"}, {"T": "-0.5 (T - 10)"}],
        [(0, 1, "T >= 22"), (1, 0, "T <= 20")], states=["T"],
    )  # fmt: skip
    stated.to_fmu(tmp_path / "plant.fmu")
    [run] = read_recordings(tmp_path / "plant.fmu", states=["T"], time="time")
    assert len(run["t"]) > 100
    done = stated.simulate(run["x"].to_numpy()[0], run["t"], mode=0)
    np.testing.assert_allclose(run["x"]["T"], done.x[:, 0], atol=1e-3)


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    """A unit that heats by an input, and the signal: a step at 2, a ramp from 3 on."""
    plant = HybridAutomaton.stated(
        [{"T": "-0.5 T + u"}, {"T": "-0.5 T + 3 u - 2 T"}],
        [(0, 1, "T >= 1"), (1, 0, "T <= 0.5")], states=["T"], inputs=["u"],
    )  # fmt: skip
    folder = tmp_path_factory.mktemp("driven")
    plant.to_fmu(folder / "plant.fmu")
    signal = np.array([(0.0, 0.5), (2.0, 0.5), (2.0, 1.5), (3.0, 1.5), (6.0, -1.5)])
    np.savetxt(folder / "signal.csv", signal, delimiter=",", header="t,u", comments="")
    return folder, plant, signal


def test_a_unit_is_driven_by_a_file(driven):
    pytest.importorskip("fmpy")
    folder, plant, signal = driven
    given = {"states": ["T"], "inputs": ["u"], "time": "time"}
    [run] = read_recordings(folder / "plant.fmu", **given, fmu_input=folder / "signal.csv")
    t, u = run["t"], run["inputs"]["u"].to_numpy()
    assert (t[0], t[-1]) == (0.0, 6.0)
    # both limits of the step, and lines between the rows
    assert u[t == 2.0][0] == 0.5 and u[t == 2.0][-1] == 1.5
    np.testing.assert_allclose(u[t > 3.0], 1.5 - (t[t > 3.0] - 3.0), atol=1e-12)
    np.testing.assert_array_equal(u[t < 2.0], 0.5)
    # the same by rollouts of the plant, one up to the step and one from there on
    first, second = t[t <= 2.0], np.unique(np.append(t[t >= 2.0], 3.0))
    before, after = t <= 2.0, t >= 2.0
    one = plant.simulate([0.0], np.unique(first), np.full((len(np.unique(first)), 1), 0.5), mode=0)
    level = np.interp(second, signal[2:, 0], signal[2:, 1])
    other = plant.simulate(
        one.x[-1], second, level[:, None], mode=int(one.modes[-1]), input_hold="linear"
    )
    T = run["x"]["T"].to_numpy()
    np.testing.assert_allclose(T[before], np.interp(t[before], one.t, one.x[:, 0]), atol=1e-5)
    found = np.interp(t[after], other.t, other.x[:, 0])
    np.testing.assert_allclose(T[after][t[after] <= 3.0], found[t[after] <= 3.0], atol=1e-5)
    # on a line FMPy holds the input over each step of its integrator
    np.testing.assert_allclose(T[after], found, atol=2e-3)


def test_inputs_that_nobody_drives_are_said(driven):
    pytest.importorskip("fmpy")
    told = read_recordings(driven[0] / "plant.fmu", states=["T"], time="time")
    assert told.remarks == ["Inputs that keep their start values: u."]


@pytest.mark.parametrize(("signal", "inputs", "words"), [
    ("t,w\n0,1\n1,2\n", ["w"], "plant.fmu has no input 'w'; its inputs: u."),
    ("t,u\n0,1\n1,2\n", [], "name the inputs that .*signal.csv holds"),
    ("t,v\n0,1\n1,2\n", ["u"], "no column 'u'"),
    ("t,u\n0,1\n1,\n", ["u"], "u of .*signal.csv lacks a value"),
    ("t,u\n1,1\n0,2\n", ["u"], "time of .*signal.csv lacks a value or goes back"),
    ("t,u\n1,1\n1,2\n", ["u"], "the signals for plant.fmu have no two times"),
])  # fmt: skip
def test_signals_that_drive_nothing_are_one_sentence(signal, inputs, words, driven, tmp_path):
    pytest.importorskip("fmpy")
    (tmp_path / "signal.csv").write_text(signal)
    with pytest.raises(ValueError, match=words) as told:
        read_recordings(
            driven[0] / "plant.fmu", states=["T"], inputs=inputs, time="time",
            fmu_input=tmp_path / "signal.csv",
        )  # fmt: skip
    assert "\n" not in str(told.value)
    (tmp_path / "log.csv").write_text("t,T,u\n0,1,0\n1,2,0\n")
    with pytest.raises(ValueError, match="drives a functional mock-up unit, and paths names none"):
        read_recordings(
            tmp_path / "log.csv", states=["T"], inputs=["u"], fmu_input=tmp_path / "log.csv"
        )


@pytest.mark.parametrize(("write", "name"), [
    (write_modelica, "plant.mat"), (write_ulog, "flight.ulg"), (write_ros, "run.mcap"),
    (write_comtrade, "relay.cfg"),
    (write_comtrade, "relay.cff"), (write_ros_1, "old.bag"),
    (write_bus, "drive.blf"), (write_bus, "drive.asc"),
    (write_bus, "drive.trc"), (write_unit, "plant.fmu"),
])  # fmt: skip
def test_cut_foreign_and_missing_files_are_one_sentence(write, name, tmp_path):
    write(tmp_path / name)
    others = list(tmp_path.glob("*.dbc"))
    content = (tmp_path / name).read_bytes()
    for number, wrong in enumerate((content[: len(content) // 20], b"t,x\n0,1\n")):
        path = tmp_path / f"{number}_{name}"
        path.write_bytes(wrong)
        with pytest.raises(ValueError, match=path.name) as told:
            read_recordings([path, *others], states=["x"])
        assert "\n" not in str(told.value)
    with pytest.raises(ValueError, match="There is no file"):
        read_recordings([tmp_path / f"absent_{name}", *others], states=["x"])
    with pytest.raises(ValueError, match="has no column 'wrong'; its columns are: "):
        read_recordings([tmp_path / name, *others], states=["wrong"])


@pytest.mark.parametrize(("name", "package", "words"), [
    ("a.ulg", "pyulog", "ulog"), ("a.bag", "rosbags", "ros"), ("a.cfg", "comtrade", "comtrade"),
    ("a.blf", "can", "can"), ("a.fmu", "fmpy", "fmu"),
])  # fmt: skip
def test_the_extra_of_a_format_is_named(name, package, words, tmp_path, monkeypatch):
    for loaded in [one for one in sys.modules if one.split(".")[0] == package]:
        monkeypatch.delitem(sys.modules, loaded)
    monkeypatch.setitem(sys.modules, package, None)
    (tmp_path / name).write_bytes(b"anything")
    (tmp_path / "a.dbc").write_text(DBC)
    with pytest.raises(ValueError, match=rf"swsysid\[{words}\]"):
        read_recordings([tmp_path / name, tmp_path / "a.dbc"], states=["x"])
