"""The peers of identification from recordings: what they are told, and that they find the rest."""

import numpy as np
import pytest

from benchmarks.speed.peers_table import table
from benchmarks.speed.told import Told, runge_kutta
from benchmarks.speed.told_modes import most_likely
from benchmarks.trajectories.plants import PLANTS
from benchmarks.trajectories.recordings import Scenario, record


def told(name):
    plant = PLANTS[name]
    return Told(plant, record(plant, Scenario(0.01, 60, 4), 0), 0)


def test_a_step_is_of_fourth_order():
    def velocity(x, u):
        return -x + u

    # x' = -x + t from 1 is 2 exp(-t) - 1 + t; the first missing term is step ** 5 / 120
    reached = runge_kutta(velocity, 1.0, 0.0, 0.1, 0.1)
    assert reached == pytest.approx(2.0 * np.exp(-0.1) - 0.9, abs=2.0 * 0.1**5 / 120)


def test_what_is_told_is_true():
    given = told("backlash, three modes")
    assert given.error(given.laws) == 0.0
    np.testing.assert_allclose(given.changes.sum(axis=1), 1.0, rtol=1e-15)
    often = np.mean(given.modes[:, 1:] != given.modes[:, :-1])
    np.testing.assert_allclose(np.diag(given.changes), 1.0 - often, rtol=1e-12)


@pytest.mark.parametrize("name", ["contact", "predator and prey"])
def test_casadi_finds_the_laws_where_the_modes_are_told(name):
    given = told(name)
    # the differences at which it starts are wrong by .0101 and .0070
    assert most_likely(given)["laws"] < 0.005


@pytest.mark.filterwarnings("ignore")  # it meets what JAX means to take away
def test_dynamax_finds_the_modes_where_the_laws_are_told():
    pytest.importorskip("dynamax")
    from benchmarks.speed.told_laws import hidden_markov, particles

    given = told("contact")
    # two modes by chance are right in half of the samples; a filter has seen no later sample
    assert particles(given)["modes"] > 0.97
    assert hidden_markov(given)["modes"] > 0.97


def test_a_peer_that_takes_less_is_bold():
    ours = [{"running": seconds, "laws": 0.01, "modes": 1.0} for seconds in (1.0, 3.0, 2.0)]
    faster = [{"building": 0.5, "running": 1.0, "laws": 0.02}]
    slower = [{"building": 1.5, "running": 1.0, "modes": 0.9}]
    turns = {"ours": ours, "CasADi": faster, "dynamax, hidden Markov": slower}
    parts = {"contact": {"origin": {"commit": "abc", "day": "2026-11-29"}, "turns": turns}}
    row = table(parts).splitlines()[2]
    assert row == (
        "| contact | 2.00 s | **0.50 + 1.00 s** | affine laws only | 1.50 + 1.00 s | 1 % / 2 % "
        "| 100 % / 90.00 % |"
    )
