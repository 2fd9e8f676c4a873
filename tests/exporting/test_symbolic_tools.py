"""SymPy, python-control and CasADi, each beside the model's own velocities and rollouts."""

import warnings

import numpy as np
import pytest
from exported_models import cases

from swsysid.exporting import NoFormulaError

POINTS = np.random.default_rng(0).uniform(-1.2, 1.2, (20, 4))


def _velocities(case, points):
    """Velocity of every mode at points, by the formulas' own numbers, and the active mode."""
    from swsysid.exporting._control import compiled

    system = case.model.to_hybrid_system()
    n, m = len(system.states), len(system.inputs)
    for point in points:
        x, u = point[:n], point[n : n + m]
        yield x, u, [[compiled(one)((x, u, 0.3)) for one in law] for law in system.laws]


@pytest.mark.parametrize("name", cases())
def test_sympy(name):
    sympy = pytest.importorskip("sympy")
    case = cases()[name]
    told, system = case.model.to_sympy(), case.model.to_hybrid_system()
    for x, u, wanted in _velocities(case, POINTS[:5]):
        values = dict(zip((*told.states, *told.inputs, told.time), (*x, *u, 0.3), strict=True))
        for law, rates in zip(told.laws, wanted, strict=True):
            np.testing.assert_allclose([float(one.subs(values)) for one in law], rates, rtol=1e-12)
        if system.surfaces is not None:
            mode = case.model.switching_model.mode(x, u)
            active = [float(one.subs(values)) for one in told.rhs]
            np.testing.assert_allclose(active, wanted[mode], rtol=1e-12)
    assert all(isinstance(one.guard, sympy.Expr) for one in told.transitions)


def test_sympy_has_guards_and_resets():
    sympy = pytest.importorskip("sympy")
    told = cases()["ball"].model.to_sympy()
    h, v = told.states
    [jump] = told.transitions
    assert jump.guard == -h and jump.reset[1].equals(sympy.Float(-0.8) * v)
    thermostat = cases()["thermostat"].model.to_sympy()
    assert thermostat.rhs[0].has(thermostat.mode)
    assert [one.guard.coeff(thermostat.states[0]) for one in thermostat.transitions] == [1, -1]


def test_control_linearises_and_simulates():
    control = pytest.importorskip("control")
    case = cases()["pendulum"]
    plant = case.model.to_control("pendulum")
    assert plant.state_labels == ["angle", "speed"]
    linear = control.linearize(plant, [0.0, 0.0], [])
    np.testing.assert_allclose(linear.A, [[0, 0], [-9.81, 0]], atol=1e-4)  # of differences
    done = control.input_output_response(
        plant, case.t, 0.0, list(case.x0), solve_ivp_kwargs={"rtol": 1e-10, "atol": 1e-12}
    )
    np.testing.assert_allclose(done.states.T, case.simulated().x, atol=1e-7)


def test_control_steps_over_surfaces_and_says_so():
    control = pytest.importorskip("control")
    case = cases()["oscillator"]
    with pytest.warns(UserWarning, match="steps over the surfaces"):
        plant = case.model.to_control()
    steps = {"max_step": 1e-2, "rtol": 1e-8}
    done = control.input_output_response(plant, case.t, 0.0, list(case.x0), solve_ivp_kwargs=steps)
    np.testing.assert_allclose(done.states.T, case.simulated().x, atol=1e-3)  # of its steps


def test_control_has_no_memory_of_modes():
    pytest.importorskip("control")
    with pytest.raises(NoFormulaError, match="python-control has no events; give mode="):
        cases()["thermostat"].model.to_control()
    with pytest.raises(NoFormulaError, match="the state jumps"):
        cases()["ball"].model.to_control()
    with pytest.raises(ValueError, match="numbered from 0 to 1"):
        cases()["thermostat"].model.to_control(mode=2)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        heating = cases()["thermostat"].model.to_control(mode=0)
    assert heating.dynamics(0.0, [20.0], [1.0]) == pytest.approx(1.3)


@pytest.mark.parametrize("name", cases())
def test_casadi(name):
    pytest.importorskip("casadi")
    case = cases()[name]
    told, system = case.model.to_casadi(), case.model.to_hybrid_system()
    for x, u, wanted in _velocities(case, POINTS):
        for law, rates in zip(told.laws, wanted, strict=True):
            np.testing.assert_allclose(law(x, u, 0.3).full()[:, 0], rates, rtol=1e-12, atol=1e-14)
        if system.surfaces is not None:
            mode = case.model.switching_model.mode(x, u)
            np.testing.assert_allclose(told.rhs(x, u, 0.3).full()[:, 0], wanted[mode], rtol=1e-12)
    assert len(told.transitions) == len(system.edges)
    assert (told.rhs is None) == bool(system.edges)


def test_casadi_differentiates():
    casadi = pytest.importorskip("casadi")
    told = cases()["ball"].model.to_casadi()
    [jump] = told.transitions
    assert float(jump.guard([2.0, -1.0], [], 0.0, 0.0)) == -2.0
    after = jump.reset([0.0, -5.0], [], 0.0, 0.0).full()[:, 0]
    np.testing.assert_allclose(after, [0.0, 4.0])
    x = casadi.SX.sym("x", 2)
    slope = casadi.Function("slope", [x], [casadi.jacobian(jump.guard(x, [], 0.0, 0.0), x)])
    np.testing.assert_allclose(slope([1.0, 1.0]).full()[0], [-1.0, 0.0])
