"""What is known of a declared model holds while effects are sought beside it."""

import numpy as np
import pandas as pd
import pytest

from swsysid import EffectSearchCV, SwitchingSystemRegressor, TrajectoryIdentifier
from swsysid.effects import Bias, CoulombFriction


def recorded(force, n_modes=2, n_steps=500):
    """A forced mass on a spring, with one that is softer on one side if there are two modes."""
    rng = np.random.default_rng(0)
    X, Xdot, t, groups = [], [], [], []
    for group in range(4):
        (x, v), phases = rng.uniform(-2, 2, 2), rng.uniform(0, 6, 2)
        for time in 0.02 * np.arange(n_steps):
            u = 2 * np.sin(1.3 * time + phases[0]) + np.sin(0.37 * time + phases[1])
            a = -(1 if x > 0 or n_modes == 1 else 4) * x - 0.1 * v + u + force(v)
            X.append([x, v, u])
            Xdot.append([v, a])
            t.append(time)
            groups.append(group)
            x, v = x + 0.02 * v, v + 0.02 * a
    Xdot = np.array(Xdot) + 0.01 * rng.standard_normal((len(X), 2))
    return pd.DataFrame(X, columns=["x", "v", "u"]), Xdot, np.array(t), np.array(groups)


def test_laws_are_as_known_beside_an_effect():
    X, Xdot, t, groups = recorded(lambda v: -0.5 * np.sign(v))
    known = ["x' = v", "v'[u] = 1", "v'[v] same in all modes", "guard x >= 0"]
    declared = SwitchingSystemRegressor(known=known, random_state=0)
    search = EffectSearchCV(declared, effects=[CoulombFriction(), Bias()], random_state=0)
    search.fit(X, Xdot, t=t, groups=groups)
    [effect] = search.effects_
    assert (effect.kind, effect.target) == ("coulomb_friction", 1)
    assert effect.parameters["friction"] == pytest.approx(0.5, abs=0.005)  # 10 standard errors
    model = search.best_estimator_.estimator_
    np.testing.assert_array_equal(model.coef_[:, 0], [[0.0, 1.0, 0.0]] * 2)
    np.testing.assert_array_equal(model.coef_[:, 1, 2], 1.0)
    assert model.coef_[0, 1, 1] == pytest.approx(model.coef_[1, 1, 1], abs=1e-9)
    assert (model.surface_.coef_[:, [0, 2, 3]] == 0.0).all()
    assert declared.known == known  # as the user gave it


@pytest.mark.parametrize(("known", "kinds"), [(None, []), ("v' has no 1", ["bias"])])
def test_a_term_that_is_known_to_be_missing_leaves_it_to_effects(known, kinds):
    X, Xdot, t, groups = recorded(lambda v: 0.3, n_modes=1, n_steps=300)
    declared = SwitchingSystemRegressor(1, feature_library=1, known=known, random_state=0)
    search = EffectSearchCV(declared, effects=[CoulombFriction(), Bias()], random_state=0)
    search.fit(X, Xdot, t=t, groups=groups)
    assert [one.kind for one in search.effects_] == kinds
    level = search.best_estimator_.estimator_.coef_[0, 1, 0]
    assert level == (0.0 if kinds else pytest.approx(0.3, abs=0.01))


def test_an_identifier_of_recordings_knows_it_too():
    X, _, t, groups = recorded(lambda v: -0.5 * np.sign(v), n_modes=1)
    x, u = X[["x", "v"]], X[["u"]]
    identifier = TrajectoryIdentifier(SwitchingSystemRegressor(1), known=["x' = v", "v'[u] = 1"])
    search = EffectSearchCV(identifier, effects=[CoulombFriction(), Bias()], random_state=0)
    search.fit(x + 0.005, t=t, groups=groups, inputs=u)
    assert [one.kind for one in search.effects_] == ["coulomb_friction"]
    [[position, speed]] = search.best_estimator_.estimator_.coef_
    np.testing.assert_allclose(position, [0.0, 1.0, 0.0], atol=1e-12)
    assert speed[2] == pytest.approx(1.0, abs=1e-12)


def test_names_that_there_are_not_are_refused_with_those_that_there_are():
    X, Xdot, t, groups = recorded(lambda v: 0.0, n_modes=1, n_steps=40)
    search = EffectSearchCV(SwitchingSystemRegressor(1, known="v' has no w"))
    with pytest.raises(ValueError, match="the terms are x, v, u"):
        search.fit(X, Xdot, t=t, groups=groups)


def test_sums_that_rollouts_do_not_hold_are_refused():
    X, _, t, groups = recorded(lambda v: 0.0, n_modes=1)
    identifier = TrajectoryIdentifier(SwitchingSystemRegressor(1), known="v'[v] <= 0")
    with pytest.raises(ValueError, match="leave sums of them and bounds out"):
        EffectSearchCV(identifier, effects=[Bias()]).fit(
            X[["x", "v"]] + 0.005, t=t, groups=groups, inputs=X[["u"]]
        )
