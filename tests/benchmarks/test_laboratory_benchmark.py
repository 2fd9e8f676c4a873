"""The rigs of the laboratory are what they say, and one search is told with its rollouts."""

import json

import numpy as np
import pytest

from benchmarks.laboratory.__main__ import main
from benchmarks.laboratory.rigs import RIGS, _Motion
from benchmarks.laboratory.tables import condensed, tables


def test_dry_friction_holds_what_it_can_and_takes_the_rest():
    held, pulled = (np.full((20, 1), force) for force in (0.4, 0.6))
    motion = _Motion(lambda q, v, u: float(u[0]), lambda u: 0.5, 0.1)
    np.testing.assert_array_equal(motion.run((1.0, 0.0), held), np.tile([1.0, 0.0], (20, 1)))
    # a force of .1 is left
    np.testing.assert_allclose(motion.run((0.0, 0.0), pulled)[:, 1], 0.01 * np.arange(20))


@pytest.mark.parametrize("name", RIGS)
def test_recordings_are_finite_and_follow_from_their_seed(name):
    one, again = (RIGS[name](np.random.default_rng([1607, 3])) for _ in range(2))
    assert len(one.runs) == 8 and len(one.fresh) == 4
    for run, same in zip(one.runs, again.runs, strict=True):
        np.testing.assert_array_equal(run.x, same.x)
        assert np.isfinite(run.x).all() and len(run.t) == len(run.x) == len(run.u)


def test_the_lid_is_opened_in_two_recordings():
    rig = RIGS["box"](np.random.default_rng([1607, 0]))
    cooling = [-np.diff(run.x[:, 0]).min() for run in rig.runs]
    assert set(np.argsort(cooling)[-2:]) == {1, 4}


@pytest.mark.nightly
def test_one_rig(tmp_path, capsys):
    options = ["--rigs", "motor", "--seeds", "1", "--output", str(tmp_path)]
    main(options)
    [line] = (tmp_path / "laboratory.jsonl").read_text().splitlines()
    record = json.loads(line)
    assert record["verdict"] == "right" and record["found"][0] == "dead_zone of x2"
    before, after = record["rollouts"]
    assert after < 0.5 * before
    assert "Right, or unknown in the right place: 1 of 1, reached." in capsys.readouterr().out


def test_what_is_wrong_is_told():
    record = {
        "cell": ["cart", 0],
        "lacks": "dry friction",
        "found": ["drift of time"],
        "verdict": "wrong name",
        "rollouts": [0.1, 0.2],
        "seconds": 1.0,
    }
    text = tables({"searches": condensed([record]) | {"origin": {"commit": "a", "day": "b"}}})
    assert "cart, seed 0: drift of time" in text and "0 of 1, **missed**" in text
