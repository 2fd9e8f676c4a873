"""What comes over time keeps its names: trajectories and derivatives as frames and pictures."""

import copy
import pickle

import numpy as np
import pandas as pd
import pytest

from swsysid import EffectSearchCV, SwitchingSystemRegressor, Trajectory
from swsysid.differentiation import differentiate
from swsysid.effects import CoulombFriction
from swsysid.results import Status, SwitchEvent

T = np.linspace(0.0, 4.0, 401)
DRIVE = pd.DataFrame({"motor_V": np.cos(T)})
SWITCHES = tuple(
    SwitchEvent(time, np.zeros(2), before, after, kind)
    for time, before, after, kind in [
        (1.0, 0, 1, "crossing"), (2.0, 1, 1, "leaving"), (3.0, 1, 0, "crossing")
    ]
)  # fmt: skip
ROLLOUT = Trajectory(
    T, np.column_stack([np.sin(T), np.cos(T)]), (T > 1).astype(int), SWITCHES, Status.COMPLETED
)


@pytest.fixture
def plt():
    pyplot = pytest.importorskip("matplotlib.pyplot")
    yield pyplot
    pyplot.close("all")


@pytest.fixture(scope="module")
def named_fit():
    """Two decays, towards 1 and towards -1, by the sign of the temperature."""
    x = np.linspace(-2.0, 2.0, 80)
    X = pd.DataFrame({"T_degC": x, "u": np.cos(7 * x)})
    rates = np.where(x > 0, 1.0 - x, -1.0 - 2 * x) + X["u"]
    model = SwitchingSystemRegressor(n_modes=2, feature_library=1, random_state=0)
    return model.fit(X, rates.to_numpy())


def test_a_trajectory_has_a_short_repr():
    assert repr(ROLLOUT) == "Trajectory(401 times from 0 to 4, x0, x1; 2 switches; completed)"
    nothing = Trajectory(T[:0], np.empty((0, 1)), np.empty(0, int), (), Status.STATE_LIMIT, ("q",))
    assert repr(nothing) == "Trajectory(0 times, q; 0 switches; state limit)"


def test_a_trajectory_becomes_a_frame():
    frame = ROLLOUT.to_frame()
    assert list(frame) == ["x0", "x1", "mode"] and frame.index.name == "t"
    np.testing.assert_array_equal(frame.index, T)
    np.testing.assert_array_equal(frame["x1"], np.cos(T))
    np.testing.assert_array_equal(frame["mode"], ROLLOUT.modes)


def test_a_trajectory_is_drawn_with_its_switches(plt):
    ax = ROLLOUT.plot()
    drawn = [line.get_xdata() for line in ax.lines]
    assert [len(x) for x in drawn] == [2, 2, 401, 401]
    assert [x[0] for x in drawn[:2]] == [1.0, 3.0]
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["x0", "x1"]
    _, own = plt.subplots()
    assert ROLLOUT.plot(own) is own and own.get_xlabel() == "t"


def test_a_rollout_is_named_as_the_data_of_the_fit(named_fit):
    rollout = named_fit.simulate([1.5], T, np.zeros((401, 1)))
    assert rollout.names == ("T_degC",)
    assert list(rollout.to_frame()) == ["T_degC", "mode"]


def test_a_rollout_with_effects_is_named_too():
    X = pd.DataFrame(np.random.default_rng(0).uniform(-2, 2, (300, 2)), columns=["speed", "u"])
    plain = SwitchingSystemRegressor(n_modes=1, feature_library=1)
    search = EffectSearchCV(plain, effects=[CoulombFriction()], max_effects=1, cv=3, random_state=0)
    y = (X["u"] - X["speed"] - 0.8 * np.sign(X["speed"])).to_numpy()
    search.fit(X, y + 0.01 * np.random.default_rng(1).standard_normal(300))
    assert search.best_estimator_.simulate([1.0], T, np.zeros((401, 1))).names == ("speed",)


def test_derivatives_keep_the_names_of_a_frame():
    data = pd.DataFrame({"q": np.sin(T), "p": np.cos(T)})
    done = differentiate(data, T, inputs=DRIVE, window=9)
    assert done.names == ("q", "p", "motor_V")
    assert list(done.to_frame()) == ["q", "p", "motor_V", "q'", "p'", "group"]
    np.testing.assert_array_equal(done.to_frame()["p'"], done.Xdot[:, 1])
    assert repr(done) == "Derivatives(393 times from 0.04 to 3.96, q, p, motor_V; 1 trajectory)"


def test_rates_have_names_where_they_are_states():
    done = differentiate(pd.Series(np.sin(T), name="q"), T, inputs=DRIVE, order=2, window=9)
    assert done.names == ("q", "q'", "motor_V") and done.rate_names == ("q'", "q''")
    frame = done.to_frame()
    assert list(frame) == ["q", "q'", "motor_V", "q''", "group"]
    np.testing.assert_array_equal(frame["q''"], done.Xdot[:, 1])


def test_derivatives_without_names_are_five_values():
    done = differentiate(np.sin(T), T, inputs=np.cos(T), window=9)
    X, _, t, _, _ = done
    assert done.names == ("x0", "u0") and len(done) == 5
    assert X is done.X and t is done.t


@pytest.mark.parametrize("again", [copy.copy, lambda one: pickle.loads(pickle.dumps(one))])
def test_copies_of_derivatives_keep_their_names(again):
    done = again(differentiate(pd.DataFrame({"q": np.sin(T)}), T, window=9))
    assert done.names == ("q",) and len(done) == 5


def test_derivatives_are_drawn_trajectory_by_trajectory(plt):
    groups = np.repeat(["run 1", "run 2"], [200, 201])
    ax = differentiate(pd.DataFrame({"q": np.sin(T)}), T, groups, window=9).plot()
    assert [len(line.get_xdata()) for line in ax.lines] == [192, 193]
    assert ax.get_ylabel() == "q"
