"""Displays draw what the estimator says, leave no style behind, and name their axes."""

from types import SimpleNamespace

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest
from sklearn.base import BaseEstimator
from sklearn.tree import DecisionTreeClassifier

from swsysid import SwitchingSystemRegressor
from swsysid._results import IterationRecord
from swsysid.plotting import (
    PALETTE,
    ConvergenceDisplay,
    ModeTimelineDisplay,
    ResidualDisplay,
    RolloutDisplay,
    SwitchingSurfaceDisplay,
)

THRESHOLD = 0.3


class _Surface:
    """f(x) = x_0 - 0.3 + (x_2 - 1): vanishes at x_0 = 0.3 where x_2 is 1."""

    def surface_values(self, X):
        rest = X[:, 2] - 1.0 if X.shape[1] > 2 else 0.0
        return (X[:, 0] - THRESHOLD + rest)[:, None]


class _Switching(BaseEstimator):
    """xdot = -x in mode 0, -2x in mode 1, as the regressor's interface has it."""

    def fit(self, n_states=2):
        self.surface_ = _Surface()
        self.coef_ = np.stack([-np.eye(n_states), -2.0 * np.eye(n_states)])
        self.history_ = [
            IterationRecord(
                iteration=i,
                objective=10.0**-i,
                loss=0.0,
                lower_bound=0.0,
                mode_changes=50 - 10 * i,
                tightness=0.2 * i,
                seconds=0.1,
                modes=(np.arange(10) < i).astype(np.int8),
            )
            for i in range(1, 6)
        ]
        self.modes_ = self.history_[-1].modes
        return self

    def predict_modes(self, X):
        return (self.surface_.surface_values(np.asarray(X))[:, 0] > 0).astype(int)

    def predict(self, X):
        return -(1.0 + self.predict_modes(X))[:, None] * X

    def simulate(self, x0, t, inputs=None, *, input_hold="zero"):
        # stops after 8 times, 0.5 to the right of where it should be
        return SimpleNamespace(x=x0 * np.exp(-(t - t[0]))[:8, None] + [0.5, 0.0])


@pytest.fixture
def model():
    return _Switching().fit()


@pytest.fixture(autouse=True)
def close_figures():
    yield
    plt.close("all")


def _samples(n_features=2, seed=0):
    return np.random.default_rng(seed).uniform(-1, 1, size=(300, n_features))


def _lines_of(ax):
    """Vertices of the line contours of an axes, one array a contour set."""
    return [
        np.vstack([path.vertices for path in collection.get_paths() if len(path.vertices)])
        for collection in ax.collections
        if isinstance(collection, matplotlib.contour.ContourSet) and not collection.filled
    ]


def test_no_style_is_left_behind(model):
    before = dict(matplotlib.rcParams)
    X = _samples()
    SwitchingSurfaceDisplay.from_estimator(model, X)
    ConvergenceDisplay.from_estimator(model)
    ResidualDisplay.from_estimator(model, X, model.predict(X))
    assert dict(matplotlib.rcParams) == before


def test_surface_is_drawn_at_the_zero_level_set(model):
    display = SwitchingSurfaceDisplay.from_estimator(model, _samples())
    (line,) = _lines_of(display.ax_)
    # a linear function is interpolated exactly
    np.testing.assert_allclose(line[:, 0], THRESHOLD, atol=1e-12)


def test_other_features_are_held_at_their_medians(model):
    X = _samples(3)
    X[:, 2] = X[:, 2] + 1.0
    display = SwitchingSurfaceDisplay.from_estimator(model, X)
    (line,) = _lines_of(display.ax_)
    # of the two samples in the middle the lower one: a value that occurs
    middle = np.sort(X[:, 2])[(len(X) - 1) // 2]
    np.testing.assert_allclose(line[:, 0], THRESHOLD - (middle - 1.0), atol=1e-12)


class _ByInput(_Switching):
    """The last of four columns is a switch that alone decides the mode; the third one is idle."""

    def predict_modes(self, X):
        return (np.asarray(X)[:, 3] > 0.5).astype(int)


def test_a_portrait_of_modes_that_an_input_decides_says_where_it_is_drawn():
    X = _samples(4)
    X[:, 3] = np.arange(len(X)) % 2  # as often on as off: half on is no state of a switch
    told = {"names": ["x", "v", "load", "window"], "units": {"window": "open"}}
    model = _ByInput().fit()
    del model.surface_
    display = SwitchingSurfaceDisplay.from_estimator(model, X, **told)
    assert display.ax_.get_xlabel() == "x\nregions shown at window = 0 open"
    assert (display.regions == 0).all()
    # over the input itself nothing that decides is held
    display = SwitchingSurfaceDisplay.from_estimator(model, X, features=("x", "window"), **told)
    assert display.ax_.get_xlabel() == "x"


def test_true_guard_and_names(model):
    display = SwitchingSurfaceDisplay.from_estimator(
        model,
        _samples(),
        true_guard=lambda X: X[:, 1] - 0.1,
        names=["x", "v"],
        units={"v": "m/s"},
        features=("v", "x"),
    )
    identified, true = _lines_of(display.ax_)
    np.testing.assert_allclose(identified[:, 1], THRESHOLD, atol=1e-12)
    np.testing.assert_allclose(true[:, 0], 0.1, atol=1e-12)
    assert display.ax_.get_xlabel() == "v (m/s)"
    assert display.ax_.get_ylabel() == "x"


def test_given_modes_are_coloured_as_the_predicted_ones_they_agree_with(model):
    X = _samples()
    true_modes = np.where(X[:, 0] > THRESHOLD, "fast", "slow")
    display = SwitchingSurfaceDisplay.from_estimator(model, X, modes=true_modes)
    np.testing.assert_array_equal(display.modes, model.predict_modes(X))
    third = np.where(X[:, 0] < -0.8, "stuck", true_modes)
    display = SwitchingSurfaceDisplay.from_estimator(model, X, modes=third)
    assert display.classes == [0, 1, "stuck (true)"]
    np.testing.assert_array_equal(display.modes == "stuck (true)", third == "stuck")


def test_labels_of_the_fit_are_not_called_true():
    """Two laws drawn by a coin: the surface is constant, and the labels are the fit's own."""
    rng = np.random.default_rng(0)
    X = rng.uniform(-1, 1, (300, 2))
    rate = np.where(rng.random(300) < 0.7, X[:, 1], 2.0 + X[:, 0])
    fitted = SwitchingSystemRegressor(2, feature_library=1, random_state=0)
    with pytest.warns(UserWarning):
        fitted.fit(X, rate)
    display = SwitchingSurfaceDisplay.from_estimator(fitted, X, modes="fitted")
    assert sorted(display.classes) == [0, 1]
    legend = [text.get_text() for text in display.ax_.get_legend().get_texts()]
    assert not any("true" in text for text in legend)
    np.testing.assert_array_equal(display.modes, fitted.modes_)
    with pytest.raises(ValueError, match="modes='fited' is unknown"):
        SwitchingSurfaceDisplay.from_estimator(fitted, X, modes="fited")


def test_any_classifier_shows_its_regions():
    X = _samples()
    tree = DecisionTreeClassifier(max_depth=1).fit(X, np.where(X[:, 0] > 0.2, "right", "left"))
    display = SwitchingSurfaceDisplay.from_estimator(tree, X)
    (line,) = _lines_of(display.ax_)
    # the edge lies within one cell of the grid (2.16 / 249) of the tree's threshold
    np.testing.assert_allclose(line[:, 0], tree.tree_.threshold[0], atol=0.01)
    assert list(display.classes) == ["left", "right"]


def test_a_data_frame_keeps_its_names():
    pd = pytest.importorskip("pandas")
    X = pd.DataFrame(_samples(), columns=["x", "v"])
    tree = DecisionTreeClassifier(max_depth=1).fit(X, X["x"] > 0)
    display = SwitchingSurfaceDisplay.from_estimator(tree, X, features=["x", "v"])
    assert display.labels == ("x", "v")


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"features": ("x0", "speed")}, "'speed' is none of the columns; choose among x0, x1"),
        ({"names": ["x"]}, "names has 1 entries for 2 columns"),
    ],
)
def test_surface_display_names_what_is_wrong(model, arguments, sentence):
    with pytest.raises(ValueError, match=sentence):
        SwitchingSurfaceDisplay.from_estimator(model, _samples(), **arguments)


def test_convergence_draws_the_history(model):
    display = ConvergenceDisplay.from_estimator(model, label="first")
    display.plot(ax=display.ax_, label="second")
    objective, changes, tightness = (axis.get_lines() for axis in display.ax_)
    assert len(objective) == len(changes) == len(tightness) == 2
    np.testing.assert_array_equal(objective[0].get_ydata(), [r.objective for r in model.history_])
    np.testing.assert_array_equal(changes[0].get_ydata(), [40, 30, 20, 10, 0])
    np.testing.assert_array_equal(tightness[0].get_ydata(), [r.tightness for r in model.history_])
    assert display.ax_[0].get_yscale() == "log"


def test_convergence_counts_mismatches_whatever_the_names_of_the_modes(model):
    # iteration i has the first i of ten samples in mode 1; in truth it is the first four
    truth = np.where(np.arange(10) < 4, "a", "b")
    display = ConvergenceDisplay.from_estimator(model, modes=truth)
    np.testing.assert_array_equal(display.ax_[1].get_lines()[0].get_ydata(), [3, 2, 1, 0, 1])
    assert display.ax_[1].get_ylabel() == "mode mismatch"


def test_convergence_needs_three_axes(model):
    with pytest.raises(ValueError, match="ax holds 1 axes, but this display draws 3 panels"):
        ConvergenceDisplay.from_estimator(model, ax=plt.figure().subplots())


def test_rollout_error_is_the_distance_to_the_measured_states(model):
    t = np.tile(np.linspace(0.0, 1.0, 10), 2)
    groups = np.repeat(["b", "a"], 10)
    X = np.column_stack([np.exp(-t), np.exp(-t)]) * np.repeat([1.0, 2.0], 10)[:, None]
    display = RolloutDisplay.from_estimator(model, X, t, groups=groups)
    assert [len(error) for error in display.errors] == [8, 8]
    np.testing.assert_allclose(np.concatenate(display.errors), 0.5, rtol=1e-12)
    np.testing.assert_array_equal(display.measured[1], X[10:])
    for line, error in zip(display.ax_[1].get_lines(), display.errors, strict=True):
        np.testing.assert_array_equal(line.get_ydata(), error[1:])


def test_rollout_of_one_feature_is_drawn_over_time(model):
    t = np.linspace(2.0, 3.0, 10)
    X = np.column_stack([np.exp(-t), np.exp(-t)])
    display = RolloutDisplay.from_estimator(model, X, t, features=[1], names=["x", "v"])
    identified, measured = display.ax_[0].get_lines()
    np.testing.assert_array_equal(measured.get_xdata(), t - 2.0)
    np.testing.assert_array_equal(measured.get_ydata(), X[:, 1])
    assert len(identified.get_xdata()) == 8
    assert display.ax_[0].get_xlabel() == "time (s)"


def test_rollout_tells_the_unit_of_the_times(model):
    t, X = np.arange(10.0), np.tile([1.0, -0.5], (10, 1))
    for units, label in (({"time": "min"}, "time (min)"), ({"x0": "m"}, "time (s)")):
        display = RolloutDisplay.from_estimator(model, X, t, features=[1], units=units)
        assert [ax.get_xlabel() for ax in display.ax_] == [label, label]


def test_rollout_draws_states_only(model):
    X = np.zeros((5, 3))
    with pytest.raises(ValueError, match="name one or two of the states x0, x1"):
        RolloutDisplay.from_estimator(model, X, np.arange(5.0), features=[2])


def test_timeline_bars_end_between_samples_and_ignore_the_naming(model):
    t = np.arange(6.0)
    X = np.column_stack([[1, 1, -1, -1, -1, 1], np.zeros(6)])
    true_modes = np.array([7, 7, 4, 4, 4, 7])  # the model calls them 1 and 0
    display = ModeTimelineDisplay.from_estimator(model, X, t, modes=true_modes)
    np.testing.assert_array_equal(display.modes[0], [1, 1, 0, 0, 0, 1])
    np.testing.assert_array_equal(display.true_modes[0], display.modes[0])
    bars = display.ax_.collections[0].get_paths()
    spans = [(path.vertices[:, 0].min(), path.vertices[:, 0].max()) for path in bars]
    assert spans == [(0.0, 1.5), (1.5, 4.5), (4.5, 5.0)]


def test_residual_shows_the_missing_step(model):
    X = _samples(seed=1)
    Xdot = model.predict(X) + np.column_stack([np.zeros(300), 0.2 * np.sign(X[:, 1])])
    display = ResidualDisplay.from_estimator(model, X, Xdot, against=1, names=["x", "v"])
    assert display.labels == ("v", "residual of d/dt v")
    np.testing.assert_allclose(display.residual, 0.2 * np.sign(display.coordinate), atol=1e-12)
    medians = display.ax_.get_lines()[-1]
    ends = np.asarray(medians.get_ydata())[[0, -1]]
    np.testing.assert_allclose(ends, [-0.2, 0.2], atol=1e-12)


def test_residual_against_time(model):
    X = _samples()
    t = np.linspace(0, 3, len(X))
    display = ResidualDisplay.from_estimator(
        model, X, model.predict(X), against=t, units={"against": "time (s)"}
    )
    assert display.ax_.get_xlabel() == "time (s)"
    np.testing.assert_array_equal(display.coordinate, t)
    with pytest.raises(ValueError, match=r"against has shape \(299,\); give one value for each"):
        ResidualDisplay.from_estimator(model, X, X, against=t[1:])


def test_arrays_of_another_length_get_a_sentence(model):
    X = _samples()
    with pytest.raises(ValueError, match="give one value for each of the 300 samples"):
        ModeTimelineDisplay.from_estimator(model, X, np.arange(3.0))
    with pytest.raises(ValueError, match="give one value for each of the 300 samples"):
        RolloutDisplay.from_estimator(model, X, np.arange(3.0))
    with pytest.raises(ValueError, match="the model predicts 2 velocities of 300 samples"):
        ResidualDisplay.from_estimator(model, X, X[:, :1])


def test_a_column_that_is_not_there_gets_a_sentence(model):
    with pytest.raises(ValueError, match="no column 9; choose among x0, x1"):
        SwitchingSurfaceDisplay.from_estimator(model, _samples(), features=(0, 9))


def test_displays_have_a_short_repr(model):
    assert repr(ConvergenceDisplay.from_estimator(model)) == "ConvergenceDisplay()"


def test_rounding_errors_are_no_floor_of_the_objective():
    objective = [1.0, 1e-3, 1e-15]
    display = ConvergenceDisplay(
        iterations=[1, 2, 3], objective=objective, mode_changes=[9, 1, 0], tightness=[0.5, 1, 1]
    ).plot()
    assert display.ax_[0].get_ylim()[0] == pytest.approx(1e-6)
    (note,) = display.ax_[0].texts
    assert "rounding" in note.get_text()


def test_a_second_curve_fits_into_the_panel_of_the_first():
    first = ConvergenceDisplay(
        iterations=[1, 2], objective=[2.0, 1.0], mode_changes=[9, 0], tightness=[1, 1]
    ).plot()
    second = ConvergenceDisplay(
        iterations=[1, 2], objective=[2.0, 1.0], mode_changes=[90, 0], tightness=[1, 1]
    ).plot(ax=first.ax_)
    assert second.ax_[1].get_ylim() == pytest.approx((0.0, 1.05 * 90))


def test_limits_of_the_plane(model):
    display = SwitchingSurfaceDisplay.from_estimator(model, _samples(), limits=[(-3, 4), (-5, 6)])
    assert display.ax_.get_xlim() == (-3, 4)
    assert display.ax_.get_ylim() == (-5, 6)


def test_few_rollouts_are_drawn(model):
    t = np.tile(np.linspace(0.0, 1.0, 10), 30)
    groups = np.repeat(np.arange(30), 10)
    display = RolloutDisplay.from_estimator(model, _samples()[: len(t)], t, groups=groups)
    assert len(display.simulated) == 5


# what a reader without red or green cones sees (Machado, Oliveira and Fernandes 2009)
RED_BLIND = np.array(
    [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ]
)
GREEN_BLIND = np.array(
    [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ]
)
TO_XYZ = np.array(
    [
        [0.4124564, 0.3575761, 0.180437],
        [0.2126729, 0.7151522, 0.072175],
        [0.0193339, 0.119192, 0.9503],
    ]
)


def _lab(colour, seen):
    """CIELAB coordinates of a colour as a reader sees it."""
    coded = np.array(matplotlib.colors.to_rgb(colour))
    linear = np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)
    white = TO_XYZ.sum(axis=1)
    x, y, z = np.cbrt(TO_XYZ @ np.clip(seen @ linear, 1e-4, 1.0) / white)
    return np.array([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)])


@pytest.mark.parametrize("seen", [np.eye(3), RED_BLIND, GREEN_BLIND])
def test_the_first_three_colours_are_told_apart_by_every_reader(seen):
    colours = [_lab(colour, seen) for colour in PALETTE[:3]]
    for first, second in ((0, 1), (0, 2), (1, 2)):
        # twice what is seen at a glance (10); matplotlib's orange and green are 5 apart
        assert np.linalg.norm(colours[first] - colours[second]) > 20.0
    confused = [_lab(colour, RED_BLIND) for colour in ("#ff7f0e", "#2ca02c")]
    assert np.linalg.norm(confused[0] - confused[1]) < 10.0
