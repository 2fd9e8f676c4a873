"""Numbers of laws and effects from rollouts: written as a stated model, refined, and back."""

import numpy as np
import pytest
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from swsysid import EffectRegressor, SwitchingSystemRegressor
from swsysid.effects import (
    CoulombFriction,
    Drift,
    InputCoupling,
    Lag,
    PlacedEffect,
    QuadraticDrag,
    Saturation,
    SensorOffset,
)
from swsysid.refinement import initial_states, refine

T = np.linspace(0.0, 8.0, 161)
FORCE = 2.0 * np.sin(1.3 * T)[:, None] + np.cos(3.1 * T)[:, None]


def rows(n_rows=400, seed=0):
    """States x, v and an input u, drawn evenly."""
    return np.random.default_rng(seed).uniform(-3.0, 3.0, (n_rows, 3))


def mass(X, drag=0.3, threshold=np.inf, stiffness=4.0):
    """x' = v, v' = -stiffness x - 0.5 v - drag v |v| + clip(u)."""
    x, v, u = X.T
    pull = -stiffness * x - 0.5 * v - drag * v * np.abs(v) + np.clip(u, -threshold, threshold)
    return np.column_stack([v, pull])


def fitted(terms, X=None, Xdot=None, **numbers):
    X = rows() if X is None else X
    declared = SwitchingSystemRegressor(1, feature_library=None, loss="squared", random_state=0)
    return EffectRegressor(declared, terms).fit(X, mass(X, **numbers) if Xdot is None else Xdot)


def recording(model, start=(1.0, 0.0)):
    return {"t": T, "x": model.simulate(start, T, FORCE, input_hold="linear").x, "inputs": FORCE}


DRAG = PlacedEffect(QuadraticDrag(), 1, 1)


def limited(threshold):
    return PlacedEffect(Saturation(), 2, 1, replaced=2, theta=(threshold,))


def test_the_stated_model_predicts_as_the_model_with_effects():
    model = fitted([DRAG, limited(1.0)], threshold=1.0)
    X = rows(50, seed=1)
    stated = model.stated()
    np.testing.assert_allclose(stated.predict(X), model.predict(X), atol=1e-12)
    back = model.with_numbers_of(stated)
    np.testing.assert_allclose(back.predict(X), model.predict(X), atol=1e-12)
    assert back.effects_ == model.effects_


def test_rollouts_refine_laws_and_effects():
    plant = fitted([DRAG])
    start = fitted([DRAG], drag=0.2, stiffness=3.7)
    result = refine(start, recording(plant), input_hold="linear")
    assert result.improved
    assert "x1', quadratic drag of x1: drag" in result.names
    better = result.model
    assert isinstance(better, EffectRegressor)
    np.testing.assert_allclose(better.effect_coef_[0], [0.3], atol=1e-3)
    np.testing.assert_allclose(better.estimator_.coef_, plant.estimator_.coef_, atol=1e-2)
    # and its rollout, of another integrator, is that of the plant
    measured = recording(plant)["x"]
    before, after = (np.abs(recording(one)["x"] - measured).max() for one in (start, better))
    assert before > 0.05
    assert after < 1e-3
    assert "- 0.30 x1 |x1|" in better.equations(precision=2)[1]
    # the model that was given has kept its numbers
    np.testing.assert_allclose(start.effect_coef_[0], [0.2], atol=1e-6)


def test_rollouts_refine_what_is_nonlinear():
    plant = fitted([limited(1.2)], drag=0.0, threshold=1.2)
    start = fitted([limited(1.5)], drag=0.0, threshold=1.5)
    better = refine(start, recording(plant), input_hold="linear").model
    assert better.effects_[0].theta[0] == pytest.approx(1.2, abs=0.01)


def test_an_effect_of_one_mode_stays_there():
    X = rows(800)
    friction = 0.5 * np.sign(X[:, 1]) * (X[:, 0] > 0.0)
    Xdot = np.column_stack([X[:, 1], -4.0 * X[:, 0] - 0.5 * X[:, 1] + X[:, 2]])
    Xdot[:, 1] -= np.where(X[:, 0] > 0.0, 3.0 * X[:, 0], 0.0) + friction
    declared = SwitchingSystemRegressor(2, feature_library=None, random_state=0)
    modes = (X[:, 0] > 0.0).astype(int)
    term = PlacedEffect(CoulombFriction(), 1, 1, mode=1)
    model = EffectRegressor(declared, [term]).fit(X, Xdot, modes=modes)
    stated = model.stated()
    np.testing.assert_allclose(stated.predict(X[:40]), model.predict(X[:40]), atol=1e-10)
    mode = model.effects_[0].mode
    assert stated.switching_model.feature_map.names_out[-1] == (
        f"mode {mode}: x1', coulomb friction of x1"
    )
    assert stated.coef_[:, 1, -1].tolist() == [float(one == mode) for one in range(2)]


def test_states_at_the_start_of_a_rollout_with_effects():
    plant = fitted([DRAG])
    found = initial_states(plant, recording(plant, (0.7, -0.4)), input_hold="linear")
    np.testing.assert_allclose(found, [[0.7, -0.4]], atol=1e-3)


@pytest.mark.parametrize(
    ("term", "given"),
    [
        (PlacedEffect(Lag(), 2, 1, replaced=2, theta=(0.2,)), {}),
        (PlacedEffect(Drift(), "level", 1), {}),
        (PlacedEffect(SensorOffset(), 0, 0, theta=(0.1,)), {}),
        (PlacedEffect(InputCoupling(), 3, 1), {"signals": np.ones((400, 1))}),
    ],
)
def test_what_is_no_function_of_the_present_row_is_refused(term, given):
    X = rows()
    declared = SwitchingSystemRegressor(1, feature_library=None, loss="squared", random_state=0)
    t = 0.05 * np.arange(len(X))
    model = EffectRegressor(declared, [term]).fit(X, mass(X), t=t, **given)
    with pytest.raises(ValueError, match=f"{term.effect.kind} of .* fit an EffectRegressor"):
        refine(model, {"t": T, "x": np.ones((len(T), 2)), "inputs": FORCE})


def test_a_pipeline_is_refused():
    X = rows()
    regressor = SwitchingSystemRegressor(1, feature_library=None, random_state=0)
    model = EffectRegressor(make_pipeline(StandardScaler(), regressor), [DRAG]).fit(X, mass(X))
    with pytest.raises(TypeError, match="last step of a pipeline"):
        refine(model, {"t": T, "x": np.ones((len(T), 2)), "inputs": FORCE})


@pytest.mark.nightly
def test_what_makes_held_out_rollouts_worse_is_refused():
    """Numbers that take up what the laws lack in one record mean something else in another."""
    plant, start = fitted([DRAG], drag=0.3), fitted([DRAG], drag=0.25)
    train, other = recording(plant), recording(plant, (-2.0, 1.0))
    kept = refine(start, train, input_hold="linear", held_out=other)
    assert kept.improved
    assert np.all(kept.held_out_after < 0.1 * kept.held_out_before)
    assert "held-out trajectory 0" in kept.summary()
    pushed = train | {"x": train["x"] + 0.3 * np.sin(0.4 * T)[:, None]}
    refused = refine(start, pushed, input_hold="linear", held_out=other)
    assert not refused.improved
    assert refused.advice.startswith("Refused: the rollouts of what was held out become worse")
    assert np.all(refused.held_out_after.mean() > refused.held_out_before.mean())
    np.testing.assert_allclose(refused.model.effect_coef_[0], start.effect_coef_[0], rtol=1e-12)
    np.testing.assert_allclose(refused.values, [dict_of(start)[one] for one in refused.names])


def dict_of(model):
    """Free numbers of a model by their names."""
    result = refine(model, recording(model), input_hold="linear", max_nfev=1)
    return dict(zip(result.names, result.values, strict=True))
