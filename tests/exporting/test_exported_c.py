"""C files, compiled by gcc with all warnings as errors, beside `simulate`."""

import ctypes

import numpy as np
import pytest
from compiled_model import CompiledModel, array
from exported_models import cases

from swsysid import HybridAutomaton
from swsysid.exporting import NoFormulaError
from swsysid.refinement import StatedModel, StatedSurface


@pytest.mark.parametrize("name", cases())
def test_states_modes_and_events_are_those_of_simulate(name, tmp_path):
    case = cases()[name]
    wanted = case.simulated()
    label = -1 if case.mode is None else case.mode
    x, modes, events = CompiledModel(case.model, tmp_path).rollout(
        case.x0, case.t, case.inputs, label, case.hold
    )
    size = np.abs(wanted.x).max()
    np.testing.assert_allclose(x, wanted.x, rtol=0.0, atol=1e-9 * size)
    np.testing.assert_array_equal(modes, wanted.modes)
    assert len(events) == case.n_events
    if not name.endswith("friction"):  # simulate tells no crossings of a level of an effect
        times = [event.time for event in wanted.events]
        np.testing.assert_allclose([time for time, _ in events], times, rtol=0.0, atol=1e-9)


def test_a_mass_that_sticks_rests_exactly(tmp_path):
    case = cases()["friction"]
    x, _, events = CompiledModel(case.model, tmp_path).rollout(case.x0, case.t)
    stuck = case.t > events[-1][0]
    assert np.ptp(x[stuck, 1]) == 0.0  # its speed has no rate
    assert np.ptp(x[stuck, 0]) < 1e-12  # creeps with what was left of the speed when it was caught


@pytest.mark.parametrize("seed", [0, 1, 2, 4, 5, 6, 7, 11])  # in 3 `simulate` takes minutes
def test_drawn_systems_of_two_to_four_modes(seed, tmp_path):
    rng = np.random.default_rng(seed)
    books = [[-1], [1]], [[-1, -1], [1, -1], [-1, 1]], [[-1, -1], [1, -1], [-1, 1], [1, 1]]
    book = np.array([*books, [[-1, -1, 0], [1, 0, -1], [0, 1, 1]]][seed % 4])
    laws = np.zeros((len(book), 2, 3))
    laws[:, :, 0], laws[:, 0, 2] = rng.normal(0.0, 0.5, (len(book), 2)), 1.0
    laws[:, 1, 1:] = -rng.uniform([0.5, 0.05], [3.0, 0.3], (len(book), 2))
    surfaces = rng.normal(size=(book.shape[1], 3)) * [0.2, 1.0, 1.0]
    model = StatedModel(1, laws, states=["x", "v"], surface=StatedSurface(surfaces, 1, book))
    t = np.linspace(0.0, 8.0, 81)
    wanted = model.simulate([-1.0, 0.3], t, rtol=1e-12, atol=1e-14)
    x, _, _ = CompiledModel(model, tmp_path).rollout([-1.0, 0.3], t)
    np.testing.assert_allclose(x, wanted.x, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("kind", ["automaton", "surface"])
def test_maps(kind, tmp_path):
    if kind == "automaton":
        model, mode = HybridAutomaton.stated(
            [{"x": "0.9 x + 0.2 u"}, {"x": "0.5 x"}],
            [(0, 1, "x >= 1.2"), (1, 0, "x <= 0.3", {"x": "x - 0.1"}), (0, 0, "dwell >= 9")],
            states=["x"], inputs=["u"], discrete_time=True,
        ), 0  # fmt: skip
    else:
        laws = [[[0.9, 0.2]], [[0.5, 0.1]]]
        surface = StatedSurface([[-1.0, 1.0, 0.0]], 1)
        model, mode = (
            StatedModel(
                None, laws, states=["x"], inputs=["u"], surface=surface, discrete_time=True
            ),
            -1,
        )
    t, u = np.arange(60.0), np.full((60, 1), 1.0)
    given = {"mode": 0} if kind == "automaton" else {}
    wanted = model.simulate([0.1], t, u, **given)
    compiled, x, modes = CompiledModel(model, tmp_path), [], []
    state = compiled.begun(array([0.1]), array(u[0]), mode)
    for row in u:
        compiled.library.model_row(state, array(row))
        # the time of a map comes first in its struct, the state after the mode
        x.append(compiled.library.seen_state(state)[0])
        modes.append(compiled.library.model_mode(state))
        compiled.library.model_step(state, array(row))
    np.testing.assert_allclose(np.array(x), wanted.x[:, 0], rtol=1e-13)
    np.testing.assert_array_equal(modes, wanted.modes)
    assert len(set(modes)) == 2


def test_switches_without_end_are_a_code(tmp_path):
    chatter = HybridAutomaton.stated(
        [{"x": "1"}, {"x": "-1"}], [(0, 1, "x >= 0"), (1, 0, "x <= 0")], states=["x"]
    )
    compiled, double = CompiledModel(chatter, tmp_path), ctypes.c_double
    state = compiled.begun(double(0.0), array([-1.0]), array([0.0]), 0)
    codes = [
        compiled.library.model_step(state, double(0.0), array([0.0]), double(2.0), array([0.0]))
        for _ in range(3)
    ]
    assert -1 in codes or codes == [1, 1, 1]  # it never passes the point at which it chatters
    assert compiled.library.seen_time(state) == pytest.approx(1.0, abs=1e-9)


def test_lags_are_refused():
    model = HybridAutomaton.stated(
        [{"x": "0.5 x + 0.2 x[k-1]"}], states=["x"], discrete_time=True, lags=1
    )
    with pytest.raises(NoFormulaError, match="see 1 past rows"):
        model.to_hybrid_system()
