"""The search for effects is honest: one p-value, one seed, the warnings of the model inside."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer
from sklearn.utils.estimator_checks import (
    check_fit_idempotent,
    check_regressor_data_not_an_array,
)

from swsysid import EffectRegressor, EffectSearchCV, IdentificationWarning, SwitchingSystemRegressor
from swsysid._effect_search.acceptance import confirmed, finding
from swsysid._effect_search.chance import BlockSum
from swsysid._effect_search.greedy import Round, Search
from swsysid._effect_search.outcome import Fall
from swsysid._effect_search.report import dropped
from swsysid._pipelines import seeded
from swsysid.effects import (
    CoulombFriction,
    ExtraMode,
    GuardHysteresis,
    PlacedEffect,
    QuadraticDrag,
    Reset,
)
from swsysid.effects._guards import Guard

SIGNIFICANCE = 0.01


def driven(n_rows=400, friction=0.0, seed=0):
    """v' = -v + u, below v = 0 with twice the damping, and dry friction; times of 0.05."""
    rng = np.random.default_rng(seed)
    t = 0.05 * np.arange(n_rows)
    u = np.sin(1.3 * t) + np.sin(0.47 * t + 1.0)
    v = np.empty(n_rows)
    v[0] = 0.1
    law = lambda v, u: -np.where(v > 0.0, 1.0, 2.0) * v + u - friction * np.sign(v)  # noqa: E731
    for row in range(1, n_rows):
        v[row] = v[row - 1] + 0.05 * law(v[row - 1], u[row - 1])
    Xdot = law(v, u) + 0.01 * rng.standard_normal(n_rows)
    return np.column_stack([v, u]), Xdot[:, None], t


@pytest.fixture
def searches(monkeypatch):
    """What every `Search` was and found, in the order of the calls."""
    seen = []
    run = Search.run

    def remembering(self):
        answer = run(self)
        seen.append((self, answer[0]))
        return answer

    monkeypatch.setattr(Search, "run", remembering)
    return seen


@pytest.mark.parametrize(
    "spurious",
    [
        PlacedEffect(QuadraticDrag(), place=1, target=0),
        PlacedEffect(
            GuardHysteresis(), place=Guard(((0,),), (1.0,), 1), target=0, theta=(-0.2, 0.2)
        ),
        PlacedEffect(Reset(), place=(0, 1), target=0, theta=(0.5,)),
    ],
    ids=lambda placed: placed.effect.kind,
)
def test_what_chance_explains_isdropped_and_what_is_needed_stays(searches, spurious):
    X, Xdot, t = driven(friction=0.4)
    declared = SwitchingSystemRegressor(2, feature_library=1, random_state=0)
    library = [CoulombFriction(), QuadraticDrag(), GuardHysteresis(), Reset()]
    found = EffectSearchCV(declared, effects=library).fit(X, Xdot, t=t)
    assert all(effect.p_value <= SIGNIFICANCE for effect in found.effects_)
    search, structure = searches[-1]
    context = search.context
    more = context.structure((*structure.terms, spurious), structure.fit.modes)
    found_last = finding(context, more, len(more.terms) - 1)
    assert found_last.p_value > SIGNIFICANCE
    kept, findings = confirmed(context, more)
    kinds = [term.effect.kind for term in kept.fit.terms]
    assert kinds == [term.effect.kind for term in structure.fit.terms]
    assert len(findings) == len(kinds)
    assert all(finding.p_value <= SIGNIFICANCE for finding in findings)
    # the report says which effect of the last round is not among those at the end
    (told,) = dropped([Round(found_last, more, 1)], kept.terms, context.data.records)
    assert told.startswith(spurious.effect.kind.replace("_", " "))


def test_a_system_without_memory_has_no_hysteresis():
    # two affine modes that drive the state to their border, without noise
    x = np.array([0.024, -0.041])
    states = [x]
    for _ in range(500):
        below = x[1] + 0.714286 * x[0] < 0.0
        end, factor = ([-0.7, 0.7], np.exp(-0.01)) if below else ([0.7, -0.7], np.exp(-0.02))
        x = end + (x - np.array(end)) * factor
        states.append(x)
    X, t = np.array(states), 0.01 * np.arange(500)
    declared = SwitchingSystemRegressor(2, feature_library=1)
    for seed in range(2):
        search = EffectSearchCV(declared, effects=[GuardHysteresis()], random_state=seed)
        search.fit(X[:-1], np.diff(X, axis=0) / 0.01, t=t)
        assert search.effects_ == []


def test_a_guard_is_priced_beside_the_coefficients_of_the_surface_that_it_replaces(searches):
    X, Xdot, t = driven()
    declared = SwitchingSystemRegressor(2, feature_library=1, random_state=0)
    EffectSearchCV(declared, effects=[GuardHysteresis()]).fit(X, Xdot, t=t)
    context = searches[-1][0].context
    own = np.count_nonzero(context.declared.laws.estimator.surface_.coef_) - 1  # one is a scale
    for terms, weights in [(((0,),), (1.0,)), (((0,), (1,)), (1.0, 0.5))]:
        guard, effect = Guard(terms, weights, 1), GuardHysteresis()
        for band, thresholds in [((-0.2, 0.2), 2), ((0.1, 0.1), 1)]:
            term = PlacedEffect(effect, place=guard, target=0, theta=band)
            priced = context.priced(replace(context.declared, terms=(term,), coef=(np.zeros(0),)))
            assert priced.n_parameters == len(terms) - 1 + thresholds - own


def test_a_guard_of_two_modes_is_priced_beside_one_more(searches):
    X, Xdot, t = driven()
    stop = X[:, 0] > np.quantile(X[:, 0], 0.9)
    Xdot[stop] -= 40.0 * (X[stop, :1] - X[stop, 0].min())
    declared = SwitchingSystemRegressor(2, feature_library=1, random_state=0)
    EffectSearchCV(declared, effects=[GuardHysteresis(), ExtraMode()]).fit(X, Xdot, t=t)
    context = searches[-1][0].context
    guard = PlacedEffect(
        GuardHysteresis(), place=Guard(((0,),), (1.0,), 1), target=0, theta=(-0.2, 0.2)
    )
    both = context.structure((guard, PlacedEffect(ExtraMode(), "modes", 0)), None)
    assert both.fit.n_modes == 3 and np.isfinite(both.rows).all()


def test_a_surface_with_a_slope_is_no_band_of_one_state():
    # the mode is that of x1 + x2 / 5 with noise, and x2 is the rate of x1: a band of x1 is near it
    rng = np.random.default_rng(0)
    t = 0.05 * np.arange(2000)
    states = np.column_stack([np.sin(1.7 * t), 1.7 * np.cos(1.7 * t)])
    states *= (1.0 + 0.3 * np.sin(0.11 * t))[:, None]
    upper = states @ [1.0, 0.2] + 0.02 * rng.standard_normal(len(t)) > 0.1
    Xdot = states @ [-1.0, 0.3] + np.where(upper, 2.0, -1.0) * states[:, 1]
    Xdot = np.column_stack([states[:, 1], Xdot + 0.05 * rng.standard_normal(len(t))])
    declared = SwitchingSystemRegressor(2, feature_library=1, random_state=0)
    search = EffectSearchCV(declared, effects=[GuardHysteresis()]).fit(states, Xdot, t=t)
    assert search.effects_ == []


@pytest.mark.nightly
def test_a_record_that_is_fitted_in_passes_is_searched():
    # more rows than the programs hold at once, from a few starts
    n_runs, n_steps = 4, 10_250
    x = np.random.default_rng(0).normal(scale=0.3, size=(n_runs, 2))
    states = [x]
    for _ in range(n_steps):
        above = (x @ [0.714286, 1.0] > 0.0)[:, None]
        end = np.where(above, [0.7, -0.7], [-0.7, 0.7])
        x = end + (x - end) * np.exp([-0.02, -0.01])
        states.append(x)
    X = np.array(states).transpose(1, 0, 2)
    Xdot = (np.diff(X, axis=1) / 0.01).reshape(-1, 2)
    groups = np.repeat(np.arange(n_runs), n_steps)
    t = np.tile(0.01 * np.arange(n_steps), n_runs)
    declared = SwitchingSystemRegressor(2, feature_library=1, random_state=0)
    search = EffectSearchCV(declared, effects=[GuardHysteresis()])
    search.fit(X[:, :-1].reshape(-1, 2), Xdot, t=t, groups=groups)
    assert search.effects_ == []


# --- one seed -------------------------------------------------------------------------------


@pytest.mark.filterwarnings("ignore::swsysid.IdentificationWarning")
@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
@pytest.mark.parametrize("check", [check_fit_idempotent, check_regressor_data_not_an_array])
def test_an_estimator_without_a_seed_is_seeded(check):
    search = EffectSearchCV(SwitchingSystemRegressor(), effects=[CoulombFriction()])
    check("EffectSearchCV", search)


def test_seeds_of_the_users_own_stay():
    plain = SwitchingSystemRegressor(random_state=3)
    assert seeded(plain, 0).random_state == 3
    pipeline = make_pipeline(FunctionTransformer(), SwitchingSystemRegressor())
    assert seeded(pipeline, 5).steps[-1][1].random_state == 5
    assert pipeline.steps[-1][1].random_state is None


# --- warnings -------------------------------------------------------------------------------


def switched_by_chance(n_rows=400):
    rng = np.random.default_rng(0)
    X = rng.uniform(-1.0, 1.0, (n_rows, 2))
    side = rng.choice([-1.0, 1.0], (n_rows, 1))
    return X, side * X + 0.01 * rng.standard_normal(X.shape)


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
@pytest.mark.parametrize(
    "model",
    [
        SwitchingSystemRegressor(2, random_state=0),
        EffectSearchCV(SwitchingSystemRegressor(2, random_state=0), effects=[QuadraticDrag()]),
        EffectRegressor(SwitchingSystemRegressor(2, random_state=0)),
    ],
    ids=lambda model: type(model).__name__,
)
def test_doubts_of_the_model_inside_are_told(model):
    with pytest.warns(IdentificationWarning, match="not a function of the state") as told:
        model.fit(*switched_by_chance())
    assert {one.filename for one in told} == {__file__}


def test_a_record_at_rest_leaks_no_warning_of_numpy():
    # a discrete record that comes to rest: most rows, and what is left of them, are equal
    X = 0.9 ** np.arange(400)[:, None] * np.array([1.0, -0.5])
    X[np.abs(X) < 1e-9] = 0.0
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        warnings.simplefilter("ignore", UserWarning)
        declared = SwitchingSystemRegressor(1, discrete_time=True, random_state=0)
        search = EffectSearchCV(declared, effects=[QuadraticDrag(), CoulombFriction()])
        search.fit(X[:-1], X[1:], t=np.arange(399.0))
    assert search.effects_ == []


def test_a_guard_that_makes_the_error_rise_is_seen_to():
    """Velocities do not show a guard, and yet they can show that there is none."""
    falls = [Fall(BlockSum(value, 1.0, 12), 0.0, 1.0) for value in (-5.0, -0.5, 5.0)]
    assert [fall.is_rise for fall in falls] == [True, False, False]
