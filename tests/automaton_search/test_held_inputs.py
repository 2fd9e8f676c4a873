"""Automata of plants whose inputs keep their value: told, found, and refused."""

import numpy as np
import pytest

from swsysid import HybridAutomaton, HybridAutomatonRegressor, MisfitWarning

HEATED = HybridAutomaton.stated(
    [{"T": "-0.5 (T - 30) + 2 u"}, {"T": "-0.5 (T - 10) + 2 u"}],
    [(0, 1, "T >= 22"), (1, 0, "T <= 18")],
    states=["T"],
    inputs=["u"],
)
TRUE, NOISE = np.array([[15.0, -0.5, 2.0], [5.0, -0.5, 2.0]]), 0.02


def recordings(hold, seed=1):
    """A thermostat whose room is heated by a command of ten rows, too."""
    rng, t = np.random.default_rng(seed), np.arange(0.0, 30.0, 0.1)
    for _ in range(4):
        u = np.repeat(rng.normal(0.0, 1.5, 30), 10)[:, None]
        x = HEATED.simulate([rng.uniform(16, 21)], t, u, mode=0, input_hold=hold).x
        yield {"t": t, "x": x + NOISE * rng.standard_normal(x.shape), "inputs": u}


@pytest.mark.parametrize("hold", ["zero", "linear"])
def test_the_recordings_say_what_a_command_does_between_rows(hold):
    data = list(recordings(hold))
    found = HybridAutomatonRegressor(2, random_state=0).fit(data)
    assert found.input_holds_ == (hold,)
    off = np.abs(found.coef_[:, 0] - TRUE)
    assert (off <= 3.0 * found.coef_errors_[:, 0]).all() and off.max() <= 0.03
    assert found.report_.rollouts.holds and found.report_.rollouts.tells_switches
    assert found.report_.n_samples == 1200 and len(found.modes_) == 1200
    assert ("keeps its value until the next row" in str(found.report_)) == (hold == "zero")
    # the rollout of the first recording, and the score of others, hold the command alike
    run = found.simulate(data[0]["x"][0], data[0]["t"], data[0]["inputs"], mode=0)
    assert np.sqrt(np.mean((run.x - data[0]["x"]) ** 2)) <= 3.0 * NOISE
    assert found.score(list(recordings(hold, seed=2))) > 0.999
    if hold == "zero":
        with pytest.warns(MisfitWarning, match="leaves all 4 recordings"):
            told = HybridAutomatonRegressor(2, random_state=0, input_hold="linear").fit(data)
        assert np.abs(told.coef_[:, 0] - TRUE).max() > 1.0  # a line bends the laws
        assert told.score(list(recordings(hold, seed=2))) < 0.98


@pytest.mark.nightly
def test_a_command_that_moves_in_every_row_may_be_held():
    """Each row has two limits then, and most steps of time are none."""
    rng, t, data = np.random.default_rng(0), np.arange(0.0, 20.0, 0.1), []
    for start in (15.0, 19.0):
        u = 0.5 * np.sin(0.5 * t + start)[:, None]
        x = HEATED.simulate([start], t, u, mode=0, input_hold="zero").x
        data.append({"t": t, "x": x + NOISE * rng.standard_normal(x.shape), "inputs": u})
    found = HybridAutomatonRegressor(2, random_state=0, input_hold="zero").fit(data)
    off = np.abs(found.coef_[:, 0] - TRUE)
    assert (off <= 3.5 * found.coef_errors_[:, 0]).all() and off.max() <= 0.15


def test_in_discrete_time_every_row_acts():
    with pytest.raises(ValueError, match="input_hold is for continuous time"):
        HybridAutomatonRegressor(1, discrete_time=True, input_hold="zero").fit(np.eye(9)[:, :1])
