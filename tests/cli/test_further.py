"""What the command asks by itself where two modes explain too little."""

import json
import re

import numpy as np
import pandas as pd
import pytest

from swsysid import HybridAutomatonRegressor, load_model
from swsysid.__main__ import main

NIGHTLY = pytest.mark.nightly


def written(path, **columns):
    pd.DataFrame(columns).to_csv(path, index=False)
    return [str(path), "--time", "t", "--output", str(path.parent / "out")]


def printed(words, capsys):
    """What is printed before and after the command asks further."""
    assert main(words) == 0
    before, _, after = capsys.readouterr().out.partition("\nSo ")
    return before, after


@pytest.fixture
def late(tmp_path):
    """v' = -.5 v + u(t - .7), in closed form, of which no modes are parts."""
    t = 0.1 * np.arange(250)
    u, v = np.zeros_like(t), 0.3 * np.exp(-0.5 * t)
    for size, speed, phase in ((2.0, 0.9, 0.0), (1.5, 2.37, 1.0)):
        u += size * np.sin(speed * t + phase)
        gain = size / np.hypot(0.5, speed)
        lag = phase - 0.7 * speed - np.arctan2(speed, 0.5)
        v += gain * (np.sin(speed * t + lag) - np.exp(-0.5 * t) * np.sin(lag))
    v += 0.01 * np.random.default_rng(0).standard_normal(len(t))
    return [*written(tmp_path / "late.csv", t=t, v=v, u=u), "--states", "v", "--inputs", "u"]


@NIGHTLY
def test_where_modes_are_not_to_be_trusted_one_law_is_asked_what_it_lacks(late, tmp_path, capsys):
    before, after = printed(late, capsys)
    assert "Do not trust the modes" in before and "--modes 2 leaves that out" in after
    # planted; lines between samples of the input bend it by up to a fiftieth
    assert float(re.search(r"delay (\d\S+)", after)[1]) == pytest.approx(0.7, abs=0.02)
    out = tmp_path / "out"
    assert load_model(out / "model_with_effects.json").effects_[0].effect.kind == "delay"
    assert load_model(out / "model.json").n_modes_ == 2  # what was said first stays
    told = (out / "identification.txt").read_text(encoding="utf-8")
    assert "Do not trust" in told and "Effect search" in told
    assert {path.name for path in out.iterdir()} >= {"report.html", "swsysid_diagnosis.html"}


@pytest.mark.parametrize("wish", [pytest.param(["--modes", "2"], marks=NIGHTLY), ["--quick"]])
def test_what_was_asked_for_is_all_that_is_asked(wish, late, tmp_path, capsys):
    before, after = printed([*late, *wish], capsys)
    assert "Do not trust the modes" in before and not after
    assert not (tmp_path / "out" / "model_with_effects.json").exists()


def test_modes_that_leave_nothing_but_noise_are_the_answer(tmp_path, capsys):
    t = 0.1 * np.arange(300)
    u = 2.0 * np.sin(0.9 * t) + 1.5 * np.sin(0.37 * t + 1.0)
    v, fine = [0.3], 400
    for one, following in zip(u, u[1:], strict=False):
        rate, speed = np.linspace(one, following, fine), v[-1]
        for push in rate:  # dry friction, in steps of a quarter of a millisecond
            speed += 0.1 / fine * (-0.5 * speed + push - 0.4 * np.sign(speed))
        v.append(speed)
    v = np.array(v) + 0.01 * np.random.default_rng(0).standard_normal(len(t))
    words = written(tmp_path / "rubbed.csv", t=t, v=v, u=u)
    before, after = printed([*words, "--states", "v", "--inputs", "u"], capsys)
    assert "clearly better than one mode" in before and not after


def test_a_ball_that_bounces_is_asked_for_jumps_though_no_stretch_lacks_anything(tmp_path, capsys):
    t, h, v, clock = [], [], [], 0.0
    place, speed = 1.0, 0.0
    for _ in range(4):  # falls and impacts in closed form, both limits of each impact
        hit = (speed + np.sqrt(speed**2 + 2 * 9.81 * place)) / 9.81
        inside = np.arange(np.ceil(clock / 0.02) * 0.02, clock + hit, 0.02) - clock
        for dt in [*inside[inside > 1e-9], hit]:
            t.append(clock + dt)
            h.append(max(0.0, place + speed * dt - 0.5 * 9.81 * dt**2))
            v.append(speed - 9.81 * dt)
        clock, place, speed = clock + hit, 0.0, -0.7 * v[-1]
        t, h, v = [*t, clock], [*h, 0.0], [*v, speed]
    words = written(tmp_path / "ball.csv", t=t, h=h, v=v)
    _, after = printed([*words, "--states", "h", "v"], capsys)
    assert "States jump" in after
    # planted restitution of .7
    assert float(re.search(r"v := (-\S+) v", after)[1]) == pytest.approx(-0.7, abs=1e-3)


@NIGHTLY
def test_a_thermostat_is_an_automaton_and_no_vibration(tmp_path, capsys):
    step, T, heats, course = 0.02, 18.0, 1.0, []
    for number in range(5000):
        heats = 1.0 if T <= 20.0 else 0.0 if T >= 22.0 else heats
        T += step * (-0.05 * (T - 10.0) + 1.2 * heats)
        course += [T] * (number % 10 == 0)
    t = 10 * step * np.arange(len(course))
    T = np.array(course) + 0.03 * np.random.default_rng(1).standard_normal(len(t))
    words = written(tmp_path / "room.csv", t=t, T=T)
    _, after = printed([*words, "--states", "T"], capsys)
    assert after.count("Several laws follow each other") == 1
    told = json.loads((tmp_path / "out" / "automaton.json").read_text(encoding="utf-8"))
    assert len(told["transitions"]) == 2
    # thresholds of 20 and 22, of which noise and steps of .024 leave a few thousandths
    found = sorted(map(float, re.findall(r"where T [<>]= (\S+)", after)))
    assert found == pytest.approx([20.0, 22.0], abs=0.03)
    assert isinstance(load_model(tmp_path / "out" / "model.json"), HybridAutomatonRegressor)


@NIGHTLY
def test_where_a_guard_remembers_the_command_goes_on_to_an_automaton(tmp_path, capsys):
    step, T, cools, course = 0.5, 8.0, 1.0, []
    for number in range(40000):
        cools = 1.0 if T >= 6.0 else 0.0 if T <= 3.0 else cools
        T += step * ((21.0 - T) / 1800.0 - 0.02 * cools)
        course += [T] * (number % 40 == 0)
    t = 40 * step * np.arange(len(course))
    T = np.array(course) + 0.05 * np.random.default_rng(5).standard_normal(len(t))
    words = written(tmp_path / "fridge.csv", t=t, T=T)
    before, after = printed([*words, "--states", "T"], capsys)
    assert "(hysteresis): mode 0 begins below T" in before and after.startswith(
        "an automaton is identified"
    )
    # thresholds of 6 and 3, passed by up to a hundredth in a step
    found = sorted(map(float, re.findall(r"where T [<>]= (\S+)", after)))
    assert found == pytest.approx([3.0, 6.0], abs=0.03)
