"""Laws of a force, a torque or a current: `y` is no rate, and no column of X is a state."""

import numpy as np
import pandas as pd
import pytest
from pysindy import PolynomialLibrary

from swsysid import (
    EffectRegressor,
    EffectSearchCV,
    SwitchingSystemRegressor,
    load_model,
    save_model,
)
from swsysid._data.records import make_records
from swsysid.datasets import make_undeclared
from swsysid.effects import Backlash, CoulombFriction, Delay, Lag, StribeckFriction, Trigonometric
from swsysid.effects._kinematics import is_static
from swsysid.plotting import EffectReportDisplay, ResidualReportDisplay

LIBRARY = [
    Backlash(),
    CoulombFriction(),
    Delay(),
    Lag(),
    StribeckFriction(),
    Trigonometric(),
]


def straight():
    library = PolynomialLibrary(degree=1)
    return SwitchingSystemRegressor(1, feature_library=library, random_state=0)


def strokes(seed=1, n_runs=4, duration=10.0, step=0.02):
    """Positions and velocities of a rod that is driven to and fro, times and runs."""
    rng, parts = np.random.default_rng(seed), []
    for _ in range(n_runs):
        t = np.arange(0.0, duration, step)
        size, speed, phase = rng.uniform([[0.5], [0.5], [0.0]], [[1.5], [4.0], [6.0]], (3, 3))
        angle = speed * t[:, None] + phase
        x, v = np.sin(angle) @ size, np.cos(angle) @ (size * speed)
        parts.append(np.column_stack([x, v, t]))
    x, v, t = np.vstack(parts).T
    return pd.DataFrame({"x": x, "v": v}), t, np.repeat(np.arange(n_runs), len(t) // n_runs)


def force(motion, t, groups, law, noise=0.1):
    record = make_records(motion.to_numpy(), 1, t=t, groups=groups, names=["x", "v"])
    extra = {
        "backlash": lambda: 8.0 * Backlash().columns(record, 0, 0.5)[:, 0] - 3.0 * motion.x,
        "coulomb_friction": lambda: 1.2 * np.sign(motion.v),
    }
    values = 3.0 * motion.x + 0.4 * motion.v + extra[law]()
    return pd.Series(values + noise * np.random.default_rng(0).standard_normal(len(t)), name="F")


def searched(motion, y, t, groups, columns, **more):
    search = EffectSearchCV(straight(), effects=LIBRARY)
    return search.fit(motion[list(columns)], y, t=t, groups=groups, **more)


@pytest.mark.parametrize(
    ("law", "place", "parameters"),
    [
        ("backlash", "x", {"width": 0.5, "gain": 8.0}),
        ("coulomb_friction", "v", {"friction": -1.2}),
    ],
)
def test_a_force_has_the_same_effects_whatever_the_order_of_the_columns(law, place, parameters):
    motion, t, groups = strokes()
    y = force(motion, t, groups, law)
    one, other = (searched(motion, y, t, groups, columns) for columns in ("xv", "vx"))
    for search in (one, other):
        (effect,) = search.effects_
        assert (effect.kind, effect.place) == (law, place)
        # Noise of 0.1 on 2000 rows tells a gain to hundredths.
        assert effect.parameters == pytest.approx(parameters, rel=0.02)
    assert one.effects_[0].parameters == pytest.approx(other.effects_[0].parameters, rel=1e-6)
    assert one.effects_[0].error_after == pytest.approx(other.effects_[0].error_after, rel=1e-6)


def test_a_force_is_called_by_its_name_and_not_rolled_out():
    motion, t, groups = strokes()
    search = searched(motion, force(motion, t, groups, "backlash"), t, groups, "xv")
    report, text = search.report_, str(search.report_)
    assert report.targets == ("F",)
    assert "'" not in text and "next" not in text
    assert "Rollout" not in text and "the law gives no rate" in text
    assert report.rollouts == []
    page = report.to_html()
    assert "F&#x27;" not in page and "d/dt" not in page
    for model in (search.best_estimator_, search.declared_estimator_):
        assert all(law.startswith("mode 0: F = ") for law in model.equations())
        assert model.equations(format="latex")[0].startswith(r"\text{mode } 0: \; F = ")
    assert any("play(x" in law for law in search.equations())


def test_pictures_of_a_force_have_no_rates_on_their_axes():
    motion, t, groups = strokes()
    report = searched(motion, force(motion, t, groups, "coulomb_friction"), t, groups, "xv").report_
    shown = EffectReportDisplay.from_report(report, units={"F": "N"})
    left = ResidualReportDisplay.from_report(report.residual_before, units={"F": "N"})
    labels = [ax.get_ylabel() for one in (shown, left) for ax in one.figure_.axes]
    assert any("F (N)" in label for label in labels)
    assert not any("d/dt" in label for label in labels)


def test_friction_of_a_logged_velocity_is_found_in_a_force():
    motion, t, groups = strokes()
    y = force(motion, t, groups, "coulomb_friction")
    search = searched(motion, y - 0.4 * motion.v, t, groups, "x", signals=motion[["v"]])
    assert [(one.kind, one.place) for one in search.effects_] == [("coulomb_friction", "v")]


def test_a_regressor_of_a_force_calls_it_by_its_name():
    motion, t, groups = strokes()
    y = force(motion, t, groups, "coulomb_friction")
    model = EffectRegressor(straight()).fit(motion, y, t=t, groups=groups)
    assert model.equations()[0].startswith("mode 0: F = ")
    unnamed = EffectRegressor(straight()).fit(motion, y.to_numpy(), t=t, groups=groups)
    assert unnamed.equations()[0].startswith("mode 0: y0 = ")
    exchangeable = EffectRegressor(straight()).fit(motion, y)  # nothing tells without times
    assert exchangeable.equations()[0].startswith("mode 0: x' = ")


def static(X, y, t, groups):
    names = [f"x{column}" for column in range(X.shape[1])]
    return is_static(make_records(X, 1, t=t, groups=groups, names=names), y[:, None])


@pytest.mark.parametrize("system", ["oscillator", "quartic", "two_mass", "pendulum", "tanks"])
def test_a_rate_with_noise_is_no_quantity_of_its_own(system):
    for noise in (0.05, 1.0):
        data = make_undeclared(None, system=system, n_samples=800, noise=noise, random_state=0)
        for state, rate in enumerate(data.Xdot.T):
            own_first = np.roll(data.X[:, : data.Xdot.shape[1]], -state, axis=1)
            # a rate that is all noise is told by the state alone: perhaps it is a column of X
            columns = own_first if noise < 1.0 else own_first[:, :1]
            assert not static(columns, rate, data.t, data.groups)


def test_a_rate_with_gross_errors_in_another_unit_or_with_jumps_is_no_quantity_of_its_own():
    motion, t, groups = strokes()
    x, rate, rng = motion[["x"]].to_numpy(), motion.v.to_numpy(), np.random.default_rng(0)
    assert not static(x, 60.0 * rate, t, groups)
    gross = rate + np.where(rng.random(len(t)) < 0.02, 1e3 * rng.standard_normal(len(t)), 0.0)
    assert not static(x, gross, t, groups)
    noisy = x + 0.3 * rng.standard_normal(x.shape)
    assert not static(noisy, rate, t, groups)
    level = np.mod(t + rng.uniform(0.0, 1.0, 4)[groups], 1.0)  # which rises by one and falls back
    assert not static(level[:, None], np.ones(len(t)), t, groups)


def test_a_force_is_no_rate_and_one_that_accelerates_a_mass_is_one():
    motion, t, groups = strokes()
    for law in ("backlash", "coulomb_friction"):
        y = force(motion, t, groups, law).to_numpy()
        for columns in (["x", "v"], ["v", "x"]):
            assert static(motion[columns].to_numpy(), y, t, groups)
    acceleration = np.concatenate(
        [np.gradient(motion.v[groups == run], t[groups == run]) for run in range(4)]
    )
    assert not static(motion[["v", "x"]].to_numpy(), 3.0 * acceleration, t, groups)


def test_a_model_of_a_force_is_the_same_in_a_file(tmp_path):
    motion, t, groups = strokes()
    model = EffectRegressor(straight()).fit(
        motion, force(motion, t, groups, "backlash"), t=t, groups=groups
    )
    save_model(model, tmp_path / "model.json")
    assert load_model(tmp_path / "model.json").equations() == model.equations()
