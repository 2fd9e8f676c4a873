"""Rare is not wrong: gross errors that lie together are a finding, scattered ones are outliers."""

import re

import numpy as np
import pytest

from swsysid import EffectSearchCV, IdentificationWarning, SwitchingSystemRegressor
from swsysid.datasets import make_undeclared
from swsysid.effects import CoulombFriction, QuadraticDrag

N_RUNS, LENGTH, STOP = 8, 250, 1.2


def oscillators(seed=0, stop=np.inf):
    """Masses on springs, with noise of 0.05 on the acceleration; a stop pushes them back."""
    rng = np.random.default_rng(seed)
    t = 0.02 * np.arange(LENGTH)
    x, v = rng.uniform(-0.4, 0.4, (2, N_RUNS))
    x[:2], v[:2] = 1.0, 1.6  # two of them get there
    X, Xdot = np.empty((N_RUNS, LENGTH, 2)), np.empty((N_RUNS, LENGTH, 2))
    for row in range(LENGTH):
        pull = -4.0 * x - 0.5 * v - 120.0 * np.maximum(x - stop, 0.0)
        X[:, row], Xdot[:, row] = np.stack([x, v], axis=1), np.stack([v, pull], axis=1)
        v = v + 0.02 * pull
        x = x + 0.02 * v
    Xdot[:, :, 1] += 0.05 * rng.standard_normal((N_RUNS, LENGTH))
    groups = np.repeat(np.arange(N_RUNS), LENGTH)
    return X.reshape(-1, 2), Xdot.reshape(-1, 2), np.tile(t, N_RUNS) + 10.0 * groups, groups


def searched(X, Xdot, t, groups):
    declared = SwitchingSystemRegressor(1, feature_library=1, random_state=0)
    search = EffectSearchCV(declared, effects=[CoulombFriction(), QuadraticDrag()])
    return search.fit(X, Xdot, t=t, groups=groups).report_


def test_rows_that_lie_together_in_two_trajectories_are_a_law_that_acts_rarely():
    X, Xdot, t, groups = oscillators(stop=STOP)
    at_stop = X[:, 0] > STOP
    assert 10 <= at_stop.sum() <= 40
    report = searched(X, Xdot, t, groups)
    aside = report.set_aside
    assert aside["is_finding"]
    assert report.acts_rarely
    assert not report.clean
    place = aside["place"]
    assert (place["channel"], aside["n_trajectories"]) == ("x0", 2)
    # all rows that are deep inside the stop and none outside of it
    assert place["interval"][0] >= STOP
    assert place["n_rows"] == aside["n_together"]
    assert aside["n_together"] >= 0.6 * at_stop.sum()
    assert "a law acts rarely" in report.summary
    assert "another law acts there" in str(report)


def test_a_pair_of_outliers_does_not_hide_the_place_of_the_others():
    X, Xdot, t, groups = oscillators(stop=STOP)
    elsewhere = np.flatnonzero(groups == 4)[[40, 41]]
    Xdot[elsewhere, 1] += 5.0
    report = searched(X, Xdot, t, groups)
    aside = report.set_aside
    place = aside["place"]
    assert place["channel"] == "x0"
    assert place["interval"][0] >= STOP
    assert place["n_rows"] == aside["n_together"] - 2
    assert place["others"] <= 0.02  # the outermost rows of the stop are not gross
    assert f", {place['n_rows']} with x0 between" in str(report)


def test_an_error_that_gross_rows_decide_is_told_without_them_too():
    X, Xdot, t, groups = oscillators()
    Xdot[:, 1] -= 0.3 * np.sign(X[:, 1])
    rng = np.random.default_rng(1)
    gross, signs = rng.choice(len(Xdot), 30, replace=False), rng.choice([-1.0, 1.0], 30)
    for size, all_rows in ((40.0, "; that of all rows is no lower."), (5.0, ", and ")):
        errors = np.zeros(len(Xdot))
        errors[gross] = size * signs
        report = searched(X, Xdot + errors[:, None] * [0.0, 1.0], t, groups)
        # rollouts, of states that have no friction, are not asked of what is as plain as that
        assert [effect.kind for effect in report.effects] == ["coulomb_friction"]
        before, after = report.data.usual_errors
        assert after[1] < 0.3 * before[1]
        assert f"{after[1]:.4g} instead of {before[1]:.4g}" in report.summary
        assert "without the rows set aside" in report.summary
        assert all_rows in report.summary


def test_rows_that_fill_an_interval_of_time_are_an_event_with_its_limits_and_its_law():
    # a constant load of 1.5 is on for a second in one trajectory
    X, Xdot, t, groups = oscillators()
    on = (groups == 3) & (t > 31.0 - 1e-9) & (t < 32.0 + 1e-9)
    Xdot[on, 1] += 1.5
    report = searched(X, Xdot, t, groups)
    event = report.time_interval
    assert event["trajectory"] == "3"
    assert (event["begin"], event["end"]) == pytest.approx((t[on][0], t[on][-1]))
    assert not report.acts_rarely
    assert not report.clean
    # the law is that of the plant and the load: -4 x0 - 0.5 x1 + 1.5, from 51 rows
    assert event["law"][0] == "x0' = 1.000 x1"
    law = event["law"][1]
    assert float(law.split()[2]) == pytest.approx(1.5, abs=0.1)
    assert float(re.search(r"- (\S+) x0", law)[1]) == pytest.approx(4.0, abs=0.3)
    assert "another law acts for that time" in report.summary
    assert report.summary.startswith("No effect that was looked for is missing at all times.")
    # that it is seen again in another trajectory refutes that it is one event
    again = (groups == 5) & (t > 51.0) & (t < 52.0)
    Xdot[again, 1] += 1.5
    report = searched(X, Xdot, t, groups)
    assert report.time_interval is None
    assert report.acts_rarely
    assert "at no place of their own: another law acts at times" in str(report)


def test_an_event_may_be_seen_several_times_among_scattered_errors():
    # the load is on three times in one trajectory, and gross errors are everywhere
    X, Xdot, t, groups = oscillators()
    spans = [(30.5, 31.1), (32.0, 32.8), (34.0, 34.5)]
    for begin, end in spans:
        Xdot[(groups == 3) & (t > begin - 1e-9) & (t < end + 1e-9), 1] += 1.5
    rng = np.random.default_rng(1)
    Xdot[rng.choice(len(Xdot), 40, replace=False), 1] += rng.choice([-5.0, 5.0], 40)
    report = searched(X, Xdot, t, groups)
    event = report.time_interval
    assert event["trajectory"] == "3"
    np.testing.assert_allclose(event["intervals"], spans, atol=0.03)
    assert (event["begin"], event["end"]) == (event["intervals"][0][0], event["intervals"][2][1])
    assert event["n_rows"] == pytest.approx(31 + 41 + 26, abs=3)
    assert "32 to 32.8 and 34 to 34.5 in trajectory 3" in report.summary
    assert "It is seen 3 times" in report.summary


def test_scattered_gross_errors_are_outliers():
    X, Xdot, t, groups = oscillators()
    rng = np.random.default_rng(1)
    rows = 40 * np.arange(40) + rng.integers(1, 39, 40)
    Xdot[rows, 1] += rng.choice([-5.0, 5.0], 40)
    report = searched(X, Xdot, t, groups)
    assert report.set_aside["n_rows"] == 40
    assert not report.acts_rarely
    assert "40 rows (2.0%) have gross errors" in str(report)


def test_an_equation_that_is_exact_takes_no_part():
    # x' = v is known and recorded to rounding; the drag is in the other equation
    X, Xdot, t, groups = oscillators()
    Xdot[:, 1] -= 0.8 * X[:, 1] * np.abs(X[:, 1])
    report = searched(X, Xdot, t, groups)
    assert report.exact == ("x0",)
    assert [effect.target for effect in report.effects] == [1]
    assert report.summary.startswith("Quadratic drag of x1 in x1', p < 1e-16: with it")
    assert report.data.most_changed == 1
    assert np.isfinite([effect.error_after for effect in report.effects]).all()
    assert re.search(r"declared model +exact ", str(report))
    # nor in a refinement on rollouts
    free = report.data.final.stated().free[0]
    assert not free[0].any()
    assert free[1, :-1].all()


def test_a_declared_model_that_explains_nothing_is_an_alarm():
    # at rest but for a few samples, which an l1 fit takes for outliers
    rng = np.random.default_rng(0)
    X = rng.uniform(-1.0, 1.0, (600, 1))
    moving = rng.uniform(size=600) < 0.2
    Xdot = np.where(moving[:, None], 3.0 * X, 0.0) + 1e-3 * rng.standard_normal((600, 1))
    declared = SwitchingSystemRegressor(1, feature_library=1, random_state=0)
    search = EffectSearchCV(declared, effects=[QuadraticDrag()])
    with pytest.warns(IdentificationWarning, match="explains 0% of the variation of x0'"):
        search.fit(X, Xdot, t=0.1 * np.arange(600.0))
    (alarm,) = search.report_.alarms
    assert search.report_.summary.startswith(alarm)


def test_what_does_not_lower_the_untouched_error_is_listed_as_tried():
    # dry friction in the searched trajectories alone: something drives the untouched ones
    data = make_undeclared("coulomb_friction", system="pendulum", n_samples=1600, random_state=0)
    clean = make_undeclared(None, system="pendulum", n_samples=1600, random_state=0)
    search = EffectSearchCV(data.estimator, effects=[CoulombFriction()])
    search.fit(data.X, data.Xdot, t=data.t, groups=data.groups)
    rows = search.report_.data.rows
    assert len(search.effects_) == 1
    assert search.report_.tried == ()
    X, Xdot = data.X.copy(), data.Xdot.copy()
    X[rows], Xdot[rows] = clean.X[rows], clean.Xdot[rows]
    Xdot[rows, 1] += 2.0 * np.sign(X[rows, 1])
    search.fit(X, Xdot, t=data.t, groups=data.groups)
    assert search.effects_ == []
    (tried,) = search.report_.tried
    assert tried["effect"] == "coulomb friction of x1 in x1'"
    assert tried["p_value"] < 0.01
    assert tried["after"][1] > 0.9 * tried["before"][1]  # it hardly falls, and not in each block
    assert "Significant, not kept" in str(search.report_)
    assert "coulomb friction" in search.report_.to_html()
