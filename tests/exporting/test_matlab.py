"""MATLAB files, run by GNU Octave beside `simulate`, and their laws read without it."""

import re
import shutil
import subprocess

import numpy as np
import pytest
from exported_models import cases

from swsysid import HybridAutomaton
from swsysid.exporting import NoFormulaError
from swsysid.exporting._expressions import evaluated


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """Rollouts of all cases by one Octave, by name: a row for each time, and for each event."""
    octave = shutil.which("octave-cli")
    if octave is None:
        pytest.skip("needs octave-cli (apt-get install octave)")
    folder, lines = tmp_path_factory.mktemp("matlab"), []
    for place, case in enumerate(cases().values()):
        case.model.to_matlab(folder / f"model{place}.m")
        np.savetxt(folder / f"t{place}.txt", case.t, fmt="%.17g")
        inputs = case.inputs if case.with_input else np.zeros((len(case.t), 1))
        np.savetxt(folder / f"u{place}.txt", inputs, fmt="%.17g")
        label = -1 if case.mode is None else case.mode
        x0 = "; ".join(map(repr, case.x0))
        lines.append(
            f"m = model{place}(); t = load('t{place}.txt'); u = load('u{place}.txt');"
            f"[x, mode, e] = m.simulate(t, [{x0}], {label}, u, '{case.hold}');"
            f"f = fopen('out{place}.txt', 'w');"
            "fprintf(f, [repmat('%.17g ', 1, columns(x) + 1), '\\n'], [x, mode]'); fclose(f);"
            f"f = fopen('events{place}.txt', 'w');"
            "fprintf(f, '%.17g %d %d\\n', e'); fclose(f);"
        )
    (folder / "run_cases.m").write_text("\n".join(lines))
    done = subprocess.run(
        [octave, "--norc", "run_cases.m"], cwd=folder, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return {
        name: (
            np.loadtxt(folder / f"out{place}.txt"),
            (folder / f"events{place}.txt").read_text().splitlines(),
        )
        for place, name in enumerate(cases())
    }


@pytest.mark.parametrize("name", cases())
def test_states_modes_and_events_are_those_of_simulate(name, ran):
    case, (rows, events) = cases()[name], ran[name]
    wanted = case.simulated()
    size = np.abs(wanted.x).max()
    np.testing.assert_allclose(rows[:, :-1], wanted.x, rtol=0.0, atol=1e-8 * size)
    np.testing.assert_array_equal(rows[:, -1], wanted.modes)
    # what follows at the same instant is no event of its own, and at the start none at all
    assert len({float(one.split()[0]) for one in events if one.strip()} - {0.0}) == case.n_events


@pytest.mark.parametrize("name", cases())
def test_laws_are_those_of_the_model(name, tmp_path):
    """Read line by line in Python."""
    case = cases()[name]
    case.model.to_matlab(tmp_path / "model.m")
    text = (tmp_path / "model.m").read_text().split("function dx = rhs")[1]
    system = case.model.to_hybrid_system()
    rng = np.random.default_rng(0)
    known = {one: getattr(np, one) for one in ("sin", "cos", "sign", "abs", "exp", "sqrt")}
    known |= {"pick": lambda c, a, b: a if c > 0 else b, "min": min, "max": max}
    laws = re.split(r"case \d+", text.split("\nend\n")[0])[1:]
    for mode in range(len(system.laws)):
        x, u = rng.normal(size=len(system.states)), rng.normal(size=max(len(system.inputs), 1))
        values, dx = dict(known, x=x, u=u, t=0.0), {}
        for line in laws[mode].split("    end")[0].strip().splitlines():
            target, formula = line.strip().removesuffix(";").split(" = ", 1)
            formula = re.sub(r"\b([xu])\((\d+)\)", lambda m: f"{m[1]}[{int(m[2]) - 1}]", formula)
            value = eval(formula.replace("^", "**"), {}, values)
            values[target] = dx[target] = value
        found = [dx[f"dx({place + 1})"] for place in range(len(x))]
        wanted = [evaluated(law, {"x": x, "u": u}) for law in system.laws[mode]]
        np.testing.assert_allclose(found, wanted, rtol=1e-12)


def test_maps_are_refused(tmp_path):
    model = HybridAutomaton.stated([{"x": "0.5 x"}], states=["x"], discrete_time=True)
    with pytest.raises(NoFormulaError, match="this model is a map; write it with to_c"):
        model.to_matlab(tmp_path / "map.m")
