"""Modelica models, compiled and run by rumoca, beside `simulate`."""

import numpy as np
import pytest
from exported_models import cases

from swsysid import HybridAutomaton
from swsysid.exporting import NoFormulaError

WITHOUT_INPUTS = [name for name, case in cases().items() if not case.with_input]


@pytest.mark.parametrize("name", WITHOUT_INPUTS)
def test_states_are_those_of_simulate(name, tmp_path):
    rumoca = pytest.importorskip("rumoca")
    case = cases()[name]
    case.model.to_modelica(tmp_path / "Model.mo", x0=case.x0, mode=case.mode)
    model = rumoca.Session().load(str(tmp_path / "Model.mo"), model="Model")
    config = rumoca.SimConfig(rtol=1e-9, atol=1e-11, dt=float(case.t[1]))
    result, wanted = model.simulate(t=(0.0, case.end), config=config), case.simulated()
    system = case.model.to_hybrid_system()
    at_event = np.isin(case.t, [event.time for event in wanted.events])
    for place, state in enumerate(system.states):
        found = np.interp(case.t, np.array(result.time), np.array(result[state]))
        size = np.abs(wanted.x[:, place]).max()
        difference = np.abs(found - wanted.x[:, place])[~at_event]
        assert difference.max() < 1e-5 * size  # of its solver


def test_names_and_starts(tmp_path):
    model = HybridAutomaton.stated(
        [{"model": "2 der"}, {"model": "-der"}], [(0, 1, "dwell >= 2")],
        states=["model"], inputs=["der"],
    )  # fmt: skip
    model.to_modelica(tmp_path / "M.mo", mode=1)
    text = (tmp_path / "M.mo").read_text("utf-8")
    assert "input Real der_2;" in text and "Real model_2(start=0.0, fixed=true);" in text
    assert "mode(start=1, fixed=true)" in text and "(time - entered) > 0" in text
    with pytest.raises(ValueError, match="mode=2"):
        model.to_modelica(tmp_path / "M.mo", mode=2)
    with pytest.raises(ValueError, match="x0"):
        model.to_modelica(tmp_path / "M.mo", x0=[1.0, 2.0])


def test_maps_are_refused(tmp_path):
    model = HybridAutomaton.stated([{"x": "0.5 x"}], states=["x"], discrete_time=True)
    with pytest.raises(NoFormulaError, match="continuous time"):
        model.to_modelica(tmp_path / "Map.mo")
