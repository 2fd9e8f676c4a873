"""A logged gate that decides the mode: a threshold between its levels, instants of its steps."""

import re

import numpy as np
import pytest
from scipy.linalg import expm

from swsysid import (
    HybridAutomaton,
    HybridAutomatonRegressor,
    PolynomialSurfaceClassifier,
    SwitchingSystemRegressor,
    TrajectoryIdentifier,
)
from swsysid._stays.certainty import told_in_modes
from swsysid._stays.descent import Reached
from swsysid._stays.given import read_given
from swsysid._stays.identification import StayIdentification
from swsysid._stays.laws import Laws
from swsysid._stays.lifted import Estimate, Objective
from swsysid._stays.nodes import Nodes
from swsysid._stays.recordings import Recordings
from swsysid._stays.stays import Stays

STEP, ROWS, RECORDINGS = 0.02, 300, 4
CLOSED = np.array([[-0.2, -1.0], [1.0, -0.5]])  # and an input of 2 on the first state
OPEN = 1.5 * CLOSED


def flow(closed, duration):
    """The exact flow of one position of the gate, of (x0, x1, 1)."""
    system = np.zeros((3, 3))
    system[:2, :2] = CLOSED if closed else OPEN
    system[0, 2] = 2.0 if closed else 0.0
    return expm(system * duration)


def converter(seed, *, noise=0.01, levels=(0.0, 1.0), between=False):
    """Recordings of two states and a gate, and when it steps: at rows, or between two."""
    rng = np.random.default_rng(seed)
    whole, t = [flow(g, STEP) for g in (0, 1)], STEP * np.arange(ROWS)
    recordings, instants = [], []
    for _ in range(RECORDINGS):
        lengths = rng.integers(15, 60, ROWS // 15)
        gate = ((np.repeat(np.arange(len(lengths)), lengths) + rng.integers(2)) % 2)[:ROWS]
        x, steps = [np.append(rng.standard_normal(2), 1.0)], []
        for k, (now, then) in enumerate(zip(gate[:-1], gate[1:], strict=True)):
            share = rng.uniform() if between and now != then else 1.0
            late = flow(then, (1.0 - share) * STEP) @ flow(now, share * STEP)
            x.append((whole[now] if share == 1.0 else late) @ x[-1])
            steps += [STEP * (k + share)] if now != then else []
        measured = np.array(x)[:, :2] + noise * rng.standard_normal((ROWS, 2))
        recordings.append({"t": t, "x": measured, "inputs": np.take(levels, gate)[:, None]})
        instants.append(np.array(steps))
    return recordings, instants


@pytest.mark.parametrize(
    ("seed", "levels", "between", "noise"),
    [(0, (0.0, 1.0), False, 0.01), (1, (0.0, 5.0), False, 0.05), (1, (0.0, 1.0), True, 0.01)],
)
def test_a_gate_that_decides_the_mode_does_so_between_its_levels(seed, levels, between, noise):
    recordings, instants = converter(seed, levels=levels, between=between, noise=noise)
    found = TrajectoryIdentifier(SwitchingSystemRegressor(random_state=0)).fit(recordings)
    assert found.input_holds_ == (("between",) if between else ("zero",))
    constant, *others = found.estimator_.surface_.coef_[0]
    threshold = -constant / others[2]
    assert threshold == pytest.approx(np.mean(levels), abs=1e-6 * levels[1])
    assert np.count_nonzero(others) == 1
    # at rows to rounding; between them to what noise leaves of a step
    for own, true in zip(found.switch_times_, instants, strict=True):
        assert own == pytest.approx(true, abs=0.75 * STEP if between else 1e-9)
    order = np.argsort(found.coef_[:, 1, 0])  # the closed gate first
    laws = found.coef_[order][:, :, :2]
    errors = found.coef_errors_[order][:, :, :2]
    # twelve coefficients within four standard errors, of which chance leaves one in 1,300
    assert (np.abs(laws - [CLOSED, OPEN]) < 4.0 * errors).all()
    assert np.isinf(found.coef_errors_[order][1, :, 2]).all()  # a gate at zero tells no gain
    assert found.report_.rollouts.holds


@pytest.mark.parametrize(
    ("seed", "between", "noise"),
    # as it is; with stays that noise hides from the laws; with steps between the rows
    [(1, False, 0.05), (0, False, 0.1), (1, True, 0.01)],
)
def test_an_automaton_has_guards_between_the_levels_of_a_gate(seed, between, noise):
    recordings, instants = converter(seed, levels=(0.0, 5.0), noise=noise, between=between)
    found = HybridAutomatonRegressor("auto", random_state=0).fit(recordings)
    assert found.n_modes_ == 2
    assert found.input_holds_ == (("between",) if between else ("zero",))
    for one in found.automaton_.transitions:  # states, gate, dwell, time
        low, high = ([[x, -x, 2.5 + side, 1.0, 1.0] for x in (0.0, 3.0)] for side in (-0.01, 0.01))
        below, above = (one.guard.values(np.array(rows)) for rows in (low, high))
        assert (below * above < 0.0).all()
    order = np.argsort(found.coef_[:, 1, 1])  # the closed gate first
    laws, errors = found.coef_[order][:, :, 1:3], found.coef_errors_[order][:, :, 1:3]
    # eight coefficients within four standard errors, of which chance leaves one in 2,000
    assert (np.abs(laws - [CLOSED, OPEN]) < 4.0 * errors).all()
    for own, true in zip(found.switch_times_, instants, strict=True):
        # refined as instants like any others; between rows to what noise leaves of a step
        assert own == pytest.approx(true, abs=(0.75 if between else 0.05) * STEP)
    assert np.isinf(found.coef_errors_[order][1, :, 3]).all()  # a gate at zero tells no gain
    assert found.report_.rollouts.holds and found.report_.rollouts.tells_switches


def test_a_square_of_two_levels_is_no_feature_of_a_surface():
    gate = np.repeat([0.0, 1.0], 40)
    X = np.column_stack([np.random.default_rng(0).standard_normal(80), gate])
    surface = PolynomialSurfaceClassifier().fit(X, gate.astype(int))
    # of 1, x0, x1, x0^2, x0 x1, x1^2 the last is the third wherever there are data
    assert surface.coef_[0, 5] == 0.0
    assert -surface.coef_[0, 0] / surface.coef_[0, 2] == pytest.approx(0.5, abs=1e-6)


@pytest.mark.nightly
def test_a_mode_of_which_no_sample_has_both_neighbours_is_no_error():
    """A ball that jumps in one mode: what a second mode takes of it are single samples."""
    ball = HybridAutomaton.stated(
        [{"y": "v", "v": "-9.81"}], [(0, 0, "y <= 0", {"v": "-0.8 v"})], states=["y", "v"]
    )
    t = np.arange(0.0, 3.0, 0.02)
    x = ball.simulate([1.0, 0.0], t, mode=0).x
    x = x + 0.003 * np.random.default_rng(0).standard_normal(x.shape)
    regressor = SwitchingSystemRegressor(2, feature_library=1, random_state=0)
    found = TrajectoryIdentifier(regressor).fit(x, t)
    assert not found.report_.rollouts.holds


@pytest.mark.nightly
def test_a_law_with_products_of_the_gate_is_no_rival_of_the_modes_that_it_tells():
    recordings, _ = converter(0)
    asked = SwitchingSystemRegressor(feature_library=1, random_state=0)
    told = TrajectoryIdentifier(asked).fit(recordings).verdict_
    # (1 - g) f0 + g f1 is a law of degree two: as good, and no proof against the modes
    assert told.trusted and told.best_law != "quadratic"
    assert told.errors_of_laws["quadratic"] == pytest.approx(told.errors, rel=0.1)
    assert "One mode with quadratic terms is the same model" in told.sentence


@pytest.mark.nightly
def test_the_noise_of_a_gate_on_an_analog_channel_is_left_out():
    recordings, instants = converter(0, levels=(0.02, 4.98), noise=0.02)
    rng = np.random.default_rng(7)
    for one in recordings:
        one["inputs"] = one["inputs"] + 0.05 * rng.standard_normal((ROWS, 1))
    asked = SwitchingSystemRegressor(feature_library=1, random_state=0)
    found = TrajectoryIdentifier(asked).fit(recordings)
    assert found.input_holds_ == ("zero",)
    constant, *others = found.estimator_.surface_.coef_[0]
    # levels are means of some 500 values with noise of 0.05
    assert -constant / others[2] == pytest.approx(2.5, abs=0.01)
    for own, true in zip(found.switch_times_, instants, strict=True):
        assert own == pytest.approx(true, abs=1e-9)
    order = np.argsort(found.coef_[:, 1, 1])
    laws, errors = found.coef_[order][:, :, 1:3], found.coef_errors_[order][:, :, 1:3]
    assert (np.abs(laws - [CLOSED, OPEN]) < 4.0 * errors).all()
    assert np.isinf(found.coef_errors_[:, :, 3]).all()
    assert re.search(r"x2 has the levels \S+, 4.98; its noise of 0.0\d+ is", str(found.report_))
    assert found.verdict_.trusted


def test_a_mode_of_single_samples_has_no_terms_that_they_do_not_tell():
    rng, t = np.random.default_rng(0), 0.1 * np.arange(9.0)
    given = read_given(rng.standard_normal((9, 1)), t, None, rng.standard_normal((9, 1)))
    recordings = Recordings.of(given.records)
    nodes = Nodes(recordings, [Stays(np.array([0, 1, 0]), np.array([0.35, 0.45]))])
    coef = rng.standard_normal((2, 1, 3))
    laws = Laws(
        coef, lambda X: np.column_stack([np.ones(len(X)), X]), np.ones(1), np.ones_like(coef) > 0.0
    )
    estimate = Estimate(laws, nodes, recordings.in_a_row(recordings.guess))
    reached = Reached(estimate, Objective(np.full(1, 0.05), 0.4), 0.0)
    found = StayIdentification(SwitchingSystemRegressor(), reached, (), 0.0)
    assert told_in_modes(found) is found
