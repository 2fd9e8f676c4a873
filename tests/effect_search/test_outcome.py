"""The judge of what stays: a row on the surface, whose mode nobody knows, decides nothing."""

import numpy as np
import pytest

from benchmarks.laboratory.__main__ import run_cell
from benchmarks.undeclared.fresh import Drawn
from swsysid import EffectSearchCV
from swsysid._data.records import make_records
from swsysid._effect_search.chance import BlockSum
from swsysid._effect_search.folds import StateNoise
from swsysid._effect_search.outcome import Fall, HeldOutJudge
from swsysid.datasets import make_undeclared
from swsysid.effects import CoulombFriction, Drift, PlacedEffect, QuadraticDrag


@pytest.mark.nightly
def test_two_rows_on_the_surface_are_no_veto():
    # 572 rows; with the right shape two of those held out, which are as likely in either mode, are
    # on the wrong side, where the error is twenty times the noise
    data = Drawn.of(5031).record()
    search = EffectSearchCV(data.estimator).fit(data.X, data.Xdot, t=data.t, groups=data.groups)
    (effect,) = search.effects_
    assert effect.kind == "unknown_function" and effect.placed.place == 0
    assert "of 190 rows, whose mode is not sure" in search.report_.summary
    test = data.test
    declared, found = (
        np.sqrt(np.mean((predicted - test.Xdot_clean)[:, 1] ** 2))
        for predicted in (
            search.report_.data.models[0].predict(test.X, t=test.t, groups=test.groups),
            search.predict(test.X, t=test.t, groups=test.groups),
        )
    )
    # measured: .007 of .098
    assert found < 0.2 * declared


@pytest.mark.nightly
@pytest.mark.filterwarnings("ignore::swsysid.GuardWarning")  # what a force does to modes
def test_a_force_that_is_switched_on_now_and_then_is_no_mode():
    data = make_undeclared(unlisted="intermittent_disturbance", system="quartic", random_state=230)
    search = EffectSearchCV(data.estimator).fit(data.X, data.Xdot, t=data.t, groups=data.groups)
    assert [effect.kind for effect in search.effects_] == ["unmeasured_disturbance"]
    assert search.effects_[0].target == 1
    assert search.report_.tried == ()


@pytest.mark.parametrize(
    ("fall", "promised", "is_refuted"),
    [
        (BlockSum(3.0, 1.0, 8), 3.0, False),
        (BlockSum(0.5, 1.0, 8), 3.0, True),  # less than its standard error
        (BlockSum(0.5, 1.0, 8), 1.5, False),  # which so few rows promise no more than
        (BlockSum(-1.0, 1.0, 8), 1.5, True),
        (BlockSum(0.0, 0.0, 8), 0.0, False),  # none of these rows shows it
    ],
)
def test_an_effect_stays_if_the_error_falls_as_clearly_as_it_was_to(fall, promised, is_refuted):
    assert Fall(fall, promised, 1.0).is_refuted == is_refuted


def test_what_is_refused_does_not_come_back(monkeypatch):
    # whatever is found, the untouched rows refute it
    refuted = Fall(BlockSum(-1.0, 0.1, 8), 1.0, 0.1)
    monkeypatch.setattr(HeldOutJudge, "gain", lambda *fits: refuted)
    planted = ("coulomb_friction", "drift")
    data = make_undeclared(planted, system="pendulum", n_samples=800, random_state=0)
    search = EffectSearchCV(data.estimator, effects=[CoulombFriction(), QuadraticDrag(), Drift()])
    search.fit(data.X, data.Xdot, t=data.t, groups=data.groups)
    assert search.effects_ == []
    tried = [one["effect"] for one in search.report_.tried]
    assert len(tried) == len(set(tried)) >= 2


def test_noise_hides_rows_at_rest_where_there_is_dry_friction():
    # two standard deviations of the noise are .02 of the rate, which is the second state
    X = np.column_stack([np.zeros(5), [-0.5, -0.019, 0.0, 0.021, 0.5], np.zeros(5)])
    records, rows = (
        make_records(X, 2, t=np.arange(5.0), names=list("qvu")),
        np.array([4, 3, 2, 1, 0]),
    )
    friction = PlacedEffect(CoulombFriction(), 1, 1)
    noise = StateNoise(np.array([1.0, 0.01]))
    hidden = noise.hides([friction], records, rows)
    assert hidden.tolist() == [False, False, True, True, False]
    assert not noise.hides([PlacedEffect(QuadraticDrag(), 1, 1)], records, rows).any()


@pytest.mark.nightly
def test_a_servo_that_sticks_for_much_of_a_recording_has_friction_and_nothing_else():
    # what holds it at rest is no function of anything and no force: rows there have no say
    (record,) = run_cell("servo", 2)
    assert record["found"] == ["load_friction of |x3| sign(x1)"]
    before, after = record["rollouts"]  # of recordings that nothing has seen
    assert after < 0.1 * before  # measured: .754 -> .033
