"""An input that shows in what is recorded of a state at once: a cell behind its own resistance."""

import numpy as np
import pytest

from swsysid import EffectSearchCV, SwitchingSystemRegressor
from swsysid._data.records import make_records
from swsysid.effects import Bias, Delay, Feedthrough, Lag, Polynomial

STEP, RATE, GAIN, NOISE, RESISTANCE = 1.0, 0.02, -0.01, 1e-3, 0.05


def cell(resistance, late=0):
    """v' = -.02 (v - 1) - .01 i, recorded as v - R i; the current steps at rows, held between."""
    rng = np.random.default_rng(0)
    current = np.repeat(rng.uniform(-2.0, 2.0, 30), 40)
    acts = np.append(np.full(late, current[0]), current)[: len(current)]
    v, decay = np.ones(len(current)), np.exp(-RATE * STEP)
    for k, now in enumerate(acts[:-1]):
        rest = 1.0 + GAIN / RATE * now
        v[k + 1] = rest + (v[k] - rest) * decay
    seen = v - resistance * current + NOISE * rng.standard_normal(len(v))
    return {"t": STEP * np.arange(len(v)), "x": seen[:, None], "inputs": current[:, None]}


@pytest.mark.parametrize("late", [0, 4])
def test_a_series_resistance_is_no_delay_and_a_delay_no_resistance(late):
    """Without the effect the resistance was a delay by one row, of two gains that cancel."""
    library = [Bias(), Delay(), Lag(), Polynomial(), Feedthrough()]
    declared = SwitchingSystemRegressor(1, feature_library=1, random_state=0)
    recording = cell(0.0 if late else RESISTANCE, late)
    search = EffectSearchCV(declared, effects=library, input_hold="zero").fit([recording])
    [found] = search.effects_
    if late:
        assert found.kind == "delay"
        assert found.parameters["delay"] == pytest.approx(late * STEP, abs=0.2)
        return
    assert (found.kind, found.place) == ("feedthrough", "x1")
    # the standard error is .1 % of it
    assert found.parameters["gain"] == pytest.approx(-RESISTANCE, rel=0.01)
    assert search.report_.errors[-1]["held_out"][0] == pytest.approx(NOISE, rel=0.15)
    assert any("x0 is recorded with -0.0" in line for line in search.equations())


def test_records_are_those_of_the_state_and_back():
    X = np.array([[1.0, 2.0], [3.0, -4.0]])
    records = make_records(X, 1, t=np.array([0.0, 1.0]), names=["v", "i"])
    effect = Feedthrough()
    assert effect.places(records) == [(0, 1)]
    true = effect.corrected(records, (0, 1), -0.5)
    np.testing.assert_array_equal(true.X, [[2.0, 2.0], [1.0, -4.0]])
    np.testing.assert_array_equal(effect.recorded(true, (0, 1), -0.5).X, X)
