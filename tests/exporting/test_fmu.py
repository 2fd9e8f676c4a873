"""Units built and run by FMPy, whose solver is CVODE, beside `simulate`."""

import shutil
import zipfile
from dataclasses import replace

import numpy as np
import pytest
from exported_models import cases

from swsysid import HybridAutomaton
from swsysid.exporting import NoFormulaError


def _built(model, folder, fmi_version=2):
    fmpy = pytest.importorskip("fmpy")
    if shutil.which("cmake") is None or shutil.which("gcc") is None:
        pytest.skip("needs cmake and gcc")
    from fmpy.build import build_platform_binary
    from fmpy.validation import validate_fmu

    model.to_fmu(folder / "model.fmu", fmi_version=fmi_version)
    assert validate_fmu(str(folder / "model.fmu")) == []
    fmpy.extract(folder / "model.fmu", folder / "unit")
    (folder / "build").mkdir()
    build_platform_binary(folder / "unit", folder / "build", configuration="Release")
    return folder / "unit"


def _ran(case, folder, fmi_version=2, **options):
    """What FMPy makes of the unit, and the names of its states.

    Its solver sees inputs as they were when it last looked for events, so that only held ones are
    integrated well (findings/fmpy_inputs_within_steps.sh).
    """
    fmpy, unit = pytest.importorskip("fmpy"), _built(case.model, folder, fmi_version)
    told = fmpy.read_model_description(unit).modelVariables
    states = [one.name for one in told if one.causality == "output" and "mode" not in one.name]
    inputs = None
    start = dict(zip(states, case.x0, strict=True))
    if case.mode is not None:
        start["mode_start"] = case.mode
    if case.with_input:
        kind = [("time", "f8"), (next(one.name for one in told if one.causality == "input"), "f8")]
        times, held = np.repeat(case.t, 2)[1:], np.repeat(case.inputs[:, 0], 2)[:-1]
        inputs = np.array(list(zip(times, held, strict=True)), dtype=kind)
    result = fmpy.simulate_fmu(
        str(unit), stop_time=case.end, output_interval=case.t[1], relative_tolerance=1e-11,
        start_values=start, input=inputs, output=[*states, "mode"], **options,
    )  # fmt: skip
    return result, states


@pytest.mark.parametrize("fmi_version", [2, 3])
@pytest.mark.parametrize("name", cases())
def test_states_and_modes_are_those_of_simulate(name, fmi_version, tmp_path):
    case = replace(cases()[name], hold="zero")
    wanted = case.simulated()
    result, states = _ran(case, tmp_path, fmi_version, record_events=False)
    assert len(result) == len(case.t)
    size = np.abs(wanted.x).max()
    for place, state in enumerate(states):
        np.testing.assert_allclose(result[state], wanted.x[:, place], rtol=0.0, atol=1e-6 * size)
    at_event = np.isin(case.t, [event.time for event in wanted.events])
    np.testing.assert_array_equal(result["mode"][~at_event], wanted.modes[~at_event])


@pytest.mark.parametrize(("name", "fmi_version"), [
    ("ball", 2), ("ball", 3), ("thermostat", 2), ("timer", 2), ("oscillator", 2),
    ("three modes", 2), ("three modes", 3),
])  # fmt: skip
def test_instants_of_events_are_those_of_simulate(name, fmi_version, tmp_path):
    case = replace(cases()[name], hold="zero")
    result, _ = _ran(case, tmp_path, fmi_version, record_events=True)
    times = result["time"][:-1][np.diff(result["time"]) == 0.0]  # of events there are two rows
    wanted = case.simulated()
    assert len(wanted.events) >= 2
    for event in wanted.events:
        assert np.abs(times - event.time).min() < 1e-6


def test_the_file_is_the_same_for_the_same_model(tmp_path):
    model = cases()["ball"].model
    for name in ("one.fmu", "other.fmu"):
        model.to_fmu(tmp_path / name, "ball")
    assert (tmp_path / "one.fmu").read_bytes() == (tmp_path / "other.fmu").read_bytes()
    with zipfile.ZipFile(tmp_path / "one.fmu") as unit:
        assert unit.testzip() is None
        assert b'numberOfEventIndicators="1"' in unit.read("modelDescription.xml")


def test_maps_are_refused(tmp_path):
    model = HybridAutomaton.stated([{"x": "0.5 x"}], states=["x"], discrete_time=True)
    with pytest.raises(NoFormulaError, match="model exchange has continuous time"):
        model.to_fmu(tmp_path / "map.fmu")
    assert not (tmp_path / "map.fmu").exists()
    with pytest.raises(ValueError, match="fmi_version=1 is neither 2 nor 3"):
        cases()["ball"].model.to_fmu(tmp_path / "ball.fmu", fmi_version=1)
