"""What the command line says about switching: one verdict, for the model that it delivers."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from swsysid import HybridAutomaton, load_model, save_model
from swsysid._cli.guard_words import inequality, regions
from swsysid._cli.job import JobOptions, run_job
from swsysid._cli.measurement import Measurement
from swsysid._cli.samples import measure
from swsysid._cli.text import render
from swsysid._data.recordings import Record
from swsysid._free_rollouts.courses import Course
from swsysid._free_rollouts.judge import free_rollouts
from swsysid._free_rollouts.sample_noise import SampleNoise
from swsysid._tables.table import Table
from swsysid._verdict.comparison import (
    Comparison,
    Rival,
    Verdict,
    certainty,
    count_switches,
    hold_out,
    relative_error,
)
from swsysid._verdict.memory import memory
from swsysid._verdict.terms import Terms
from swsysid.results import SwitchingVerdict

SAYINGS = (
    "clearly better than one mode: than",
    "may be chance",
    "Do not trust the modes",
    "do not decide whether",
    "no better than the mean",
    "does not say which mode is active",
    "Switching explains all that was recorded",
    "No switching",
)


def job(columns, states, inputs=(), groups=None, **options):
    """The result of the job on columns with measured derivatives d<state>."""
    what = Measurement(
        states=tuple(states),
        inputs=tuple(inputs),
        derivatives=tuple(f"d{name}" for name in states),
        groups=groups,
    )
    units = {name: "V" for name in columns if name.startswith("v")}
    return run_job(Table("made.csv", columns, units), JobOptions(measurement=what, **options))


def said(result):
    """The text, after checking that it holds exactly one verdict."""
    text = render(result)
    assert sum(saying in text for saying in SAYINGS) == 1, text
    return text


def along(rate, x0, inputs, step=0.01):
    """States of x' = rate(x, u) by small Euler steps, and the rates."""
    states, rates, x = [], [], x0
    for u in inputs:
        states.append(x)
        rates.append(rate(x, u))
        x = x + step * rates[-1]
    return np.array(states), np.array(rates)


# -- the delivered model ---------------------------------------------------------------------------


def three_gears():
    """A cart whose third gear, above x = 6, is used in the last fifth of the record only."""
    rng = np.random.default_rng(0)
    n = 1500
    x = np.concatenate([rng.uniform(0, 6, int(0.8 * n)), rng.uniform(6, 9, n - int(0.8 * n))])
    u = rng.uniform(0, 1, n)
    gain = np.select([x < 3, x < 6], [4.0, 2.0], 1.0)
    rate = gain * u - 0.3 * x + 0.002 * rng.standard_normal(n)
    return {"x": x, "u": u, "dx": rate}


def test_a_gear_of_the_held_out_part_alone_is_found_and_reported():
    result = job(three_gears(), ["x"], ["u"], modes=3)
    gains = sorted(result.model.coef_[:, 0, 2])
    # the law of the third gear comes from the samples that were held out for the test
    assert gains == pytest.approx([1.0, 2.0, 4.0], abs=0.01)
    (third,) = result.comparison.untested
    assert result.model.coef_[third, 0, 2] == pytest.approx(1.0, abs=0.01)
    text = said(result)
    assert f"Mode {third}: found in the held-out part only" in text
    assert result.comparison.verdict is Verdict.SWITCHES
    assert "2 modes, affine" in text  # what was tested


def test_the_delivered_model_is_searched_for_on_all_rows():
    result = job(three_gears(), ["x"], ["u"], modes=3)
    data = three_gears()
    again = result.model.__sklearn_clone__().fit(
        np.column_stack([data["x"], data["u"]]), data["dx"][:, None], groups=np.zeros(1500)
    )
    np.testing.assert_array_equal(again.coef_, result.model.coef_)
    assert isinstance(result.model.init, str)  # no start was handed over


# -- rivals ----------------------------------------------------------------------------------------


def pendulum():
    rng = np.random.default_rng(1)
    runs = []
    for run in range(6):
        x, rate = along(
            lambda x, u: np.array([x[1], -9.81 * np.sin(x[0]) - 0.1 * x[1]]),
            np.array([rng.uniform(-2.8, 2.8), rng.uniform(-2, 2)]),
            np.zeros(300),
        )
        runs.append(np.column_stack([x, rate, np.full(300, run)]))
    names = ["angle", "speed", "dangle", "dspeed", "run"]
    columns = dict(zip(names, np.vstack(runs).T, strict=True))
    columns["dspeed"] = columns["dspeed"] + 0.05 * rng.standard_normal(1800)
    return columns


@pytest.mark.nightly
def test_a_plain_pendulum_is_one_mode_with_a_sine(tmp_path):
    result = job(pendulum(), ["angle", "speed"], groups="run", modes="auto")
    assert result.given_up > 1 and result.model.n_modes_ == 1
    law = result.model.equations(precision=2)[1]
    found = dict(reversed(term.split(" ", 1)) for term in re.findall(r"[\d.]+ [\w()]+", law))
    assert float(found["sin(angle)"]) == pytest.approx(9.81, abs=0.1)
    assert float(found["speed"]) == pytest.approx(0.1, abs=0.02)
    text = said(result)
    assert (
        f"No switching: {result.given_up} modes were found, but one mode with affine and sine"
        in text
    )
    save_model(result.model, tmp_path / "model.json")
    states = np.column_stack([pendulum()["angle"], pendulum()["speed"]])
    loaded = load_model(tmp_path / "model.json")
    with pytest.warns(UserWarning, match="feature names"):
        expected = result.model.predict(states)
    with pytest.warns(UserWarning, match="feature names"):
        np.testing.assert_array_equal(loaded.predict(states), expected)


def test_two_modes_of_a_pendulum_are_not_called_switching():
    result = job(pendulum(), ["angle", "speed"], groups="run", modes=2)
    assert result.comparison.verdict is Verdict.SMOOTH
    assert "--modes 1 --library trigonometric" in said(result)


def test_a_cubic_spring_is_told_from_two_stiffnesses():
    rng = np.random.default_rng(2)
    x, u = rng.uniform(-1, 1, (2, 1500))
    noise = 0.01 * rng.standard_normal(1500)
    cubic = job({"x": x, "u": u, "dx": u - x - 3.0 * x**3 + noise}, ["x"], ["u"])
    assert cubic.comparison.verdict is Verdict.SMOOTH and "--library cubic" in said(cubic)
    kink = job({"x": x, "u": u, "dx": u - np.where(x > 0, 5.0, 1.0) * x + noise}, ["x"], ["u"])
    assert kink.comparison.verdict is Verdict.SWITCHES
    assert "clearly better than one mode: than the best smooth law" in said(kink)


def test_one_mode_is_told_of_a_better_law():
    rng = np.random.default_rng(3)
    x = rng.uniform(-1, 1, 800)
    columns = {"x": x, "dx": -x - 3.0 * x**3 + 0.01 * rng.standard_normal(800)}
    text = said(job(columns, ["x"], modes=1))
    assert "With cubic terms its held-out error is" in text and "--library cubic" in text
    columns["dx"] = -x + 0.01 * rng.standard_normal(800)
    assert "no smooth law with more terms is better" in said(job(columns, ["x"], modes=1))


# -- the verdict on given errors -------------------------------------------------------------------


def compared(several, one, richer, n_switches=20, told=None, n_rows=200, uneven=(0.9, 1.1)):
    """Errors of given sizes; `richer` is that of the law with more terms.

    Those of several modes are larger and smaller by turns, in ten blocks. With `told`, the error
    where the rates tell the modes, the surface is constant.
    """
    noise = np.random.default_rng(0).choice([-1.0, 1.0], (n_rows, 1))
    rivals = (Rival(Terms((0,), 1), one * noise), Rival(Terms((0,), 2), richer * noise))
    return Comparison(
        errors=several * noise * np.repeat(uneven * 5, n_rows // 10)[:, None],
        rivals=rivals,
        spread=np.ones(1),
        n_switches=n_switches,
        constant=told is not None,
        told_by_rates=None if told is None else told * noise,
        untested=(),
    )


SMALL, EXPLAINED = np.full(1, 0.4), {"noise": np.full(1, 0.1), "explains": True}


@pytest.mark.parametrize(
    ("comparison", "verdict"),
    [
        (compared(0.1, 0.5, 0.4), Verdict.SWITCHES),
        (compared(0.1, 0.5, 0.05), Verdict.SMOOTH),
        (compared(0.1, 0.1, 0.1), Verdict.ONE_MODE),
        (compared(0.1, 0.5, 0.4, n_switches=4), Verdict.TOO_FEW),
        (compared(0.1, 0.5, 0.4, n_rows=40), Verdict.TOO_FEW),
        (compared(1.1, 5.0, 4.0), Verdict.USELESS),
        (compared(0.4, 0.5, 0.4, uneven=(0.5, 1.2)), Verdict.CHANCE),
        (compared(0.6, 0.5, 0.5, told=0.1), Verdict.HIDDEN),
        (compared(0.6, 0.5, 0.1, told=0.1), Verdict.SMOOTH),
        (compared(0.6, 0.5, 0.5, told=0.4), Verdict.ONE_MODE),
        # rollouts of the model of all recordings leave nothing but noise, of 0.1 here
        (replace(compared(0.6, 0.5, 0.4), **EXPLAINED), Verdict.UNREPEATED),
        (replace(compared(0.6, 0.5, 0.4, 4), **EXPLAINED), Verdict.TOO_FEW),
        (replace(compared(0.6, 0.5, 0.4), noise=np.full(1, 0.1)), Verdict.SMOOTH),
        # of a column that rests the mean is as good as anything
        (replace(compared(0.4, 3.0, 2.0), spread=SMALL, noise=SMALL), Verdict.SWITCHES),
        (replace(compared(0.4, 3.0, 2.0), spread=SMALL, noise=np.full(1, 0.1)), Verdict.USELESS),
        (replace(compared(0.6, 0.5, 0.1), **EXPLAINED), Verdict.SMOOTH),  # so do a smooth law's
    ],
)
def test_each_case_has_its_verdict(comparison, verdict):
    assert comparison.verdict is verdict


@pytest.mark.parametrize("verdict", Verdict)
def test_the_text_says_one_verdict_in_every_case(verdict, monkeypatch):
    rng = np.random.default_rng(4)
    x = rng.uniform(-1, 1, 300)
    result = job({"x": x, "dx": np.where(x > 0, 1.0, -1.0) - x}, ["x"])
    monkeypatch.setattr(Comparison, "verdict", verdict)
    said(result)


@pytest.mark.parametrize(("wrong", "words"), [(False, "No switching"), (True, "not shown")])
def test_no_switching_is_not_said_of_a_law_that_its_own_rollouts_refute(wrong, words):
    t, noise = np.arange(0.0, 3.0, 0.02), SampleNoise.constant(np.array([0.01]), [""])
    law = HybridAutomaton.stated([{"x": "-2 x" if wrong else "-x"}], states=["x"])
    course = Course("", Record(t, np.exp(-t)[:, None], np.zeros((len(t), 0))), np.ones(1), 0)
    free = free_rollouts(law, [course], noise, ["x"], unseen=True)
    judged = SwitchingVerdict(
        compared(0.1, 0.1, 0.08), 1, "auto", ("x",), "linear", 100, True, False, free=free
    )
    assert words in judged.sentence and ("lacks (EffectSearchCV)" in judged.sentence) == wrong
    modes = replace(judged, comparison=compared(0.6, 0.5, 0.4), n_modes=2, switches=True)
    modes = replace(modes, comparison=replace(modes.comparison, **EXPLAINED))
    assert ("EffectSearchCV asks what one law lacks" in modes.sentence) == wrong


def test_the_gain_is_that_of_blocks_not_of_rows():
    errors = np.repeat(np.linspace(0.5, 1.5, 10), 20)[:, None]
    # every block gains the same factor: certain; half of them lose it: no gain
    assert certainty(errors, errors * np.tile([0.5, 0.51], 100)[:, None], np.ones(1)) > 100.0
    factor = np.repeat([0.5, 2.0] * 5, 20)[:, None]
    assert abs(certainty(errors, errors * factor, np.ones(1))) < 0.1
    assert relative_error(2.0 * np.ones((4, 1)), np.array([4.0])) == 0.5


def test_whole_trajectories_are_held_out_or_the_last_part_of_each():
    few = hold_out(np.repeat([1, 2], 10), 0.3, 0)
    assert not few.whole_groups and np.flatnonzero(few.test).tolist() == [7, 8, 9, 17, 18, 19]
    many = hold_out(np.repeat(np.arange(10), 4), 0.3, 0)
    assert many.whole_groups and many.test.reshape(10, 4).all(axis=1).sum() == 3


def test_switches_are_counted_within_trajectories():
    assert count_switches(np.array([0, 0, 1, 1, 0]), np.array([0, 0, 0, 1, 1])) == 2


# -- guards in words -------------------------------------------------------------------------------


def test_a_diode_is_told_as_a_person_would():
    rng = np.random.default_rng(5)
    vs, vc = rng.uniform(-5, 5, (2, 2000))
    rate = np.where(vs > vc, 50.0 * (vs - vc), -3.0 * vc)
    result = job({"vC": vc, "vs": vs, "dvC": rate}, ["vC"], ["vs"])
    lines = regions(result.model.surface_, result.samples)
    conducting = int(np.argmax(result.model.coef_[:, 0, 2]))
    found = re.match(rf"mode {conducting} where (vs|vC) [<>] ([\d.]* ?)(vs|vC)$", lines[conducting])
    assert found and float(found.group(2) or 1.0) == pytest.approx(1.0, abs=0.01)
    assert lines[conducting] in said(result)


def test_thresholds_regions_and_constants_in_words():
    rng = np.random.default_rng(6)
    x, y = rng.uniform(-2, 2, (2, 4000))
    rows = np.column_stack([np.ones(4000), x, y, x**2, y**2])
    names, units = ["1", "x", "y", "x^2", "y^2"], ["", "m", "s", "", ""]

    def words(*coef):
        return inequality(np.array(coef), rows, names, units)

    assert words(-0.06, 3.0, 0.0, 0.0, 0.0).positive == "x > 0.02 m"
    assert words(-0.06, 3.0, 0.0, 0.0, 0.0).negative == "x < 0.02 m"
    assert words(1.5, 0.0, 0.0, -1.0, -1.0).positive == "x^2 + y^2 < 1.5"
    assert words(0.0, -2.0, 1.0, 0.0, 0.0).positive == "x < 0.5 y"
    assert words(-0.001, 2.5, -2.0, 0.0, 0.0).positive == "x > 0.8 y"
    assert words(1.0, 2.0, -1.0, 0.0, 0.0).positive == "x > 0.5 y - 0.5 m"
    slight = words(-0.06, 3.0, 1e-4, 0.0, 0.0)  # a term that moves no sample is left out
    assert slight.positive.startswith("x > 0.0") and "y" not in slight.positive
    assert words(9.0, 1.0, 0.0, 0.0, 0.0).positive == "everywhere"
    assert words(-9.0, 1.0, 0.0, 0.0, 0.0).positive == "nowhere"


def thermostat():
    """A room whose heater is on below 20.4 and off above 21.9."""
    temperature, on, rows = 21.0, True, []
    outside = 5.0 + 3.0 * np.sin(np.arange(2500) / 240.0)
    for out in outside:
        on = temperature < 20.4 or (on and temperature < 21.9)
        rate = -(temperature - out) / 400.0 + 0.09 * on
        rows.append([temperature, out, rate])
        temperature += 2.0 * rate
    columns = np.array(rows).T
    rng = np.random.default_rng(7)
    columns[2] += 1e-3 * rng.standard_normal(2500)
    return dict(zip(["T", "out", "dT"], columns, strict=True))


def test_a_relay_is_not_delivered_with_a_constant_surface_in_silence():
    result = job(thermostat(), ["T"], ["out"])
    assert result.comparison.verdict is Verdict.HIDDEN
    text = said(result)
    assert "gives mode 0 to every sample, although the rates fit mode 0 in" in text
    assert "--diagnose" in text
    on = int(np.argmax(result.model.coef_[:, 0, 0]))
    levels = re.search(
        rf"mode {on} begins below T = (\d+\.\d+), mode {1 - on} above T = (\d+\.\d+)", text
    )
    # a step is 0.05 degrees at most
    assert [float(level) for level in levels.groups()] == pytest.approx([20.4, 21.9], abs=0.05)


def test_modes_of_noise_are_no_memory():
    rng = np.random.default_rng(8)
    result = job(thermostat(), ["T"], ["out"])
    assert memory(rng.integers(0, 2, len(result.samples.X)), result.samples) == ""
    assert memory(np.zeros(len(result.samples.X), dtype=int), result.samples) == ""
    short = replace(result.samples, X=result.samples.X[:3], groups=result.samples.groups[:3])
    assert memory(np.array([0, 1, 0]), short) == ""


def test_a_stop_that_is_reached_at_one_sign_of_the_speed_and_left_at_the_other_is_no_memory():
    rng = np.random.default_rng(9)
    size, phase = 1.0 + 0.1 * rng.random(2500), 0.05 * np.arange(2500)
    x, v = size * np.sin(phase), size * np.cos(phase)
    samples = replace(job(thermostat(), ["T"], ["out"]).samples, X=np.column_stack([x, v]))
    assert memory((x > 0.3).astype(int), samples) == ""
    relay = (np.sin(phase + 0.3) > 0.0).astype(int)  # on at x = -0.3, off at 0.3
    assert memory(relay, samples)


@pytest.mark.parametrize(("gain", "told"), [(1e-12, False), (0.5, True)])
def test_a_balance_of_forces_is_told_where_the_input_moves_the_body(gain, told):
    rng = np.random.default_rng(0)
    q, v, u = rng.normal(size=(3, 400))
    columns = {"q": q, "v": v, "a": gain * u - 0.3 * v - q, "u": u}
    what = Measurement(states=("q",), inputs=("u",), derivatives=("v", "a"), order=2)
    text = render(run_job(Table("made.csv", columns, {}), JobOptions(measurement=what, modes=1)))
    # 1 / 0.5 is the inertia; divided by 1e-12 the law would be its own noise
    assert ("    or 2 " in text) == told
    assert ("\n    or " in text) == told


def test_a_surface_between_the_values_of_a_switch_names_them():
    rng = np.random.default_rng(8)
    T, window = rng.uniform(10, 30, 2000), rng.integers(0, 2, 2000).astype(float)
    rate = np.where(window > 0.5, 20.0 - 1.2 * T, 3.0 - 0.1 * T)
    result = job({"T": T, "window": window, "dT": rate}, ["T"], ["window"])
    lines = sorted(regions(result.model.surface_, result.samples))
    assert {line[13:] for line in lines} == {"window = 0", "window = 1"}, lines


def test_a_surface_is_told_of_the_values_that_a_switch_had_not_of_those_of_a_filter():
    """A gear that stands at 1 or 2, smoothed with the speed; the surface leans a little on both."""
    t = np.arange(0.0, 60.0, 0.2)
    gear, throttle = 1.0 + (np.cos(t / 4) > 0.2), 1.0 + 0.3 * np.sin(0.4 * t)
    v = np.ones(len(t))
    for k in range(len(t) - 1):  # exactly, the throttle held
        goal = 2.5 * (3.0 if gear[k] == 1 else 1.5) * throttle[k]
        v[k + 1] = goal + (v[k] - goal) * np.exp(-0.4 * 0.2)
    what = Measurement(states=("v",), inputs=("throttle", "gear"), time="t")
    samples = measure(Table("made", {"t": t, "v": v, "throttle": throttle, "gear": gear}, {}), what)
    leaning = np.array([[-0.097, -0.018, 0.032, 0.116]])
    surface = SimpleNamespace(
        coef_=leaning, classes_=[0, 1], mode_book_=[[-1], [1]],
        surface_features=lambda X: np.column_stack([np.ones(len(X)), X]),
        fitted_surfaces=SimpleNamespace(basis=SimpleNamespace(names=lambda names: ["1", *names])),
    )  # fmt: skip
    assert regions(surface, samples) == ["mode 0 where gear = 1", "mode 1 where gear = 2"]
