"""Evidence of a structure: a law that acts in few stretches, and one that is not there."""

import numpy as np
import pytest

from swsysid import EffectSearchCV, SwitchingSystemRegressor
from swsysid._effect_search.evidence import chance_of_gains
from swsysid._effect_search.greedy import Search
from swsysid.effects import ExtraMode, PlacedEffect, Polynomial

N_RUNS, LENGTH = 8, 100


def oscillators(size):
    """A spring that is stiffer by `size` beyond 0.9, where two runs of eight get to."""
    rng = np.random.default_rng(0)
    t = 0.1 * np.arange(LENGTH)
    phase = rng.uniform(0.0, 6.0, (N_RUNS, 1))
    reach = rng.uniform(0.5, 0.8, (N_RUNS, 1))
    reach[[0, 3]] = 1.3
    x = reach * np.sin(0.9 * t + phase)
    v = rng.uniform(-1.0, 1.0, (N_RUNS, 1)) * np.cos(1.7 * t + phase)
    pull = -2.0 * x - 0.5 * v - size * np.where(x > 0.9, x, 0.0)
    X, law = (np.stack(pair, axis=2).reshape(-1, 2) for pair in ((x, v), (v, pull)))
    groups = np.repeat(np.arange(N_RUNS), LENGTH)
    noise = 0.2 * rng.standard_normal(law.shape)
    return X, law + noise, np.tile(t, N_RUNS) + 20.0 * groups, groups


@pytest.fixture
def contexts(monkeypatch):
    """Of every search, in the order of the calls."""
    seen, run = [], Search.run

    def remembering(self):
        seen.append(self.context)
        return run(self)

    monkeypatch.setattr(Search, "run", remembering)
    return seen


def searched(size):
    X, Xdot, t, groups = oscillators(size)
    search = EffectSearchCV(SwitchingSystemRegressor(1), effects=[Polynomial(), ExtraMode()])
    return search.fit(X, Xdot, t=t, groups=groups)


def chance_of_a_mode(context):
    declared = context.priced(context.declared)
    more = context.structure((PlacedEffect(ExtraMode(), "modes", 0),), None)
    return chance_of_gains(context, declared, more)


def test_a_law_that_acts_in_two_runs_is_found(contexts):
    assert [found.kind for found in searched(1.0).effects_] == ["extra_mode"]
    assert chance_of_a_mode(contexts[-1]) < 1e-7  # measured: 1.3e-9


def test_where_there_is_none_chance_explains_what_one_more_mode_gains(contexts):
    assert searched(0.0).effects_ == []
    assert chance_of_a_mode(contexts[-1]) > 0.05
