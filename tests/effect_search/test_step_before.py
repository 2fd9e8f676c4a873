"""What the states of a map show of a force: planted laws, neighbours by hand."""

import numpy as np
import pytest

from swsysid import EffectSearchCV
from swsysid._data.records import make_records
from swsysid._effect_search.evidence import StepBefore
from swsysid._effect_search.folds import SearchData
from swsysid.datasets import make_undeclared
from swsysid.effects import Delay, Drift, Lag, UnmeasuredDisturbance

N_STEPS = 1500


def test_neighbours_are_those_of_a_trajectory_without_a_gap():
    t = np.array([0.0, 1.0, 2.0, 5.0, 6.0, 0.0, 1.0])
    groups = np.array([0, 0, 0, 0, 0, 1, 1])
    x = np.arange(7.0)[:, None]
    records = make_records(x, 1, t=t, groups=groups, names=["x"])
    rows = np.array([0, 1, 3, 4, 5, 6])  # that of time 2 is not searched
    step = StepBefore.of(SearchData.whole(records, rows, x), 0)
    assert step.rows.tolist() == [1, 3, 5]
    assert step.before.tolist() == [0, 2, 4]
    assert step.state.tolist() == [0.0, 1.0, 3.0, 4.0, 5.0, 6.0]


def forced(seed, held=0.0):
    """x(k+1) = .7 x(k) + .8 u(k) + held u(k-1) + d(k), and what a noisy sensor says of x(k+1).

    The force d jumps now and then. The columns are x, u and u one step before.
    """
    rng = np.random.default_rng(seed)
    u, x = rng.standard_normal(N_STEPS + 1), np.zeros(N_STEPS + 1)
    force = np.repeat(rng.standard_normal(N_STEPS // 30), 30) if not held else np.zeros(N_STEPS)
    earlier = np.concatenate([[0.0], u[:-1]])
    for k in range(N_STEPS):
        x[k + 1] = 0.7 * x[k] + 0.8 * u[k] + held * earlier[k] + force[k]
    columns = np.column_stack([x, u, earlier])[:-1]
    targets = x[1:] + 0.3 * rng.standard_normal(N_STEPS)
    records = make_records(columns, 1, t=np.arange(float(N_STEPS)), names=["x", "u", "earlier"])
    data = SearchData.whole(records, np.arange(N_STEPS), targets[:, None])
    return StepBefore.of(data, 0), columns, targets


def explained_by_the_past(step, columns, targets):
    """By how much the earlier input lowers the logarithm of the squares: alone, beside a force."""
    usual = np.arange(N_STEPS)
    before, after = (step.law(columns[:, :n], targets, usual)[1:] for n in (2, 3))
    return np.log(np.divide(before, after))


@pytest.mark.parametrize("seed", range(4))
def test_a_law_beside_the_force_that_it_shows_is_not_biased(seed):
    step, columns, targets = forced(seed)
    biased = np.linalg.lstsq(columns[:, :2], targets, rcond=None)[0]
    coef, alone, beside = step.law(columns[:, :2], targets, np.arange(N_STEPS))
    assert biased[0] > 0.85
    np.testing.assert_allclose(coef, [0.7, 0.8], atol=0.08)  # standard errors of .02
    # of the force only its jumps are left, 50 in 1500 steps
    assert beside / N_STEPS == pytest.approx(0.3**2 + 2.0 / 30, rel=0.2)
    assert alone > 1.5 * beside


@pytest.mark.parametrize("seed", range(4))
def test_an_input_of_the_past_explains_nothing_beside_a_force_unless_it_acts(seed):
    alone, beside = explained_by_the_past(*forced(seed))
    assert alone > 0.1  # as an observer of the force
    assert abs(beside) < 0.02
    alone, beside = explained_by_the_past(*forced(seed, held=0.5))
    assert beside > 0.8 * alone > 0.5


@pytest.mark.nightly
@pytest.mark.filterwarnings("ignore::swsysid.GuardWarning")  # what a force does to modes
@pytest.mark.parametrize("missing", [{"unlisted": "intermittent_disturbance"}, {"effect": "delay"}])
def test_a_force_on_a_map_is_no_delay_and_a_delay_is_no_force(missing):
    data = make_undeclared(**missing, system="discrete", noise=0.02, random_state=300)
    library = [Lag(), Delay(), Drift(), UnmeasuredDisturbance()]
    search = EffectSearchCV(data.estimator, effects=library)
    search.fit(data.X, data.Xdot, t=data.t, groups=data.groups)
    expected = {"unmeasured_disturbance" if "unlisted" in missing else "delay"}
    assert {found.kind for found in search.effects_} == expected
