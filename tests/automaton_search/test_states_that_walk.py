"""Noise in the equation of an automaton: states walk beside the laws, and go on from there."""

from contextlib import nullcontext
from itertools import product

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from swsysid import GuardWarning, HybridAutomatonRegressor
from swsysid._data.features import Monomials
from swsysid._data.recordings import Record
from swsysid._stays.laws import Laws
from swsysid._stays.lifted import Estimate
from swsysid._stays.nodes import Nodes
from swsysid._stays.recordings import Recordings
from swsysid._stays.settings import SETTINGS
from swsysid._stays.stays import Stays
from swsysid._stays.walk import walk_of

STEP, N, PARTS = 0.05, 400, 10
SENSOR = 0.02
SIZES = np.geomspace(0.05, 5.0, 400)


def fridge(rng, walk, push=lambda t: 0.0):
    """Temperatures of a two-position controller, and how often it switches."""
    T, on, measured, n_switches = 20.0 + rng.uniform(-1.0, 1.0), True, [], 0
    for k in range(N):
        measured.append(T + SENSOR * rng.standard_normal())
        for part in range(PARTS):
            rate = -0.1 * T + (5.0 if on else 0.0) + push((k + part / PARTS) * STEP)
            T += STEP / PARTS * rate + walk * np.sqrt(STEP / PARTS) * rng.standard_normal()
            if (on and T >= 22.0) or (not on and T <= 18.0):
                on, n_switches = not on, n_switches + 1
    return {"t": STEP * np.arange(N), "x": np.array(measured)[:, None]}, n_switches


def fridges(walk, push=lambda t: 0.0):
    rng = np.random.default_rng(0)
    runs, counts = zip(*(fridge(rng, walk, push) for _ in range(6)), strict=True)
    return list(runs), sum(counts)


def fitted(runs, **options):
    return HybridAutomatonRegressor(**options, random_state=0).fit(runs)


def test_draughts_are_no_switches_and_no_noise_of_the_sensor():
    walk = 0.1
    runs, n_switches = fridges(walk)
    found = fitted(runs)
    assert found.n_modes_ == 2
    # one may lie within the last interval of a recording
    assert abs(sum(map(len, found.switch_times_)) - n_switches) <= 1
    assert found.noise_[0] == pytest.approx(SENSOR, rel=0.1)
    assert found.equation_noise_[0] == pytest.approx(walk * np.sqrt(STEP), rel=0.1)
    laws = zip(found.coef_[:, 0], found.coef_errors_[:, 0], (0.0, 5.0), strict=True)
    for law, errors, rate in laws:
        assert (np.abs(law - [rate, -0.1]) < 3.0 * errors).all()
    for one, level in zip(found.transitions_, (18.0, 22.0), strict=True):
        constant, slope = one.guard.coef[np.abs(one.guard.coef) > 0.0]
        # the plant asks ten times an interval, and walks by .007 meanwhile
        assert abs(-constant / slope - level) < 0.02
    assert "in the equation: x0 0.02" in str(found.report_)
    assert "a term or a mode is missing" not in str(found.report_)


@pytest.mark.parametrize(
    "push",
    [pytest.param(lambda t: 0.0, id="noise"), pytest.param(lambda t: 0.4 * np.sin(t), id="wave")],
)
def test_what_is_no_walk_is_not_called_one(push):
    """Neither the sensor's noise nor a wave that no law knows, whose innovations go on."""
    runs, _ = fridges(0.0, push)
    warned = pytest.warns(GuardWarning) if push(1.0) else nullcontext()
    with warned:
        assert fitted(runs, n_modes=2).equation_noise_ is None


def test_innovations_have_the_likelihood_of_the_joint_density():
    """Of x' = 0, against the dense normal density of all samples given the first one."""
    rng = np.random.default_rng(1)
    y = np.cumsum(0.2 * rng.standard_normal(25)) + 0.3 * rng.standard_normal(25)
    k = np.arange(1, len(y))
    record = Record(np.arange(25.0), y[:, None], np.zeros((25, 0)))
    law = Laws(np.zeros((1, 1, 1)), Monomials.up_to(0, 1), np.ones(1), np.ones((1, 1, 1), bool))
    recordings = Recordings.of([record])
    nodes = Nodes(recordings, [Stays(np.array([0]), np.zeros(0))])
    walk = walk_of(Estimate(law, nodes, y[:, None]), np.ones(1), SETTINGS)

    def dense(sensor, walk):
        walked = walk**2 * np.minimum.outer(k, k)
        covariance = sensor**2 * (1.0 + np.eye(len(k))) + walked
        return multivariate_normal(np.full(len(k), y[0]), covariance).logpdf(y[1:])

    sizes = [(0.3, 0.2), (0.1, 0.5), (0.6, 0.01)]
    seen = [walk.innovations.with_noise(*np.array([one]).T).nats for one in sizes]
    together = walk.innovations.with_noise(*np.array(sizes).T[:, None]).nats_of_trials
    np.testing.assert_allclose(together, seen, rtol=1e-12)
    joint = [dense(*one) for one in sizes]
    np.testing.assert_allclose(np.diff(seen), np.diff(joint), rtol=1e-9)
    # and no others are likelier
    best = dense(walk.sensor[0], walk.walk[0])
    around = product((0.97, 1.0, 1.03), repeat=2)
    assert all(dense(a * walk.sensor[0], b * walk.walk[0]) < best + 0.02 for a, b in around)
    assert walk.nats == pytest.approx(best - max(dense(a, 0.0) for a in SIZES), abs=0.02)


def test_one_law_beside_a_walk_is_one_mode():
    """Two laws would make up for it, with stays that come and go."""
    rng, runs = np.random.default_rng(3), []
    for _ in range(5):
        T, measured = rng.uniform(15.0, 25.0), []
        for _ in range(N):
            measured.append(T + SENSOR * rng.standard_normal())
            for _ in range(PARTS):
                T -= STEP / PARTS * 0.5 * (T - 20.0)
                T += 0.1 * np.sqrt(STEP / PARTS) * rng.standard_normal()
        runs.append({"t": STEP * np.arange(N), "x": np.array(measured)[:, None]})
    found = fitted(runs)
    assert found.n_modes_ == 1
    assert found.equation_noise_[0] == pytest.approx(0.1 * np.sqrt(STEP), rel=0.1)
    assert (np.abs(found.coef_[0, 0] - [10.0, -0.5]) < 3.0 * found.coef_errors_[0, 0]).all()
    assert "no proof against the laws" in found.report_.advice
