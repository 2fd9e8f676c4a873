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


def test_a_guard_that_is_asked_at_samples_is_found_to_half_of_one():
    """A threshold of .8, which a quadric may be and a straight one explains."""
    starts = np.linspace(0.31, 0.75, 24)
    runs = recorded(lambda mode, x, _: mode == 0 and x >= 0.8, starts, 45)
    with pytest.warns(MisfitWarning, match="law of mode"):  # half a sample shows in rollouts
        found = HybridAutomatonRegressor(guard_degree=2, random_state=0).fit(runs)
    assert found.n_modes_ == 2 and ASKED in str(found.report_)
    [guard] = [one.guard for one in found.transitions_]
    assert guard.powers.sum(axis=1).max() == 1
    at = -guard.coef[0] / guard.coef[1]  # where it rises in the mean
    assert 0.8 < at < 0.8 + STEP * 0.2


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
    assert at_samples(SimpleNamespace(estimate=SimpleNamespace(nodes=nodes))) == are


def test_guards_are_compared_alike_in_seconds_and_milliseconds():
    """Where one of both descriptions has no guard of some switches."""

    def gap(second):
        own = SimpleNamespace(errors=np.full(8, 0.01 * second))
        some = SimpleNamespace(guard=None, switches=own)
        told = SimpleNamespace(guard=SimpleNamespace(cost=3.0), switches=own)
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
