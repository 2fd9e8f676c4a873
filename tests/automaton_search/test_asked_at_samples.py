"""Switches that a controller decides at samples, and those that happen there anyhow."""

from types import SimpleNamespace

import numpy as np
import pytest

from swsysid import HybridAutomatonRegressor, MisfitWarning
from swsysid._automaton_search.switches import at_samples
from swsysid._automaton_search.transitions import nats_of

STEP = 0.05
ASKED = "what decides is asked there"


def recorded(decides, starts, n_rows):
    """x' = 1 - x or -x, exact between samples; what decides is asked at each of them."""
    runs = []
    for start in starts:
        x, mode, since, rows = start, 0, 0, []
        for _ in range(n_rows):
            rows.append(x)
            if decides(mode, x, since):
                mode, since = 1 - mode, 0
            x = (x - (mode == 0)) * np.exp(-STEP) + (mode == 0)
            since += 1
        runs.append({"t": STEP * np.arange(n_rows), "x": np.array(rows)[:, None]})
    return runs


def test_a_guard_that_is_asked_at_samples_lies_between_them():
    """A threshold of .8, which a quadric may be and a straight one explains."""
    starts = np.linspace(0.31, 0.75, 24)
    runs = recorded(lambda mode, x, _: mode == 0 and x >= 0.8, starts, 45)
    found = HybridAutomatonRegressor(guard_degree=2, random_state=0).fit(runs)
    assert found.n_modes_ == 2 and ASKED in str(found.report_)
    [guard] = [one.guard for one in found.transitions_]
    assert guard.powers.sum(axis=1).max() == 1
    assert -guard.coef[0] / guard.coef[1] == pytest.approx(0.8, abs=1e-12)  # a short number
    switched = [np.flatnonzero(np.diff(own))[:1] + 1 for own in np.split(found.modes_, len(runs))]
    first = [np.flatnonzero(one["x"][:, 0] >= 0.8)[:1] for one in runs]
    np.testing.assert_array_equal(switched, first)
    start, t = runs[0]["x"][0], runs[0]["t"]
    finer = np.linspace(0.0, t[-1], 4 * len(t) - 3)  # the guard is asked as often as before
    rolled = found.simulate(start, finer, mode=int(found.modes_[0]))
    np.testing.assert_allclose(rolled.x[::4], runs[0]["x"], atol=1e-6)


@pytest.mark.parametrize(
    ("samples", "are"),
    [([], False), (range(3, 8), False), (range(3, 9), True), ([*range(3, 9), 20.02], False)],
)
def test_few_instants_may_lie_on_samples_by_chance(samples, are):
    """To a hundredth of an interval: of five by 3e-9, of six by 6e-11."""
    times = STEP * np.arange(40)
    recordings = SimpleNamespace(times=[times, times], sampled=[np.arange(40)] * 2, interval=STEP)
    stays = [SimpleNamespace(instants=STEP * np.array(one, float)) for one in (samples, [])]
    in_steps = np.zeros(len(samples), dtype=bool)
    nodes = SimpleNamespace(stays=stays, recordings=recordings, in_steps=in_steps)
    found = SimpleNamespace(estimate=SimpleNamespace(nodes=nodes))
    assert at_samples(found, np.zeros(len(samples))) == are


@pytest.mark.parametrize(("error", "are"), [(0.05, True), (0.08, True), (0.1, False)])
def test_instants_with_errors_lie_on_samples_if_these_are_small_enough(error, are):
    """Twenty that are off by one: 1.6, 1.1 and .9 nats each for samples; a billion has 20.7."""
    times = STEP * np.arange(60)
    off = error * STEP * np.tile([-1.0, 1.0], 10)
    stays = [SimpleNamespace(instants=STEP * np.arange(5, 45, 2) + off)]
    recordings = SimpleNamespace(times=[times], sampled=[np.arange(60)], interval=STEP)
    in_steps = np.zeros(20, dtype=bool)
    nodes = SimpleNamespace(stays=stays, recordings=recordings, in_steps=in_steps)
    found = SimpleNamespace(estimate=SimpleNamespace(nodes=nodes))
    assert at_samples(found, np.full(20, error * STEP)) == are
    assert not at_samples(found, np.full(20, 0.2 * error * STEP))  # five errors off


def test_a_thermostat_that_asks_at_samples_is_found_with_noise():
    """Laws leave nothing but noise, and thresholds are 3 and 6."""
    rng = np.random.default_rng(5)
    x, on, rows = 5.0, False, []
    for _ in range(600):
        on = x > 6.0 or (on and x >= 3.0)
        rows.append(x)
        rest = 21.0 - 32.0 * on
        x = rest + (x - rest) * np.exp(-0.01)
    measured = np.array(rows)[:, None] + 0.03 * rng.standard_normal((600, 1))
    # laws with errors pass a threshold a sample sooner or later
    with pytest.warns(MisfitWarning, match="law of mode"):
        found = HybridAutomatonRegressor(feature_library=1, random_state=0).fit(
            measured, np.arange(600.0)
        )
    assert ASKED in str(found.report_) and found.noise_[0] < 1.1 * 0.03
    levels = {1.0: 6.0, -1.0: 3.0}
    for one in found.automaton_.transitions:
        at = np.array([[0.0, 1.0, 0.0], [1.0, 1.0, 0.0]])
        zero, ahead = one.guard.values(at)
        sign = float(np.sign(ahead - zero))
        # thresholds to a third of what a sample moves the state by
        assert -zero / (ahead - zero) == pytest.approx(levels[sign], abs=0.04)
    order = np.argsort(found.coef_[:, 0, 0])
    true, errors = [[-0.11, -0.01], [0.21, -0.01]], found.coef_errors_[order][:, 0]
    assert (np.abs(found.coef_[order][:, 0] - true) < 4.0 * errors).all()


def test_guards_are_compared_alike_in_seconds_and_milliseconds():
    """Where one of both descriptions has no guard of some switches."""

    def gap(second):
        own = SimpleNamespace(errors=np.full(8, 0.01 * second))
        some = SimpleNamespace(guard=None, switches=own)
        of_state = SimpleNamespace(powers=np.array([[1, 0, 0]]))
        told = SimpleNamespace(guard=SimpleNamespace(cost=3.0, guard=of_state), switches=own)
        return nats_of([told, told], STEP * second) - nats_of([told, some], STEP * second)

    assert gap(1e3) == pytest.approx(gap(1.0), rel=1e-12)
    assert gap(1.0) == pytest.approx(3.0 + 8.0 * np.log(0.01 / STEP))


def test_a_clock_that_ends_on_samples_is_exact():
    """Forty samples each: the instants lie on samples, and a clock explains them all."""
    runs = recorded(lambda mode, x, since: since == 40, [0.31, 0.47, 0.58, 0.66], 400)
    found = HybridAutomatonRegressor(random_state=0).fit(runs)
    assert found.n_modes_ == 2 and ASKED not in str(found.report_)
    told = " ".join(found.equations(precision=4))
    assert "dwell >= 2.0000" in told


def test_which_sample_it_was_is_asked_where_instants_tell_it_and_only_there():
    """A state that grows and decays: slowly near zero, where noise hides which sample it was."""
    rng, step, runs = np.random.default_rng(0), 0.01, []
    for x, grows in ((0.3, 1), (1.0, 0), (2.0, 1), (3.0, 0), (0.5, 1), (4.0, 0)):
        states = []
        for _ in range(900):
            states.append(x)
            grows = (x < 5.0) if grows else (x <= 0.1)
            x *= np.exp((3.0 if grows else -3.0) * step)
        noise = 0.04 * rng.standard_normal((900, 1))
        runs.append({"t": step * np.arange(900), "x": np.array(states)[:, None] + noise})
    fall, level = HybridAutomatonRegressor(random_state=0).fit(runs).transitions_
    # a thirtieth of an interval beside one and a half
    assert fall.asked_every is None and level.asked_every == pytest.approx(step)
    for one, at in ((fall, 0.1), (level, 5.0)):
        (condition,) = one.guard.conditions
        constant, slope = condition.coef
        assert -constant / slope == pytest.approx(at, rel=0.03)  # one sample of the change
