"""A function of one channel that another is multiplied by: a gain that depends on the place."""

import numpy as np
import pytest

from swsysid import (
    EffectRegressor,
    EffectSearchCV,
    SwitchingSystemRegressor,
    load_model,
    save_model,
)
from swsysid._data.records import make_records
from swsysid.effects import (
    Bias,
    CoulombFriction,
    PlacedEffect,
    Polynomial,
    UnknownFunction,
)
from swsysid.effects._shapes import shapes

KNOTS = tuple((knot,) for knot in np.linspace(-1.0, 1.0, 6))
LIBRARY = [Bias(), CoulombFriction(), Polynomial(), UnknownFunction()]
NOISE = 0.02


def _damping(x):
    """One half where x is far below zero, two where it is far above."""
    return 0.5 + 1.5 / (1.0 + np.exp(-6.0 * x))


def _record(seed, scale=1.0):
    """Positions and rates of x' = v, v' = -x - damping(x) v + u; rates in another unit."""
    rng = np.random.default_rng(seed)
    X = rng.uniform(-1.0, 1.0, (600, 3))
    x, v, u = X.T
    Xdot = np.column_stack([v, -x - _damping(x) * v + u])
    Xdot[:, 1] += NOISE * rng.standard_normal(len(X))
    unit = np.array([1.0, scale])
    X[:, 1] *= scale
    return X, Xdot * unit, np.repeat(np.arange(12), 50)


def _search(scale=1.0):
    X, Xdot, groups = _record(0, scale)
    search = EffectSearchCV(SwitchingSystemRegressor(1), effects=LIBRARY)
    return search.fit(X, Xdot, groups=groups)


@pytest.fixture(scope="module")
def search():
    return _search()


def test_its_columns_are_those_of_the_function_times_the_other_channel():
    X = np.random.default_rng(0).uniform(-1.0, 1.0, (40, 2))
    records = make_records(X, 2, names=("x0", "x1"))
    plain = UnknownFunction((0,), KNOTS)
    shape = UnknownFunction((0, 1), KNOTS, reference=2.0)
    (place,) = shape.places(records)
    by_hand = plain.columns(records, 0) * X[:, [1]] / 2.0
    np.testing.assert_allclose(shape.columns(records, place), by_hand, rtol=1e-14)
    assert shape.label(place, records.names) == "x0, times x1"


def test_it_is_looked_for_in_units_of_the_usual_size_of_the_other_channel():
    X = np.random.default_rng(1).standard_normal((500, 2)) * [1.0, 1000.0]
    records = make_records(X, 2, names=("x0", "x1"))
    found = {shape.channels: shape for shape in shapes(records) if shape.reference is not None}
    assert set(found) == {(0, 1), (1, 0)}
    assert found[0, 1].reference == pytest.approx(np.sqrt(np.mean(X[:, 1] ** 2)), rel=1e-12)


def test_a_law_with_one_is_fitted_and_written():
    X, Xdot, groups = _record(3)
    shape = UnknownFunction((0, 1), KNOTS, reference=0.5)
    model = EffectRegressor(SwitchingSystemRegressor(1), [PlacedEffect(shape, ((0,), 1), 1)])
    model.fit(X, Xdot, groups=groups)
    # six knots in a range of two: the step of the damping is as wide as their distance
    assert np.std(model.predict(X)[:, 1] - Xdot[:, 1]) < 2.5 * NOISE
    assert "f(x0) x1 / 0.5" in model.equations()[1]


def test_the_search_says_what_is_multiplied_by_what(search):
    (found,) = search.effects_
    assert (found.kind, found.place, found.target) == ("unknown_function", "x0, times x1", 1)
    assert found.p_value < 1e-10 and found.error_after < 1.1 * NOISE
    assert found.meaning.startswith("what x1 does to x1 depends on x0")
    # a logistic step, up to the constant damping that the law has itself
    assert any(one.ties and one.text.startswith("x1 / (1 + exp(-(x0") for one in found.formulas[:3])


def test_its_table_is_the_function_up_to_what_the_law_has(search):
    X, *_ = _record(0)
    (found,) = search.effects_
    assert list(found.table) == ["x0", "contribution", "half_width"]
    x, curve = found.table["x0"], found.table["contribution"]
    reference = np.sqrt(np.mean(X[:, 1] ** 2))
    apart = curve + _damping(x) * reference
    inside = np.abs(x) < 0.95
    assert np.ptp(apart[inside]) < 0.03  # of a step of 0.87; two standard errors at the knots


def test_it_is_drawn_as_a_function_of_its_argument(search):
    (shape,) = search.report_.data.shapes
    assert shape.is_function and (shape.axis, shape.where[:5]) == ("x0", "x1 = ")
    reference = float(shape.where[5:])
    apart = shape.contribution + _damping(shape.values) * reference
    assert np.ptp(apart[np.abs(shape.values) < 0.95]) < 0.03  # as its table
    # the data want it with the noise of a factor of one half at most
    assert np.std(shape.wanted - shape.contribution) < 2.0 * NOISE
    assert 0.0 < np.median(shape.half_width) < NOISE


def test_units_of_the_channels_do_not_matter(search):
    (found,), (other,) = search.effects_, _search(1000.0).effects_
    assert other.place == found.place
    assert other.error_after == pytest.approx(1000.0 * found.error_after, rel=1e-3)


def test_a_model_with_one_is_saved_and_simulates_as_the_plant(search, tmp_path):
    save_model(search.best_estimator_, tmp_path / "model.json")
    again = load_model(tmp_path / "model.json")
    t = np.linspace(0.0, 6.0, 1201)
    u = np.sin(2.0 * t)[:, None]
    done = again.simulate([0.8, 0.0], t, u, input_hold="linear")
    x = np.array([0.8, 0.0])
    for value in u[:-1, 0]:
        x = x + 0.005 * np.array([x[1], -x[0] - _damping(x[0]) * x[1] + value])
    # the first-order error of Euler's steps is 0.005
    np.testing.assert_allclose(done.x[-1], x, atol=0.02)
