"""The command line on noisy recordings: laws with errors and instants, or why there are none."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from swsysid import load_model
from swsysid.__main__ import main
from swsysid._cli import from_recordings, job
from swsysid._cli.measurement import Measurement
from swsysid._cli.recorded import Recorded
from swsysid._cli.settings import RECORDINGS
from swsysid._verdict.settings import JUDGING
from swsysid.refinement import StatedModel, StatedSurface

FREE = [[0.0, 0.0, 1.0, 0.0], [0.0, -1.0, -0.2, 1.0]]  # of 1, x, v and the force
BUMPER = [[0.0, 0.0, 1.0, 0.0], [12.0, -25.0, -2.2, 1.0]]
EDGE = 0.5
T = np.arange(0.0, 12.0, 0.05)
NOISE = [0.01, 0.03]
ROLES = ["--inputs", "force", "--time", "t", "--groups", "run"]


@pytest.fixture(scope="module")
def contact(tmp_path_factory):
    """Four noisy runs of a cart that meets a bumper; the file and the true switch instants."""
    surface = StatedSurface([[-EDGE, 1.0, 0.0, 0.0]])
    cart = StatedModel(1, [FREE, BUMPER], states=["x", "v"], inputs=["force"], surface=surface)
    rng, rows, events = np.random.default_rng(0), [], []
    for run in range(4):
        force = 1.2 * np.sin(1.1 * T + 1.3 * run) + 0.4 * np.sin(2.7 * T)
        moved = cart.simulate([0.0, 0.0], T, force[:, None], input_hold="linear")
        states = moved.x + NOISE * rng.standard_normal(moved.x.shape)
        rows.append(np.column_stack([T, states, force, np.full(len(T), run)]))
        events.append([event.time for event in moved.events])
    path = tmp_path_factory.mktemp("contact") / "contact.csv"
    np.savetxt(path, np.vstack(rows), delimiter=",", header="t,x,v,force,run", comments="")
    return str(path), events


def text_of(arguments, capsys):
    assert main(arguments) == 0
    return capsys.readouterr().out


@pytest.mark.nightly
def test_laws_with_errors_instants_and_noise(contact, tmp_path, capsys):
    path, events = contact
    arguments = [path, "--states", "x", "v", *ROLES, "--output", str(tmp_path)]
    text = text_of(arguments, capsys)
    law = re.search(r"v' = (\S+) ([+-]) (\S+) x - (\S+) v \+ (\S+) force", text)
    assert float(law[3]) == pytest.approx(1.0, abs=0.01)
    assert float(law[4]) == pytest.approx(0.2, abs=0.01)
    assert float(law[5]) == pytest.approx(1.0, abs=0.01)
    (errors, *_) = re.findall(r"v' = .*\n      standard errors (.*)", text)
    assert [term.partition(" ")[2] for term in errors.split(", ")] == ["", "x", "v", "force"]
    assert float(re.search(r"mode 0 where x < (\S+)", text)[1]) == pytest.approx(EDGE, abs=0.01)
    assert "Over whole trajectories rollouts leave nothing but noise: x 0.01, v 0.03." in text
    for run, true in enumerate(events):
        shown = re.search(rf"trajectory {run}: (.*)", text)[1].split(", ")
        assert [float(time) for time in shown] == pytest.approx(true, abs=0.02)
    model = load_model(tmp_path / "model.json")
    assert model.coef_[0, 1, 1:] == pytest.approx([-1.0, -0.2, 1.0], abs=0.01)


def test_quick_stops_at_derivatives(contact, tmp_path, capsys):
    path, _ = contact
    arguments = [path, "--states", "x", "v", *ROLES, "--quick", "--output", str(tmp_path)]
    text = text_of(arguments, capsys)
    assert "standard errors " not in text.replace("standard errors over blocks", "")
    assert "Identified from" not in text


@pytest.mark.nightly
def test_positions_with_lost_values(contact, tmp_path, capsys):
    lines = Path(contact[0]).read_text(encoding="utf-8").splitlines(keepends=True)
    rows = [line.split(",") for line in lines]
    for place in range(30, len(rows), 40):
        rows[place][1] = "NA"
    path = tmp_path / "lost.csv"
    path.write_text("".join(map(",".join, rows)), encoding="utf-8")
    arguments = [str(path), "--states", "x", "--order", "2", *ROLES, "--output", str(tmp_path)]
    text = text_of(arguments, capsys)
    assert "rollouts leave nothing but noise: x 0.01." in text
    law = re.search(r"x'' = (\S+) ([+-]) (\S+) x - (\S+) x' \+ (\S+) force", text)
    assert float(law[4]) == pytest.approx(0.2, abs=0.02)
    assert re.search(r"\n    or \S+ x'' .*\n      standard errors", text) is None
    assert re.search(r"x'' = .*\n      standard errors", text)


def test_laws_that_lack_something_are_called_so(contact, tmp_path, capsys):
    """One law for the free cart and the bumper."""
    arguments = [contact[0], "--states", "x", "v", *ROLES, "--modes", "1"]
    text = text_of([*arguments, "--output", str(tmp_path)], capsys)
    assert re.search(r"[Oo]ver stretches of 30 samples rollouts leave \S+ times the noise of", text)
    assert "a term, a mode, an effect (--diagnose) or an impact (--automaton) is missing" in text


def test_where_the_laws_lack_very_much_derivatives_decide(contact, tmp_path, capsys, monkeypatch):
    strict = replace(RECORDINGS, hopeless=JUDGING.noise_alone)
    monkeypatch.setattr(from_recordings, "RECORDINGS", strict)
    arguments = [contact[0], "--states", "x", "v", *ROLES, "--modes", "1"]
    text = text_of([*arguments, "--output", str(tmp_path)], capsys)
    assert "Identified from derivatives: over stretches of 30 samples rollouts leave" in text


def test_what_would_take_long_is_left_to_derivatives(contact, tmp_path, capsys, monkeypatch):
    short = replace(RECORDINGS, most_samples=500)
    monkeypatch.setattr(from_recordings, "RECORDINGS", short)
    arguments = [contact[0], "--states", "x", "v", *ROLES, "--output", str(tmp_path)]
    text = text_of(arguments, capsys)
    assert (
        "Identified from derivatives: rollouts of more than 500 samples of these terms take "
        "long (--decimate 2 makes them fewer)." in text
    )


def test_a_refusal_of_the_identifier_is_told_and_the_model_is_delivered(
    contact, tmp_path, capsys, monkeypatch
):
    def refuse(self, *data):
        raise ValueError("no.")

    monkeypatch.setattr(from_recordings.TrajectoryIdentifier, "fit", refuse)
    arguments = [contact[0], "--states", "x", "v", *ROLES, "--output", str(tmp_path)]
    text = text_of(arguments, capsys)
    assert "Identified from derivatives: no." in text and "mode 1 (" in text


@pytest.mark.parametrize("switches", [False, True])
def test_modes_of_derivatives_are_told_in_place_of_one_law_where_they_are_trusted(
    switches, contact, tmp_path, capsys, monkeypatch
):
    """The trajectories are in doubt of a cart with a bumper, and of one without."""

    def in_doubt(*asked):
        return from_recordings.identify_recordings(*asked)[0], "Identified from derivatives: so."

    monkeypatch.setattr(job, "identify_recordings", in_doubt)
    path = contact[0]
    if not switches:
        recorded = np.loadtxt(path, delimiter=",", skiprows=1)
        cart = StatedModel(1, [FREE], states=["x", "v"], inputs=["force"])
        force = recorded[recorded[:, 4] == 0, 3:4]
        moved = cart.simulate([0.0, 0.0], T, force, input_hold="linear")
        states = moved.x + NOISE * np.random.default_rng(1).standard_normal(moved.x.shape)
        path, columns = str(tmp_path / "free.csv"), np.column_stack([T, states, force, 0.0 * T])
        np.savetxt(path, columns, delimiter=",", header="t,x,v,force,run", comments="")
    text = text_of([path, "--states", "x", "v", *ROLES, "--output", str(tmp_path / "o")], capsys)
    assert ("Identified from derivatives: so." in text) == switches
    assert ("mode 1 (" in text) == switches


def test_recorded_rows_and_what_they_tell_of_others():
    runs = np.array(["a"] * 20 + ["b"] * 6)
    t = np.r_[np.arange(20.0), np.arange(6.0)]
    numbers = np.column_stack([t, -t, t])  # a state, an input and the time
    what = Measurement(states=("x",), inputs=("u",), time="t", decimate=2)
    recorded = Recorded.of(numbers, runs, what)
    assert recorded.labels == ["a"]  # three samples of b are none
    np.testing.assert_array_equal(recorded.t, np.arange(0.0, 20.0, 2.0))
    np.testing.assert_array_equal(recorded.inputs[:, 0], -recorded.t)
    found = recorded.at(
        np.array([0.0, 2.9, 3.1, 19.0, 1.0]),
        np.array(["a", "a", "a", "a", "b"]),
        np.arange(10),
        np.full(5, -1),
    )
    assert found.tolist() == [0, 1, 2, 9, -1]


def test_what_is_known_holds_and_is_asked(tmp_path, capsys):
    plant = StatedModel(None, [[0, 1], [-1, -0.2]], states=["x", "v"])
    states = plant.simulate([1, 1], T).x + 0.02 * np.random.default_rng(0).standard_normal((240, 2))
    path = tmp_path / "spring.csv"
    rows = np.column_stack([T, states])
    np.savetxt(path, rows, delimiter=",", header="t,x,v", comments="")
    arguments = [str(path), "--time", "t", "--states", "x", "v", "--modes", "1", "--output"]
    arguments += [str(tmp_path / "output"), "--known", "x' = v", "--known"]
    text = text_of([*arguments, "v'[v] = -0.3"], capsys)
    assert "x' = 1.000000 v" in text and "- 0.300000 v" in text
    assert "Known: x' = v: not contradicted" in text
    assert "Known: v'[v] = -0.3: the data would rather have v'[v] = -0.2" in text
    sentences = tmp_path / "known.txt"  # what is known of a wrong law comes back as an effect
    sentences.write_text("# a spring without friction\nv' has no v\n\n", encoding="utf-8")
    sought = ["--diagnose", "--effects", "polynomial"]
    text = text_of([*arguments, f"@{sentences}", *sought], capsys)
    assert "Polynomial of v in v'" in text and "with:    x' = 1.000 v" in text
    (empty := tmp_path / "empty.txt").write_text("  # nothing yet\n", encoding="utf-8")
    for wrong, said in (
        (["v'[u] = 1"], "the terms are 1, x, v"),
        ([f"@{tmp_path}/none.txt"], "cannot be read"),
        ([f"@{empty}"], "holds no sentence"),
    ):
        assert main([*arguments, *wrong]) == 2
        assert said in capsys.readouterr().err
