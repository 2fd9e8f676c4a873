"""Laws of a quantity: what a score promises a regression keeps, and what a position's rate does."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import chi2

from swsysid import EffectSearchCV, SwitchingSystemRegressor
from swsysid._data.records import make_records
from swsysid._effect_search.contributions import beside_conventions
from swsysid._effect_search.recorded import RecordedOutcome
from swsysid._output_error.engines import fitted, left_of, scores
from swsysid._output_error.law import Law
from swsysid._output_error.stretches import Stretches
from swsysid.effects import CoulombFriction, InputCoupling, PlacedEffect, QuadraticDrag

STEP, N_RUNS = 0.02, 4


def strokes(seed=0, n_samples=500):
    """Positions of a rod that goes to and fro in four runs, its velocities, times and runs."""
    rng, parts = np.random.default_rng(seed), []
    t = STEP * np.arange(n_samples)
    for _ in range(N_RUNS):
        size, speed, phase = rng.uniform([[0.5], [0.5], [0.0]], [[1.5], [4.0], [6.0]], (3, 3))
        angle = speed * t[:, None] + phase
        parts.append(np.column_stack([np.sin(angle) @ size, np.cos(angle) @ (size * speed), t]))
    x, v, t = np.vstack(parts).T
    return x, v, t, np.repeat(np.arange(N_RUNS), n_samples)


def quantity(noise=0.1):
    """F = 3 x + .4 v - 1.2 sign(v), as rows of a law that has no friction."""
    x, v, t, groups = strokes()
    y = 3.0 * x + 0.4 * v - 1.2 * np.sign(v)
    y += noise * np.random.default_rng(1).standard_normal(len(y))
    records = make_records(np.column_stack([x, v]), 1, t=t, groups=groups, names=["x", "v"])
    stretches = Stretches.of(records, records, np.arange(len(records)), y[:, None])
    declared = np.ones((1, 3), dtype=bool)
    law = Law.of(lambda X: np.column_stack([np.ones(len(X)), X]), declared, np.zeros((1, 3)))
    return law, stretches


def test_a_score_is_the_fall_of_the_squares():
    law, stretches = quantity()
    fit = fitted(law, stretches)
    trials = [PlacedEffect(CoulombFriction(), 1, 0), PlacedEffect(QuadraticDrag(), 1, 0)]
    [score] = scores(fit)
    columns = [one.effect.columns(stretches.seen, 1)[stretches.rows] for one in trials]
    promised = score.gains(trials, [score.response(one) for one in columns])
    for trial, gain in zip(trials, promised, strict=True):
        after = fitted(law.beside([trial]), stretches)
        kept = np.sum(fit.left**2) - np.sum(after.left**2)
        assert gain * fit.noise[0] ** 2 == pytest.approx(kept, rel=1e-9)


def test_coefficients_and_their_errors_are_those_of_least_squares():
    law, stretches = quantity()
    law = law.beside([PlacedEffect(CoulombFriction(), 1, 0)])
    fit = fitted(law, stretches)
    covariance, state, column = fit.covariance(law, stretches)
    # 2000 rows with noise of 0.1: the error of each is some thousandths
    errors = np.sqrt(np.diag(covariance))
    assert (errors < 0.006).all()
    assert np.abs(fit.law.coef[0] - [0.0, 3.0, 0.4, 1.2]).max() < 4.0 * errors.max()
    assert state.tolist() == [0, 0, 0, 0] and column.tolist() == [0, 1, 2, 3]
    np.testing.assert_allclose(left_of(fit, stretches), fit.left)


def test_a_gross_value_counts_nothing():
    law, stretches = quantity(noise=0.0)
    spoilt = stretches.quantity.copy()
    spoilt[700] += 1e3
    other = Stretches.of(stretches.records, stretches.seen, np.arange(len(spoilt)), spoilt)
    law = law.beside([PlacedEffect(CoulombFriction(), 1, 0)])
    np.testing.assert_allclose(fitted(law, other).law.coef[0], [0.0, 3.0, 0.4, 1.2], atol=1e-9)


def searched(x, y, t, groups, library, **more):
    plain = SwitchingSystemRegressor(1, feature_library=1, random_state=0)
    force = pd.Series(y, name="F")
    return EffectSearchCV(plain, effects=library).fit(x, force, t=t, groups=groups, **more)


LIBRARY = [CoulombFriction(), QuadraticDrag(), InputCoupling()]


def test_friction_against_the_rate_of_a_logged_position():
    """F = 2 p + 1.2 sign(x'), where x is a signal and the pressure p a column."""
    x, v, t, groups = strokes()
    rng = np.random.default_rng(2)
    p = 1.0 + 0.1 * np.cumsum(rng.standard_normal(len(t)))
    y = 2.0 * p + 1.2 * np.sign(v) + 0.05 * rng.standard_normal(len(t))
    signals = pd.DataFrame({"x": x + 1e-3 * rng.standard_normal(len(t))})
    search = searched(pd.DataFrame({"p": p}), y, t, groups, LIBRARY, signals=signals)
    [effect] = search.effects_
    assert (effect.kind, effect.place) == ("coulomb_friction", "x'")
    # a few rows at each turn, of which there are 42, have the wrong sign
    assert effect.parameters["friction"] == pytest.approx(-1.2, rel=0.05)
    assert any("sign(x')" in law for law in search.equations())
    again = search.predict(pd.DataFrame({"p": p}), t=t, groups=groups, signals=signals)
    assert np.sqrt(np.mean((again - y) ** 2)) < 0.35  # 1.2 without friction, .05 of noise


def test_viscous_friction_of_a_position_is_no_drag():
    x, v, t, groups = strokes()
    y = 3.0 * x + 0.4 * v + 0.05 * np.random.default_rng(3).standard_normal(len(t))
    [effect] = searched(pd.DataFrame({"x": x}), y, t, groups, LIBRARY).effects_
    assert (effect.kind, effect.place) == ("input_coupling", "x'")
    assert effect.parameters["coefficient"] == pytest.approx(0.4, rel=0.02)


def test_whole_trajectories_are_left_out_where_there_are_several():
    law, stretches = quantity()
    groups = stretches.records.groups
    for train, test in stretches.folds():
        inside, outside = ({groups[stretches.parts[k][0]] for k in one} for one in (train, test))
        assert not inside & outside
    one = make_records(stretches.records.X, 1, t=STEP * np.arange(2000), names=["x", "v"])
    alone = Stretches.of(one, one, np.arange(2000), stretches.quantity)
    assert all(len(train) > len(test) > 0 for train, test in alone.folds())


def test_shares_that_a_constant_may_have_do_not_widen_what_is_told():
    rng = np.random.default_rng(5)
    v = rng.normal(size=400)
    columns = np.column_stack(
        [np.ones(400), v, -1.0 * (v > 0.0), 1.0 * (v < 0.0), rng.normal(size=400)]
    )
    # a little is known of the shares from elsewhere, and of a coefficient of another state
    inside = np.linalg.inv(columns.T @ columns / 0.01 + 1e-6 * np.eye(5))
    wide, own = np.diag([0.0] * 5 + [7.0]), np.arange(5)
    wide[:5, :5] = inside
    assert np.sqrt(wide[2, 2]) > 100.0
    told = beside_conventions(wide, own, columns)
    # no share moves: along (1, 0, 1, -1, 0) nothing does
    assert np.abs(told @ [1.0, 0.0, 1.0, -1.0, 0.0, 0.0]).max() < 1e-6
    # the mean of both frictions, and all else, is as sure as by a law without the constant
    alone = np.linalg.inv(columns[:, 1:].T @ columns[:, 1:] / 0.01)
    mean = np.array([0.0, 0.0, 0.5, 0.5, 0.0, 0.0])
    assert mean @ told @ mean == pytest.approx(mean[1:5] @ alone @ mean[1:5], rel=1e-3)
    assert told[4, 4] == pytest.approx(alone[3, 3], rel=1e-3) and told[5, 5] == 7.0
    assert np.sqrt(told[2, 2]) < 0.05


def test_the_chance_of_no_coefficient_is_that_of_least_squares():
    law, stretches = quantity()
    terms = [PlacedEffect(CoulombFriction(), 1, 0), PlacedEffect(QuadraticDrag(), 1, 0)]
    fit = fitted(law.beside(terms), stretches)
    outcome = RecordedOutcome(None, None, None, None, (), (), ())
    friction, drag = outcome.chance_of_none(fit, stretches)
    columns = fit.law.columns(stretches.seen)[stretches.rows]
    # the noise is white, so that every sample counts: Wald's test by hand
    errors = fit.noise[0] * np.sqrt(np.diag(np.linalg.inv(columns.T @ columns)))
    by_hand = chi2.sf((fit.law.coef[0] / errors) ** 2, 1)[-2:]
    assert friction < 1e-16
    # the memory of what is left is told by samples, and is 1 to some hundredths
    assert drag == pytest.approx(by_hand[1], abs=0.05)
