"""Systems of a gallery in the format of Flowcean: recordings by SciPy, and the figures."""

import json

import numpy as np
import pytest

from benchmarks.automata.others.__main__ import main
from benchmarks.automata.others.flowcean import N_UNSEEN, gallery
from benchmarks.automata.others.tables import RIGHT

BALL_AND_RELAY = """
from types import SimpleNamespace as Told

from .made import crossing, place


def ball():
    flight = place(lambda t, x, told, u: [x[1], -told["g"]])
    land = crossing(flight, flight, lambda t, x, told, u: x[0], -1)
    land.reset = Told(fn=lambda t, x, told, u: [x[0], -told["kept"] * x[1]])
    flight.parameters = {"kept": 0.5}
    return system([flight], [land], [1.0, 0.0], {"g": 2.0})


def relay():
    up, down = (place(lambda t, x, told, u, s=s: [s * u(t)[0]]) for s in (1.0, -1.0))
    ways = [
        crossing(up, down, lambda t, x, told, u: x[0] - 1.0, 1),
        crossing(down, up, lambda t, x, told, u: x[0] + 1.0, -1),
    ]
    return system([up, down], ways, [0.9], {})


def system(places, ways, start, told):
    return Told(
        locations=places, initial_location=places[0], initial_state=start, parameters=told,
        transitions_from=lambda place: [one for one in ways if one.source is place],
    )


def registry():
    return {
        "ball": Told(factory=ball, t_span=(0.0, 1.9), input_stream=None),
        "relay": Told(factory=relay, t_span=(0.0, 6.0), input_stream=lambda t: [1.0]),
    }
"""
MADE = """
from types import SimpleNamespace as Told


def place(flow):
    return Told(dynamics=Told(flow=flow), parameters={})


def crossing(source, target, surface, direction):
    event = Told(fn=surface, direction=direction)
    return Told(source=source, target=target, event=event, reset=None)
"""


@pytest.fixture
def folder(tmp_path):
    place = tmp_path / "systems"
    place.mkdir()
    (place / "__init__.py").write_text(BALL_AND_RELAY)
    (place / "made.py").write_text(MADE)
    return place


def test_a_ball_falls_and_jumps_as_it_does_by_hand(folder):
    """From 1 with g = 2 it lands at t = 1 at a speed of 2, and is up to 2 with half of it."""
    ball = gallery(folder)[0]
    done = ball.recorded(np.array([1.0, 0.0]))
    t = done.t
    up = t > 1.0
    np.testing.assert_allclose(done.x[t < 1.0, 0], 1.0 - t[t < 1.0] ** 2, atol=1e-9)  # tolerances
    np.testing.assert_allclose(done.x[up, 1], 1.0 - 2.0 * (t[up] - 1.0), atol=1e-9)
    assert (len(ball.numbers), len(ball.training()), len(ball.unseen())) == (
        1,
        15 - N_UNSEEN,
        N_UNSEEN,
    )


def test_a_relay_turns_at_both_surfaces_and_no_start_is_beyond_one(folder):
    relay = gallery(folder)[1]
    done = relay.recorded(np.array([0.0]))
    assert np.abs(done.x).max() <= 1.0 + 1e-9  # by rounding of instants
    np.testing.assert_array_equal(np.flatnonzero(np.diff(done.modes)), [99, 299, 499])
    starts = [one.x[0, 0] for one in (*relay.training(), *relay.unseen())]
    assert max(starts) < 1.0 and len(set(starts)) == 15


def test_the_command_finds_both(folder, tmp_path, capsys):
    main(["--gallery", str(folder), "--output", str(tmp_path / "out"), "--names", "Flowcean/ball"])
    [cell] = json.loads((tmp_path / "out" / "others.json").read_text())["clean"]["cells"]
    assert cell["mean"] <= RIGHT and cell["modes"] == 0.0
    assert "1 of 1 within" in capsys.readouterr().out


def test_what_is_no_gallery_is_refused(tmp_path):
    with pytest.raises(ValueError, match="is no package"):
        gallery(tmp_path)
    (tmp_path / "__init__.py").write_text("")
    with pytest.raises(ValueError, match="has no registry"):
        gallery(tmp_path)
