"""Inputs that keep their value between two rows, in a search of recordings with one law."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.linalg import LinAlgError

from swsysid import EffectSearchCV, SwitchingSystemRegressor
from swsysid._data.recordings import Hold
from swsysid._data.records import make_records
from swsysid._effect_search.folds import Split
from swsysid._effect_search.recorded_search import _held
from swsysid._output_error.law import Law
from swsysid._output_error.scan import RolloutScore
from swsysid._output_error.stretches import Stretches
from swsysid._output_error.values import Values
from swsysid.effects import CoulombFriction, Delay, Lag

STEP, NOISE, RATE, GAIN = 0.1, 0.01, 1.2, 2.0


def commanded(late=0, seed=1, n_samples=600):
    """x' = -1.2 x + 2 u of a command that changes every seven samples, so many of them late."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1.0, 1.0, n_samples // 7 + 1), 7)[:n_samples]
    acting = np.concatenate([np.full(late, u[0]), u[: n_samples - late]])
    kept, x = np.exp(-RATE * STEP), np.zeros(n_samples)
    for k in range(n_samples - 1):  # exact while the input keeps its value
        x[k + 1] = kept * x[k] + (1.0 - kept) * GAIN / RATE * acting[k]
    return STEP * np.arange(n_samples), x + NOISE * rng.standard_normal(n_samples), u


def searched(t, x, u, effects=None, **options):
    library = [Delay(), Lag(), CoulombFriction()] if effects is None else effects
    declared = SwitchingSystemRegressor(1, feature_library=1, random_state=0)
    search = EffectSearchCV(declared, effects=library, **options)
    return search.fit(x[:, None], t=t, inputs=u[:, None])


def held_out(search):
    return search.report_["errors"][-1]["held_out"][0]


def test_a_command_is_held_without_being_told():
    data = commanded()
    told, by_itself = searched(*data, input_hold="zero"), searched(*data)
    on_lines = searched(*data, input_hold="linear")
    assert by_itself.effects_ == told.effects_ == []
    # 150 samples held out tell their noise to a few hundredths
    assert held_out(by_itself) == pytest.approx(NOISE, rel=0.15)
    assert held_out(told) == held_out(by_itself)
    assert "keeps its value until the next row" in str(by_itself.report_)
    # on a line the input begins half a step early, which is told as a delay that nobody has
    assert on_lines.effects_[0].kind == "delay"
    assert held_out(on_lines) > 1.2 * NOISE


@pytest.mark.parametrize("asked", ["next", "auto"])
def test_what_has_acted_before_it_was_logged_is_no_delay(asked):
    """A logger writes at the end of each interval what has acted in it."""
    t, x, u = commanded()
    search = searched(t, x, np.append(u[:1], u[:-1]), input_hold=asked)
    assert search.effects_ == []
    assert held_out(search) == pytest.approx(NOISE, rel=0.15)
    assert "acts a row before it is logged" in str(search.report_)
    # a rollout of the model takes the input as it acts
    run = search.best_estimator_.simulate(x[:1], t, u[:, None])
    np.testing.assert_allclose(run.x[:, 0], x, atol=5.0 * NOISE)
    logged = np.append(u[:1], u[:-1])[:, None]
    same = search.best_estimator_.simulate(x[:1], t, logged, input_hold="next")
    np.testing.assert_allclose(same.x, run.x, atol=1e-9)


def test_a_late_command_is_late_by_as_much_and_does_not_act_at_once():
    search = searched(*commanded(late=2))
    [found] = search.effects_
    assert found.kind == "delay"
    assert found.parameters["delay"] == pytest.approx(2 * STEP, abs=0.003)
    assert found.parameters["gain"] == pytest.approx(GAIN, abs=0.03)
    assert found.placed.replaced is not None  # the term of the present input is gone
    assert held_out(search) == pytest.approx(NOISE, rel=0.15)


def test_an_input_on_lines_stays_there():
    t, _, u = commanded()
    kept, drive = np.exp(-RATE * STEP), GAIN / RATE
    x, late = np.zeros(len(t)), (1.0 - np.exp(-RATE * STEP)) / (RATE * STEP)
    for k in range(len(t) - 1):
        x[k + 1] = kept * x[k] + drive * ((late - kept) * u[k] + (1.0 - late) * u[k + 1])
    x += NOISE * np.random.default_rng(2).standard_normal(len(t))
    search = searched(t, x, u)
    assert search.effects_ == []
    assert "keeps its value" not in str(search.report_)


def test_a_delay_of_what_is_held_is_its_mean_until_the_next_row():
    X = np.column_stack([np.zeros(5), [0.0, 0.0, 1.0, 1.0, 1.0]])
    records = make_records(X, 1, t=np.arange(5.0), names=["x", "u"])
    held = type(records)(**{**vars(records), "holds": {1: Hold.ROW}})
    # the step at 2 arrives at 2.25: a quarter of the interval that begins at 2 still has the zero
    np.testing.assert_allclose(Delay().columns(held, 1, 0.25)[:, 0], [0, 0, 0.75, 1, 1], atol=1e-12)
    np.testing.assert_allclose(Delay().columns(held, 1, 1.5)[:, 0], [0, 0, 0, 0.5, 1], atol=1e-12)
    # behind a lag of one unit of time the step at 2 is felt from there on
    expected = np.append([0.0, 0.0], 1.0 - np.exp(-np.arange(3.0)))
    np.testing.assert_allclose(Lag().columns(held, 1, 1.0)[:, 0], expected, atol=1e-6)


def test_a_wrong_hold_is_refused_in_a_sentence():
    t, x, u = commanded(n_samples=200)
    with pytest.raises(ValueError, match="input_hold='zro'"):
        searched(t, x, u, input_hold="zro")
    with pytest.raises(ValueError, match="say of each of 1 inputs"):
        searched(t, x, u, input_hold=("zero", "zero"))


def test_linear_algebra_that_fails_takes_no_other_effect_along(monkeypatch):
    beside, of = Values.beside, RolloutScore.of.__func__

    def failing(self, fit, more):
        if more.effect.kind == "lag":
            raise LinAlgError("a node is not held")
        yield from beside(self, fit, more)

    def refused(cls, fit, tie):
        if tie < 0.01:
            raise LinAlgError("a node is not held")
        return of(cls, fit, tie)

    monkeypatch.setattr(Values, "beside", failing)
    monkeypatch.setattr(RolloutScore, "of", classmethod(refused))
    [found] = searched(*commanded(late=2)).effects_
    assert found.kind == "delay"


@pytest.mark.parametrize("asked", ["zero", "auto"])
def test_what_an_input_does_is_asked_beside_the_disturbance_of_the_search(asked):
    """A search that has gone on with a larger disturbance keeps it."""
    t, x, u = commanded()
    records = make_records(np.column_stack([x, u]), 1, t=t, names=["x", "u"])
    rows = np.arange(len(t))
    stretches = replace(Stretches.of(records, records, rows), disturbance=1.0)
    law = Law.of(lambda X: X, np.ones((1, 2), dtype=bool), np.zeros((1, 2)))
    other, _ = _held(law, stretches, {}, Split(rows, rows[:0], "nothing"), asked)
    assert other.records.held == {1}
    assert other.disturbance == 1.0
