"""What no effect has a name for: shapes and disturbances as answers of the search."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline, RBFInterpolator
from scipy.signal import lfilter
from scipy.stats import multivariate_normal

from swsysid import EffectSearchCV, SwitchingSystemRegressor, load_model, save_model
from swsysid._data.records import make_records
from swsysid._effect_search import search as search_module
from swsysid._effect_search.chance import BlockSum
from swsysid._effect_search.coloured_noise import Coloured, Stretches, coloured, white
from swsysid._effect_search.findings import Ladder
from swsysid._noise import robust_regression
from swsysid._results import GuardWarning
from swsysid.datasets import make_undeclared
from swsysid.effects import (
    Bias,
    CoulombFriction,
    Drift,
    ExtraMode,
    GainChange,
    Polynomial,
    QuadraticDrag,
    UnknownFunction,
    UnmeasuredDisturbance,
)
from swsysid.effects._shapes import shapes

LIBRARY = [
    Bias(),
    CoulombFriction(),
    QuadraticDrag(),
    Drift(),
    Polynomial(),
    UnknownFunction(),
    UnmeasuredDisturbance(),
]
N_RUNS, N_TIMES, STEP, NOISE = 8, 120, 0.05, 0.05


def _record(law, seed=0):
    """Runs of x' = -x + 2 u + law(x, t) with noise on the velocities."""
    rng = np.random.default_rng(seed)
    t = STEP * (np.arange(N_TIMES) + 200 * np.arange(N_RUNS)[:, None])
    phases = rng.uniform(0.0, 2.0 * np.pi, (2, N_RUNS, 1))
    u = np.sin(2.1 * t + phases[0]) + np.sin(0.7 * t + phases[1])
    x, velocity = np.empty(t.shape), np.empty(t.shape)
    now = rng.uniform(-2.0, 2.0, N_RUNS)
    for step in range(N_TIMES):
        x[:, step] = now
        velocity[:, step] = -now + 2.0 * u[:, step] + law(now, t[:, step])
        now = now + STEP * velocity[:, step]
    X = np.column_stack([x.ravel(), u.ravel()])
    clean = velocity.ravel()[:, None]
    known = {"t": t.ravel(), "groups": np.repeat(np.arange(N_RUNS), N_TIMES)}
    return X, clean + NOISE * rng.standard_normal(clean.shape), known


def _search(law, seed=0):
    X, Xdot, known = _record(law, seed)
    return EffectSearchCV(SwitchingSystemRegressor(1), effects=LIBRARY).fit(X, Xdot, **known)


def _force(seed):
    """A force of size 0.4 that is forgotten after one second, at any times of the record."""
    rng = np.random.default_rng(seed)
    grid = np.arange(0.0, STEP * 200 * N_RUNS, STEP)
    values, kept = np.empty(len(grid)), np.exp(-STEP)
    values[0] = 0.4 * rng.standard_normal()
    for place in range(1, len(grid)):
        shock = 0.4 * np.sqrt(1.0 - kept**2) * rng.standard_normal()
        values[place] = kept * values[place - 1] + shock
    return lambda x, t: np.interp(t, grid, values)


@pytest.fixture(scope="module")
def rational():
    return _search(lambda x, t: x**2 / (1.0 + x**2))


# -- shapes ----------------------------------------------------------------------------------------


def test_of_one_channel_the_shape_is_the_natural_cubic_spline():
    knots = np.array([-2.0, -0.5, 0.0, 1.0, 3.0])
    shape = UnknownFunction((0,), tuple((knot,) for knot in knots))
    np.testing.assert_allclose(shape.basis(knots[:, None]), np.eye(5), atol=1e-10)
    x = np.linspace(-2.0, 3.0, 40)
    spline = CubicSpline(knots, np.eye(5), bc_type="natural")(x)
    np.testing.assert_allclose(shape.basis(x[:, None]), spline, atol=1e-9)
    beyond = shape.basis(np.array([[4.0], [5.0], [6.0]]))
    np.testing.assert_allclose(np.diff(beyond, 2, axis=0), 0.0, atol=1e-8)  # a straight line


def test_of_two_channels_a_plane_is_a_plane():
    rng = np.random.default_rng(0)
    knots = rng.uniform(-1.0, 1.0, (9, 2))
    shape = UnknownFunction((0, 1), tuple(map(tuple, knots.tolist())))
    points = rng.uniform(-2.0, 2.0, (20, 2))
    plane = shape.basis(points) @ (1.0 + 2.0 * knots[:, 0] - knots[:, 1])
    np.testing.assert_allclose(plane, 1.0 + 2.0 * points[:, 0] - points[:, 1], atol=1e-9)


def test_a_function_of_a_product_has_knots_where_the_product_is_large():
    rng = np.random.default_rng(2)
    X = rng.standard_normal((3000, 2))
    records = make_records(X, 2, names=("x0", "x1"))
    products = [shape for shape in shapes(records) if shape.of_product]
    finest = np.sort(np.ravel(max(products, key=lambda one: len(one.knots)).knots))
    values = np.prod(X, axis=1)
    # by ranks alone the last two are 1.5 apart; half of all products are smaller than 0.37
    assert np.diff(finest).max() < 0.5 and np.sum(np.abs(finest) < np.median(np.abs(values))) >= 6
    np.testing.assert_allclose(finest[[0, -1]], np.quantile(values, [0.01, 0.99]), atol=0.1)


def test_a_knot_that_no_row_is_near_goes_on_as_the_others_and_these_are_as_they_were():
    x = np.linspace(-1.0, 1.0, 201)
    near = [(knot,) for knot in np.linspace(-1.0, 1.0, 6)]
    shape = UnknownFunction((0,), (*near, (4.0,)))
    columns, prior = shape.basis(x[:, None]), shape.prior
    noise = 0.2 * np.random.default_rng(0).standard_normal(201)
    target = np.tanh(3.0 * x) + noise
    coef = robust_regression(columns, target, False, prior)
    # by hand: (C' C + P' P) c = C' y
    by_hand = np.linalg.solve(columns.T @ columns + prior.T @ prior, columns.T @ target)
    np.testing.assert_allclose(coef, by_hand, rtol=1e-6)
    free = np.linalg.lstsq(columns, target, rcond=None)[0]
    # a slope at the end that is known to a few tenths, three away from the last row
    assert abs(coef[-1] - 1.0) < 1.0 and abs(free[-1] - 1.0) > 10.0
    # 201 rows for 6 knots: a standard error of 0.035
    np.testing.assert_allclose(columns @ coef, np.tanh(3.0 * x), atol=0.1)


def test_the_prior_of_a_shape_is_what_interpolation_of_the_other_knots_misses():
    knots = np.array([0.0, 0.2, 0.3, 0.9, 1.4, 2.0])[:, None]
    prior = UnknownFunction((0,), tuple(map(tuple, knots.tolist()))).prior
    values = np.random.default_rng(0).standard_normal(6)
    for place in range(6):  # an independent solver, one knot left out at a time
        others = np.arange(6) != place
        inner = RBFInterpolator(knots[others] / 2.0, values[others], kernel="cubic", degree=1)
        missed = values[place] - inner(knots[[place]] / 2.0)[0]
        np.testing.assert_allclose(prior[place] @ values, np.sqrt(0.1) * missed, rtol=1e-8)
    np.testing.assert_allclose(prior[:6] @ (2.0 - 3.0 * knots[:, 0]), 0.0, atol=1e-12)
    plane = UnknownFunction((0, 1), ((0.0, 0.0), (1.0, 0.2), (0.3, 1.0), (0.8, 0.9)))
    np.testing.assert_allclose(plane.prior, np.sqrt(0.1) * np.eye(4))


def test_a_sine_of_a_product_needs_many_knots_and_is_found():
    rng = np.random.default_rng(3)
    X = rng.uniform(-2.0, 2.0, (1500, 2))
    law = np.column_stack([-X[:, 0] + X[:, 1], 0.5 * X[:, 0] - X[:, 1]])
    law[:, 0] += np.sin(2.0 * (X[:, 0] + 1.0) * (X[:, 1] - 1.0))  # no function of the product
    Xdot = law + NOISE * rng.standard_normal(law.shape)
    groups = np.repeat(np.arange(10), 150)
    search = EffectSearchCV(SwitchingSystemRegressor(1), effects=LIBRARY)
    (found,) = search.fit(X, Xdot, groups=groups).effects_
    assert (found.kind, found.place, found.target) == ("unknown_function", "x0, x1", 0)
    fresh = rng.uniform(-1.8, 1.8, (500, 2))
    truth = -fresh[:, 0] + fresh[:, 1]
    truth += np.sin(2.0 * (fresh[:, 0] + 1.0) * (fresh[:, 1] - 1.0))
    wrong = search.predict(fresh)[:, 0] - truth
    assert np.sqrt(np.mean(wrong**2)) < 0.15  # a sine has 0.7; its fastest waves are 0.5 long


def test_a_shape_without_a_name_is_called_unknown(rational):
    (found,) = rational.effects_
    assert (found.kind, found.place, found.target) == ("unknown_function", "x0", 0)
    assert found.p_value < 1e-6 and found.rivals
    # each effect with a name misses by more than the error of the shape
    assert all(rival.error > 1.05 * found.error_after for rival in found.rivals)
    assert "near effect with a name" in str(rational.report_)
    assert "f(x0)" in rational.equations()[0]


def test_the_error_of_a_shape_is_that_of_the_truth(rational):
    X, _, known = _record(lambda x, t: x**2 / (1.0 + x**2), seed=1)
    x = X[:, 0]
    inside = np.abs(x) < np.quantile(np.abs(x), 0.98)  # no record shows more
    truth = -x + 2.0 * X[:, 1] + x**2 / (1.0 + x**2)
    wrong = (rational.predict(X, **known)[:, 0] - truth)[inside]
    assert np.sqrt(1.0 + np.mean(wrong**2) / NOISE**2) < 1.15


def test_the_curve_is_a_table_with_a_band(rational):
    (found,) = rational.effects_
    table = found.table
    assert list(table) == ["x0", "contribution", "half_width"]
    x, curve = table["x0"], table["contribution"]
    truth = x**2 / (1.0 + x**2)
    # up to a straight line, which the law itself has
    basis = np.column_stack([x])
    seen = np.abs(x) < 2.0
    apart = (curve - truth)[seen]
    apart -= basis[seen] @ np.linalg.lstsq(basis[seen], apart, rcond=None)[0]
    assert np.abs(apart).max() < 0.05  # of a curve of size 0.7
    assert 0.0 < np.median(table["half_width"]) < 0.1


def test_the_formula_that_was_planted_ties_with_the_shape(rational):
    best, *others = rational.effects_[0].formulas
    assert best.ties and best.text.startswith("x0^2 / (x0^2 + ")
    assert best.parameters["width"] == pytest.approx(1.0, rel=0.05)  # noise of 5 %, 700 rows
    assert best.error == pytest.approx(1.0, abs=0.02)
    assert not all(other.ties for other in others)
    assert f"formula: {best.text}, predicts as well" in str(rational.report_)


def test_a_model_with_a_shape_simulates_and_is_saved(rational, tmp_path):
    t = np.linspace(0.0, 3.0, 301)
    u = np.sin(t)[:, None]
    done = rational.simulate([1.0], t, u, input_hold="linear")
    x = 1.0
    for value in u[:-1, 0]:
        x += 0.01 * (-x + 2.0 * value + x**2 / (1.0 + x**2))
    assert abs(done.x[-1, 0] - x) < 0.05  # errors of Euler's steps and of the curve
    save_model(rational.best_estimator_, tmp_path / "model.json")
    again = load_model(tmp_path / "model.json")
    X, _, known = _record(lambda x, t: 0.0 * x, seed=2)
    np.testing.assert_allclose(again.predict(X, **known), rational.predict(X, **known), rtol=1e-12)


@pytest.mark.parametrize(
    ("law", "kind"),
    [
        (lambda x, t: -0.5 * np.sign(x), "coulomb_friction"),
        (lambda x, t: -0.3 * x**3, "polynomial"),
        (lambda x, t: 0.01 * t, "drift"),
    ],
    ids=["friction", "cubic", "drift"],
)
def test_what_has_a_name_keeps_it(law, kind):
    assert [found.kind for found in _search(law).effects_] == [kind]


# -- disturbances ----------------------------------------------------------------------------------


def test_the_likelihood_and_the_smoother_are_those_of_the_dense_matrices():
    rng = np.random.default_rng(0)
    t, stretch = np.sort(rng.uniform(0.0, 3.0, 12)), np.repeat([0, 1], 6)
    y, model, where = rng.standard_normal(12), Coloured(1.3, 0.7, 0.4), Stretches(t, stretch)
    together = stretch[:, None] == stretch
    force = np.where(together, 1.3**2 * np.exp(-np.abs(t[:, None] - t) / 0.7), 0.0)
    total = force + 0.4**2 * np.eye(12)
    # of the first samples alone, however many: each has what those before it do not say of it
    firsts = range(1, 13)
    dense = [multivariate_normal(np.zeros(n), total[:n, :n]).logpdf(y[:n]) for n in firsts]
    np.testing.assert_allclose(np.cumsum(model.log_likelihood(y, where)), dense, rtol=1e-10)
    np.testing.assert_allclose(
        model.totals(y, where), [part.sum() for part in model.parts(y, where)], rtol=1e-10
    )
    mean, deviation = model.course(y, where)
    np.testing.assert_allclose(mean, force @ np.linalg.solve(total, y), atol=1e-12)
    variance = np.diag(force - force @ np.linalg.solve(total, force))
    np.testing.assert_allclose(deviation**2, variance, atol=1e-12)


def test_the_gain_on_a_slow_force_that_follows_a_constant_does_not_scatter_by_the_constant():
    # parts of the quadratic form that are no innovations scatter by the constant over the noise
    rng = np.random.default_rng(0)
    where = Stretches(np.tile(0.05 * np.arange(250.0), 6), np.repeat(np.arange(6), 250))
    y, force = -0.85 + 0.07 * rng.standard_normal(1500), Coloured(0.29, 75.0, 0.07)
    gains = white(y + 0.85).log_likelihood(y + 0.85, where) - force.log_likelihood(y, where)
    gain = BlockSum.of(np.bincount(where.stretch * 5 + np.tile(np.arange(250) // 50, 6), gains))
    assert gain.value > 4.0 * gain.error  # 6.6; 2.0 with the other parts of the same sum


def test_white_noise_has_no_force_beneath_it():
    y = np.random.default_rng(0).standard_normal(800)
    where = Stretches(np.arange(800.0), np.arange(800) // 100)
    gain = coloured(y, where).log_likelihood(y, where) - white(y).log_likelihood(y, where)
    assert gain.sum() < 4.0  # of two parameters, one in fifty by chance


def test_noise_with_a_short_memory_is_not_surely_slow():
    # autoregressive noise of 0.5 is forgotten within 1.44 samples
    where = Stretches(np.tile(np.arange(75.0), 4), np.repeat(np.arange(4), 75))
    leads = []
    for seed in range(40):
        steps = np.sqrt(0.75) * np.random.default_rng(seed).standard_normal((75, 4))
        y = lfilter([1.0], [1.0, -0.5], steps, axis=0).T.ravel()
        free, fast = coloured(y, where), coloured(y, where, 4.0)
        assert fast.time_constant <= 4.0
        sums = [one.log_likelihood(y, where).sum() for one in (free, fast)]
        leads.append(sums[0] - sums[1])
    assert np.min(leads) > -1e-3  # what is free is as likely, to the tolerance of the optimiser
    assert np.sum(np.array(leads) > 2.7) <= 2  # of 40, chi-square at 0.02: at most one expected


@pytest.mark.parametrize("seed", [0, 1])
def test_a_force_that_nobody_measured_is_a_disturbance(seed):
    law = _force(seed)
    search = _search(law)
    (found,) = search.effects_
    assert (found.kind, found.target) == ("unmeasured_disturbance", 0)
    assert found.parameters["size"] == pytest.approx(0.4, rel=0.35)  # of some fifty seconds
    assert found.parameters["time_constant"] == pytest.approx(1.0, rel=0.5)
    assert found.error_after == found.error_before  # and the page says so
    expected = "held-out error of any velocity, since it follows nothing that was measured"
    assert expected in search.report_.summary
    truth = law(None, found.table["t"])
    apart = np.abs(found.table["contribution"] - truth)
    assert np.sqrt(np.mean(apart**2)) < 0.2  # half of its size: the law took up some of it


def test_a_force_far_above_the_noise_that_acts_at_times_is_no_outlier():
    # a third of the rows has errors of twenty standard deviations, in stretches of some forty
    (found,) = _search(lambda x, t: 1.0 * ((t / 2.3) % 3.0 < 1.0)).effects_
    assert (found.kind, found.target) == ("unmeasured_disturbance", 0)


@pytest.mark.parametrize("friction", [0.5, 0.8])
def test_friction_is_told_from_the_force_that_hides_it(friction):
    # fifty seconds of a force of one second leave a regression in doubt, its neighbours do not
    force = _force(0)
    search = _search(lambda x, t: force(x, t) - friction * np.sign(x))
    found, hiding = search.effects_
    assert (found.kind, hiding.kind) == ("coulomb_friction", "unmeasured_disturbance")
    assert found.parameters["friction"] == pytest.approx(friction, abs=0.15)
    assert hiding.parameters["size"] == pytest.approx(0.4, rel=0.35)
    assert found.doubts == ()


@pytest.mark.nightly
def test_what_a_few_stretches_tell_is_not_told_where_a_force_comes_and_goes():
    data = make_undeclared(
        unlisted="intermittent_disturbance", system="oscillator", random_state=240
    )
    search = EffectSearchCV(data.estimator, effects=[ExtraMode(), UnmeasuredDisturbance()])
    with pytest.warns(GuardWarning):  # what comes and goes is no function of the state
        report = search.fit(data.X, data.Xdot, t=data.t, groups=data.groups).report_
    assert [found.kind for found in report.effects] == ["unmeasured_disturbance"]
    dropped = replace(report, dropped=("extra mode in x0'",))
    assert "chance or a force that nobody measured explains it as well" in str(dropped)


def test_a_force_stays_where_rollouts_refuse_an_effect_beside_it(monkeypatch):
    seen = []
    searched = search_module.search_beside
    monkeypatch.setattr(
        search_module, "search_beside", lambda *given: seen.append(searched(*given)) or seen[-1]
    )
    force = _force(0)
    search = _search(lambda x, t: force(x, t) - 1.5 * np.sign(x))
    assert [found.kind for found in search.effects_] == [
        "coulomb_friction",
        "unmeasured_disturbance",
    ]
    (outcome,) = seen
    kinds = [term.effect.kind for term in outcome.structure.terms]
    place = kinds.index("coulomb_friction")
    fewer = outcome.without(place, np.ones(1), np.ones(1), (0.1, 0.2))
    (left,) = fewer.findings
    assert left.candidate.effect.kind == "unmeasured_disturbance"
    assert fewer.structure.terms == (left.candidate,)
    # told anew: what the friction explains is a part of what nobody knows without it
    assert left.candidate.theta[0] > outcome.structure.terms[1 - place].theta[0]
    assert [one.candidate.effect.kind for one in fewer.tried] == ["coulomb_friction"]
    # no effect is left that a simulation could have
    X, Xdot, known = _record(lambda x, t: force(x, t) - 1.5 * np.sign(x))
    records = make_records(X, 1, names=["x", "u"], signals=None, **known)
    for one, simulated in [(outcome, 1), (fewer, 0)]:
        ladder = Ladder(one.context, one.structure, one.findings, records, Xdot, one.split)
        assert ladder.n_simulated == simulated
        if simulated:
            assert ladder.least == place


def test_residuals_in_a_row_are_counted_in_their_stretch():
    where = Stretches(np.arange(8.0), np.array([0, 0, 0, 0, 1, 1, 1, 1]))
    chosen = np.array([0, 1, 1, 1, 1, 0, 0, 1], dtype=bool)
    np.testing.assert_array_equal(where.runs(chosen), [1, 3, 3, 3, 1, 2, 2, 1])


def test_a_clean_record_has_neither():
    assert not _search(lambda x, t: 0.0 * x, seed=3).effects_


@pytest.mark.parametrize("seed", [1, 3])
def test_where_rows_are_few_a_shape_is_a_rival_of_what_is_not_clearly_better(seed):
    rng = np.random.default_rng(seed)
    X = rng.uniform(-1.2, 1.2, (300, 2))
    law = np.column_stack([X[:, 1], -X[:, 0] - X[:, 1] + 0.3 * np.tanh(3.0 * X[:, 1])])
    Xdot = law + 0.03 * rng.standard_normal(law.shape)
    library = [GainChange(), CoulombFriction(), Polynomial(), UnknownFunction()]
    search = EffectSearchCV(SwitchingSystemRegressor(1), effects=library)
    (found,) = search.fit(X, Xdot, groups=np.repeat(np.arange(10), 30)).effects_
    told = [found.kind, *(rival.kind for rival in found.rivals)]
    assert "unknown_function" in told and found.place == "x1"
