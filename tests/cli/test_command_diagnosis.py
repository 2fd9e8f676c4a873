"""What one law lacks, from the command line: recordings, laws of a quantity, several laws."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from swsysid import load_model
from swsysid.__main__ import main
from swsysid._cli.automaton import automaton_of
from swsysid._cli.diagnosis import Diagnosis
from swsysid._cli.measurement import Measurement
from swsysid._cli.options import JobOptions
from swsysid._cli.samples import measure
from swsysid._tables.table import Table

STEP = 0.02


def write_csv(path, columns):
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="")
    return str(path)


def text_of(arguments, folder, capsys):
    """What a run prints, and the first line of what it has found."""
    page = ["--html", str(folder / "page.html"), "--output", str(folder / "out")]
    assert main([*map(str, arguments), *page]) == 0
    text = capsys.readouterr().out
    found = re.search(r"\nEffect search: .*\n(.*)", text)
    return text, found[1] if found else ""


@pytest.fixture(scope="module")
def rubbing():
    """A driven mass on a spring with dry friction of 0.8 m/s^2, and a wind that pushes it."""
    rng, n_steps, fine = np.random.default_rng(0), 1500, 20
    t = STEP * np.arange(n_steps)
    u = 3.0 * np.sin(1.1 * t) + 2.0 * np.sin(2.9 * t)
    wind = np.repeat(rng.uniform(-1.0, 1.0, n_steps // 50), 50)
    x, v, rows = 0.3, 0.0, []
    for k in range(n_steps):
        rows.append((x, v))
        for _ in range(fine):
            force = u[k] - 4.0 * x - 0.3 * v + 1.5 * wind[k]
            v += STEP / fine * (force - 0.8 * np.sign(v))
            x += STEP / fine * v
    x, v = np.array(rows).T
    noise = rng.standard_normal((2, n_steps))
    measured = {"x_m": x + 1e-3 * noise[0], "v_m_per_s": v + 5e-3 * noise[1]}
    return {"t_s": t, **measured, "u": u, "wind": wind}


LIBRARY = [
    "--effects",
    "coulomb_friction",
    "input_coupling",
    "polynomial",
    "bias",
    "quadratic_drag",
]


def test_one_law_is_searched_as_it_was_measured_unless_modes_are_named(rubbing, tmp_path, capsys):
    path = write_csv(tmp_path / "rubbing.csv", rubbing)
    roles = ["--states", "x_m", "v_m_per_s", "--inputs", "u", "--time", "t_s"]
    asked = [path, *roles, "--signals", "wind", "--diagnose", *LIBRARY]
    text, first = text_of(asked, tmp_path, capsys)
    # wind and friction matter about as much; errors have the units of what they are of
    assert re.match(r"[CI].* in v_m_per_s', p < 1e-16 \(and 1 more effect\): with them", first)
    assert re.search(r"free rollouts of \S+ is \S+ m(/s)? instead of \S+ m(/s)?\. Of the sq", first)
    # within 5 %: noise of a thousandth of the motion
    law = re.search(r"with: +v_m_per_s' = (.*)", text)[1]
    friction = re.search(r"- (\S+) sign\(v_m_per_s\)", law)[1]
    assert float(friction) == pytest.approx(0.8, rel=0.05)
    assert "without: v_m_per_s' = " in text and "mode" not in law
    assert len(text.splitlines()) < 45  # a page
    effects = load_model(tmp_path / "out" / "model_with_effects.json").effects_
    assert {one.effect.kind for one in effects} == {"input_coupling", "coulomb_friction"}
    assert load_model(tmp_path / "out" / "model.json").n_modes_ == 1


@pytest.mark.nightly
def test_positions_alone_are_rolled_out_too(rubbing, tmp_path, capsys):
    columns = {name: rubbing[name] for name in ("t_s", "x_m", "u", "wind")}
    path = write_csv(tmp_path / "positions.csv", columns)
    roles = ["--states", "x_m", "--order", "2", "--inputs", "u", "wind", "--time", "t_s"]
    text, first = text_of([path, *roles, "--diagnose", *LIBRARY], tmp_path, capsys)
    assert first.startswith("Coulomb friction of x_m' in x_m'', p < 1e-16: with it the held-out")
    assert "free rollouts of x_m" in first
    friction = re.search(r"- (\S+) sign\(x_m'\)", text)[1]
    assert float(friction) == pytest.approx(0.8, rel=0.1)  # of speeds that a filter has made


@pytest.mark.nightly
@pytest.mark.parametrize("highest", [np.inf, 0.6], ids=["rest", "clipped"])
def test_positions_may_rest_or_leave_the_range_of_their_sensor(highest, tmp_path, capsys):
    """A mass that is left alone for six seconds, and an encoder that ends at 0.6 m."""
    n_steps, fine = 1500, 20
    t = STEP * np.arange(n_steps)
    u = np.where((t > 10.0) & (t < 20.0), 0.0, 3.0 * np.sin(1.1 * t) + 2.0 * np.sin(2.9 * t))
    x, v, positions = 0.3, 0.0, []
    for k in range(n_steps):
        positions.append(x)
        for _ in range(fine):
            force = u[k] - 4.0 * x - 0.3 * v
            v += STEP / fine * (force - 0.8 * np.sign(v))
            x += STEP / fine * v
    measured = np.minimum(np.round(np.array(positions), 4), highest)
    path = write_csv(tmp_path / "resting.csv", {"t_s": t, "x_m": measured, "u": u})
    roles = ["--states", "x_m", "--order", "2", "--inputs", "u", "--time", "t_s"]
    effects = ["--diagnose", "--effects", "coulomb_friction,bias,quadratic_drag"]
    text, first = text_of([path, *roles, *effects], tmp_path, capsys)
    assert first.startswith("Coulomb friction of x_m' in x_m'', p < 1e-16: with it the held-out")
    friction = re.search(r"- (\S+) sign\(x_m'\)", text)[1]
    assert float(friction) == pytest.approx(0.8, rel=0.1)  # of speeds that a filter has made


def test_a_law_of_a_quantity_has_no_prime(tmp_path, capsys):
    rng, t = np.random.default_rng(1), np.arange(0.0, 20.0, 0.02)
    x = 10.0 * np.sin(1.3 * t) + 4.0 * np.sin(3.1 * t)
    v = np.gradient(x, t)
    force = 2.0 + 0.5 * x + 3.0 * np.sign(v) + 0.2 * rng.standard_normal(len(t))
    columns = {"t_s": t, "x_mm": x, "v_mm_per_s": v, "force_N": force}
    path = write_csv(tmp_path / "force.csv", columns)
    roles = ["--states", "x_mm", "v_mm_per_s", "--quantity", "force_N"]
    asked = [path, *roles, "--diagnose", *LIBRARY]
    text, first = text_of([*asked, "--time", "t_s"], tmp_path, capsys)
    assert first.startswith(
        "Coulomb friction of v_mm_per_s in force_N, p < 1e-16: with it the held"
    )
    assert re.search(r"error of force_N is 0\.[12]\d* N instead of 1\.\d* N\.", first)
    assert "and nothing but noise is left." in first
    assert "force_N'" not in text
    law = re.search(r"with: +force_N = (\S+) \+ (\S+) x_mm .* \+ (\S+) sign\(v_mm_per_s\)", text)
    # five standard errors of 0.2 N over 1,000 rows
    assert [float(one) for one in law.groups()] == pytest.approx([2.0, 0.5, 3.0], abs=0.04)
    assert main(asked) == 2
    assert "--quantity with --diagnose needs the times of the rows" in capsys.readouterr().err
    assert main([*asked, "--time", "t_s", "--order", "2"]) == 2
    assert "--quantity names what a law gives that is no rate" in capsys.readouterr().err


def test_several_laws_take_the_place_of_one_that_explains_little(tmp_path, capsys):
    rng, t = np.random.default_rng(2), np.arange(0.0, 60.0, 0.05)
    level, rows, is_on = 1.0, [], True
    for _ in t:
        rows.append(level)
        level += 0.05 * ((5.0 - level) if is_on else -0.4 * level)
        is_on = level < 3.0 if is_on else level < 1.0
    levels = np.array(rows) + 0.01 * rng.standard_normal(len(t))
    path = write_csv(tmp_path / "pump.csv", {"t_s": t, "level_m": levels})
    asked = [path, "--states", "level_m", "--time", "t_s", "--diagnose", "--effects", "bias,drift"]
    text, _ = text_of(asked, tmp_path, capsys)
    assert "\nSeveral laws follow each other. 1 recording, 1200 samples: 2 modes, " in text
    assert "One law, with all that was found beside it, leaves level_m" in text
    assert (tmp_path / "out" / "automaton.json").exists()
    # whoever names one law gets it
    text, _ = text_of([*asked, "--modes", "1"], tmp_path, capsys)
    assert "Several laws" not in text


@pytest.mark.parametrize(("is_pump", "no_better"), [(True, False), (False, True)])
def test_modes_that_predict_no_better_than_one_law_are_told(is_pump, no_better):
    """Two of a drain, h' = u - .3 h, and of a pump between levels of 1 and 3, which has two."""
    rng, t = np.random.default_rng(2), np.arange(0.0, 30.0, 0.1)
    inflow, level, rows, is_on = 0.3 + 0.25 * np.sin(0.4 * t), 1.0, [], True
    for u in inflow:
        rows.append(level)
        for _ in range(10):
            pumped = (5.0 - level) if is_on else -0.4 * level
            level += 0.01 * (pumped if is_pump else u - 0.3 * level)
        is_on = level < 3.0 if is_on else level < 1.0
    columns = {"t": t, "h": np.array(rows) + 0.002 * rng.standard_normal(len(t)), "u": inflow}
    what = Measurement(states=("h",), inputs=("u",), time="t")
    answer = automaton_of(measure(Table("h.csv", columns, {}), what), JobOptions(what, modes=2))
    assert answer.predicts_no_better == no_better


@pytest.mark.parametrize(("left", "is_all"), [(0.02, True), (0.05, False)])
def test_where_one_law_leaves_noise_no_other_can_leave_a_third_of_it(left, is_all):
    """Noise of .01: from 3 / 1.3 times that on several laws may be worth it."""
    report = SimpleNamespace(errors=[{"held_out": [left, 9.0]}])
    noise = SimpleNamespace(noise=np.array([0.01]))
    samples = SimpleNamespace(smoothing=noise, rate_names=("q'", "q''"), n_known=1)
    done = Diagnosis(SimpleNamespace(report_=report), samples, [])
    assert done.leaves_noise == is_all


def test_a_short_record_is_told_what_would_do(tmp_path, capsys):
    t = np.arange(40) / 24.0
    columns = {"t_s": t.round(3), "height_px": np.round(300.0 * np.abs(np.cos(4.0 * t)))}
    path = write_csv(tmp_path / "video.csv", columns)
    asked = [path, "--states", "height_px", "--time", "t_s", "--diagnose"]
    text, _ = text_of(asked, tmp_path, capsys)
    told = re.search(
        r"Record (\d+) samples: as fast as now over a time of (\S+), or in steps of (\S+)\.", text
    )
    more = int(told[1]) / 40.0
    assert float(told[2]) == pytest.approx(more * t[-1], rel=0.05)
    assert float(told[3]) == pytest.approx(1.0 / 24.0 / more, rel=0.05)
    assert "Nothing was searched: the record is too short" in text and "searched," not in text


def test_the_first_line_says_when_a_lid_was_opened(tmp_path, capsys):
    """A heated box that is logged once a minute; the lid is open from 150 to 158 min."""
    rng, t = np.random.default_rng(4), np.arange(0.0, 240.0)
    heater, box, rows = (t // 25.0 % 2.0 == 0.0).astype(float), 22.0, []
    for minute in range(240):
        rows.append(box)
        loss = 4.0 if 150 <= minute < 158 else 1.0
        for _ in range(60):
            box += 0.02 * heater[minute] - loss / 900.0 * (box - 22.0)
    measured = (np.array(rows) + 0.05 * rng.standard_normal(240)).round(1)
    columns = {"t_min": t, "T_box_degC": measured, "heater": heater}
    path = write_csv(tmp_path / "lid.csv", columns)
    roles = ["--states", "T_box_degC", "--inputs", "heater", "--time", "t_min"]
    effects = ["--effects", "time_interval", "bias", "delay", "lag"]
    text, first = text_of([path, *roles, "--diagnose", *effects], tmp_path, capsys)
    place = r"(level|T_box_degC) in T_box_degC'"
    told = re.match(rf"Time interval of {place}, from t = (\S+) to (\S+), p [=<] ", first)
    assert [float(told[2]), float(told[3])] == pytest.approx([150.0, 158.0], abs=2.5)
    assert "for some time: a lid that was opened" in text
