"""Plants, noise and figures of the trajectories benchmark."""

import numpy as np
import pytest

from benchmarks.trajectories.__main__ import main, parse, wanted
from benchmarks.trajectories.figures import figures
from benchmarks.trajectories.methods import METHODS
from benchmarks.trajectories.plants import PLANTS
from benchmarks.trajectories.recordings import Scenario, record

FEW = Scenario(noise=0.02, per_period=60, n_recordings=4)


@pytest.mark.parametrize("name", PLANTS)
def test_every_mode_is_recorded_and_the_truth_has_no_error(name):
    plant = PLANTS[name]
    campaign = record(plant, FEW, 0)
    assert (np.bincount(campaign.modes, minlength=plant.n_modes) >= 0.05 * len(campaign.t)).all()
    assert figures(plant, plant.truth()) == {"field": 0.0, "balanced": 1.0}
    measured = campaign.states[:, : plant.n_measured]
    spread = (campaign.x - measured).std(axis=0) / measured.std(axis=0)
    # a thousand samples know a standard deviation to 2.2 %, so to 8 % in 99.9 % of the cases
    np.testing.assert_allclose(spread, FEW.noise, rtol=0.1)


def test_noise_does_not_change_what_happens():
    plant = PLANTS["contact"]
    clean = record(plant, Scenario(0.0, 60, 2), 3)
    np.testing.assert_array_equal(record(plant, Scenario(0.05, 60, 2), 3).states, clean.states)
    np.testing.assert_array_equal(clean.x, clean.states)


def test_told_the_stays_the_laws_of_an_exact_recording_are_found():
    plant = PLANTS["one mode, linear"]
    model = METHODS["told"](plant, record(plant, Scenario(0.0, 60, 4), 0), 0)
    assert figures(plant, model)["field"] < 1e-4  # quadrature of the weak form


@pytest.mark.nightly
def test_a_cell_is_run_once_and_printed(tmp_path, capsys):
    arguments = ["--output", str(tmp_path), "--plants", "one mode, linear", "--seeds", "1"]
    arguments += ["--noise", "0.01", "--per-period", "20", "--recordings", "4"]
    arguments += ["--methods", "told", "fit", "n_modes"]
    main(arguments)
    assert "| one mode, linear |" in capsys.readouterr().out
    kept = (tmp_path / "trajectories.jsonl").read_text()
    main(arguments)
    assert (tmp_path / "trajectories.jsonl").read_text() == kept
    assert len(list(wanted(parse(arguments)))) == 3
