"""The report of a search for effects: words, a dictionary, pictures and a page."""

import json
from dataclasses import replace
from html import escape
from html.parser import HTMLParser
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from documentation import script

from swsysid import EffectRegressor, EffectSearchCV, SwitchingSystemRegressor
from swsysid._data.records import make_records
from swsysid._effect_search.contents import stretches
from swsysid._effect_search.contributions import linearised
from swsysid._effect_search.words import sentence
from swsysid.datasets import make_undeclared
from swsysid.diagnosis import EffectReport
from swsysid.effects import (
    AsymmetricFriction,
    Backlash,
    Bias,
    CoulombFriction,
    ExtraMode,
    InputCoupling,
    Lag,
    PeriodicForcing,
    PlacedEffect,
    Polynomial,
    QuadraticDrag,
    Reset,
    SensorOffset,
    all_effects,
)
from swsysid.plotting import EffectReportDisplay

NAMES = ["theta", "omega", "torque"]


@pytest.fixture(scope="module")
def data():
    return make_undeclared("coulomb_friction", system="pendulum", n_samples=1200, random_state=0)


@pytest.fixture(scope="module")
def search(data):
    pandas = pytest.importorskip("pandas")
    library = [CoulombFriction(), Polynomial(), AsymmetricFriction(), InputCoupling()]
    frame = pandas.DataFrame(data.X, columns=NAMES)
    groups = np.array([f"run{number}" for number in data.groups])
    model = EffectSearchCV(data.estimator, effects=library)
    return model.fit(frame, data.Xdot, t=data.t, groups=groups)


@pytest.fixture(scope="module")
def report(search):
    return search.report_


# --- words ----------------------------------------------------------------------------------


def test_the_text_names_effect_errors_rivals_and_what_was_not_looked_for(report):
    text = str(report)
    assert repr(report) == text
    assert "1. coulomb friction of omega in omega'" in text
    (effect,) = report.effects
    assert f"before {effect.error_before:.4g}, after {effect.error_after:.4g}" in text
    assert "(95 %: " in text
    assert [rival.kind for rival in effect.rivals] == ["asymmetric_friction"]
    assert "rival, as good on these data: asymmetric friction of omega" in text
    assert "more samples with omega between" in text
    assert "input_coupling: needs logged signals: give signals" in text
    assert "polynomial of omega" in text.partition("the declared model can take their shape")[2]
    assert "of the samples changed their mode" not in text  # there is one
    assert "Rollout of trajectory run" in text


def test_the_first_line_says_how_sure_it_is_and_whether_rollouts_become_better(report):
    assert report.summary.startswith("Coulomb friction of omega in omega', p < 1e-16: with it the ")
    assert "Rollouts" not in report.summary
    # the same with the two models exchanged, and with one that ends early
    data = replace(report.data)
    exchanged = [replace(one, before=one.after, after=one.before) for one in data.rollouts]
    vars(data)["rollouts"] = tuple(exchanged)
    told = replace(report, data=data).summary
    assert "Rollouts of the untouched rows do not become better: their error is " in told
    name = exchanged[0].name
    vars(data)["rollouts"] = (replace(report.data.rollouts[0], ended=("", "diverged at 1")),)
    told = replace(report, data=data).summary
    assert f"With them the rollout of {name} ends early, without them it does not." in told


def test_a_channel_keeps_its_letters_at_the_start_of_a_sentence():
    assert sentence("v has no further effect", ["v", "u"]) == "v has no further effect."
    assert sentence("dry friction opposes v", ["v", "u"]) == "Dry friction opposes v."


def test_the_page_has_the_laws_and_the_guards(search, report):
    page = report.to_html()
    for line in [*search.equations(), *search.surface_equations()]:
        assert escape(line) in page
    assert "sign(omega)" in page


def test_leftovers_say_rightly_why_no_surface_was_looked_at(report):
    # two modes in the test of one more mode below
    assert report.residual_before.skipped["surface"] == "the model has one mode"


@pytest.mark.nightly
def test_one_more_mode_has_neither_an_empty_table_nor_an_empty_bracket(data):
    extra = make_undeclared("extra_mode", system="pendulum", n_samples=1200, random_state=3)
    found = EffectSearchCV(extra.estimator, effects=[ExtraMode()])
    found = found.fit(extra.X, extra.Xdot, t=extra.t, groups=extra.groups)
    assert [effect.kind for effect in found.effects_] == ["extra_mode"]
    assert "surface" not in found.report_.residual_after.skipped
    # the law of the further mode, the surface and its share of the rows are told
    (effect,) = found.effects_
    laws = [line for line in effect.equations if "'" in line]
    assert set(laws) < set(found.equations()) and len(laws) == 2
    assert set(effect.equations) - set(laws) == set(found.surface_equations())
    assert 0.0 < effect.parameters["share_of_rows"] < 0.5
    assert all(escape(line) in found.report_.to_html() for line in effect.equations)
    assert all(line in str(found.report_) for line in effect.equations)
    page, text = found.report_.to_html(), str(found.report_)
    assert "<tbody></tbody>" not in page and "()" not in page and "of modes" not in page
    assert "There is one more mode than declared." in page
    assert "There is one more mode than declared." in text


def test_residuals_of_one_trajectory_are_drawn_over_its_time(data):
    one = data.groups == data.groups[0]
    t = data.t[one] + 100.0
    found = EffectSearchCV(data.estimator, effects=[CoulombFriction()])
    report = found.fit(data.X[one], data.Xdot[one], t=t).report_
    axes = report.plot(units={"time": "s"}).ax_[0]
    assert axes.get_xlabel() == "time (s)"
    drawn = np.concatenate([dots.get_offsets()[:, 0] for dots in axes.collections])
    assert set(drawn) <= set(t[report.data.rows])
    plt.close("all")


def test_errors_of_trajectories_add_up_to_the_held_out_error(report):
    parts = report.by_trajectory
    assert all(part["trajectory"].startswith("run") for part in parts)
    weight = np.array([part["n_samples"] for part in parts])
    assert weight.sum() == report.n_held_out
    for place, when in ((0, "before"), (-1, "after")):
        squares = np.array([part[when] for part in parts]) ** 2
        total = np.sqrt(weight @ squares / weight.sum())
        # the same numbers, summed in another order
        np.testing.assert_allclose(total, report.errors[place]["held_out"], rtol=1e-10)


def test_the_dictionary_survives_json(report):
    listed = report.to_dict()
    assert json.loads(json.dumps(listed, allow_nan=False)) == listed
    assert set(listed) == set(report) and len(report) == len(listed)
    assert listed["effects"][0]["kind"] == "coulomb_friction"
    assert listed["effects"][0]["rivals"][0]["advice"]
    assert listed["history"][0]["effects"] == ["coulomb friction of omega in omega'"]
    with pytest.raises(KeyError, match="is no part of the report"):
        report["colour"]


def test_the_shape_is_the_effect_itself_and_its_band_holds_the_truth(report, data):
    (shape,) = report.data.shapes
    (effect,) = report.effects
    assert shape.axis == "omega" and shape.target == 1 and shape.is_function
    friction = effect.parameters["friction"]
    np.testing.assert_allclose(shape.contribution, -friction * np.sign(shape.values), rtol=1e-12)
    low, high = effect.intervals["friction"]
    # the interval has Student's quantile, the band the normal one: 1.001 apart for 1200 rows
    np.testing.assert_allclose(shape.half_width, 0.5 * (high - low), rtol=2e-3)
    np.testing.assert_allclose(
        (shape.wanted - shape.contribution).std(), report.errors[-1]["held_out"][1], rtol=0.2
    )


def test_bands_are_finite_at_the_end_of_a_scan(data):
    """The scan of a lag is geometric: a step as wide as its middle would leave its domain."""
    lag = PlacedEffect(Lag(), place=2, target=1, theta=(0.4 * data.time_step,))
    model = EffectRegressor(data.estimator, [lag])
    fit = model.fit(data.X, data.Xdot, t=data.t, groups=data.groups).joint_fit_
    records = make_records(data.X, 2, t=data.t, groups=data.groups, names=["x", "v", "u"])
    rows = np.arange(len(records))
    slopes = linearised(fit, 0, records, rows, fit.modes)
    assert slopes.shape == (len(records), 2) and np.isfinite(slopes).all()
    # the slope in the time constant, against the difference of two lags close to each other
    wide, narrow = (1.0 + 1e-4) * lag.theta[0], (1.0 - 1e-4) * lag.theta[0]
    apart = Lag().columns(records, 2, wide) - Lag().columns(records, 2, narrow)
    expected = fit.coef[0][0] * apart[:, 0] / (wide - narrow)
    # a step of a hundredth of the time constant: the error is of second order
    np.testing.assert_allclose(slopes[:, 1], expected, atol=1e-2 * np.abs(expected).max())


def test_a_record_too_short_still_has_a_report(data):
    few = slice(0, 30)
    with pytest.warns(UserWarning, match="too few to hold any out"):
        search = EffectSearchCV(data.estimator).fit(data.X[few], data.Xdot[few])
    assert "too short" in str(search.report_)
    assert json.dumps(search.report_.to_dict(), allow_nan=False)
    assert search.report_.clean and isinstance(search.report_, EffectReport)
    page = _Page(search.report_.to_html())
    assert page.headings == ["Effect search"] and "Nothing was searched" in "".join(page.words)
    for draw in (
        search.report_.plot,
        lambda: EffectReportDisplay.from_estimator(search, data.X, data.Xdot),
    ):
        with pytest.raises(ValueError, match="too short to hold any of it out"):
            draw()


def test_stretches_of_one_long_record_are_named_by_their_times(data):
    rows = data.groups < 3  # three trajectories are cut into stretches, one is not named
    search = EffectSearchCV(data.estimator, effects=[CoulombFriction()])
    search.fit(data.X[rows], data.Xdot[rows], t=data.t[rows], groups=data.groups[rows])
    report = search.report_
    assert "stretches of time" in report.held_out
    names = [part["trajectory"] for part in report.by_trajectory]
    assert len(set(names)) == len(names) == len(report.data.stretches)
    assert all(" to " in name and name.split(",")[0] in "012" for name in names)
    # every stretch is contiguous in time and together they are what was held out
    parts = [part for _, part in report.data.stretches]
    np.testing.assert_array_equal(np.sort(np.concatenate(parts)), np.arange(report.n_held_out))
    for part in parts:
        np.testing.assert_array_equal(np.diff(report.data.rows[part]), 1)


def test_a_jump_is_not_said_to_lower_the_error_of_velocities():
    data = make_undeclared("reset", n_samples=800, random_state=0)
    search = EffectSearchCV(data.estimator, effects=[Reset(), Bias()], max_effects=1)
    report = search.fit(data.X, data.Xdot, t=data.t, groups=data.groups).report_
    assert [effect.kind for effect in report.effects] == ["reset"]
    assert report.summary.endswith("of any velocity, since a jump lies between two samples.")
    assert report.data.shapes[0].target == report.effects[0].target


# --- pictures -------------------------------------------------------------------------------

UNITS = {"omega": "rad/s", "d/dt omega": "rad/s^2", "time": "s"}


@pytest.fixture(autouse=True)
def close_figures():
    yield
    plt.close("all")


def labels(display):
    return [(ax.get_xlabel(), ax.get_ylabel()) for ax in display.ax_]


def test_the_display_has_four_labelled_panels(report):
    display = report.plot(units=UNITS)
    assert isinstance(display, EffectReportDisplay) and display.figure_ is plt.gcf()
    assert labels(display) == [
        ("time (s), trajectory after trajectory", "residual of d/dt omega (rad/s^2)"),
        ("trajectory", "RMS error of d/dt omega (rad/s^2)"),
        ("omega (rad/s)", "share of d/dt omega (rad/s^2)"),
        ("time (s)", "omega (rad/s)"),
    ]
    bars = display.ax_[1].patches
    heights = [bar.get_height() for bar in bars]
    half = len(heights) // 2
    assert all(after < before for before, after in zip(heights[:half], heights[half:], strict=True))
    names = [text.get_text() for text in display.ax_[1].get_xticklabels()]
    assert sorted(names) == sorted(one["trajectory"] for one in report.by_trajectory)


def test_fresh_data_are_drawn_with_the_models_fitted_to_all_rows(search, data):
    pandas = pytest.importorskip("pandas")
    test = data.test
    display = EffectReportDisplay.from_estimator(
        search, test.X, test.Xdot, t=test.t, groups=test.groups, equation="theta"
    )
    assert labels(display)[0][1] == "residual of d/dt theta"
    before, after = display.data.errors
    frame = pandas.DataFrame(test.X, columns=NAMES)
    predicted = search.predict(frame, t=test.t, groups=test.groups)
    expected = np.sqrt(np.mean((test.Xdot - predicted) ** 2, axis=0))
    np.testing.assert_allclose(after, expected, rtol=1e-12)
    assert after[1] < 0.2 * before[1]


def test_without_an_order_of_rows_there_are_two_panels(search, data):
    display = EffectReportDisplay.from_estimator(search, data.test.X, data.test.Xdot)
    assert [x for x, _ in labels(display)] == ["held-out row", "omega"]
    assert display.data.rollouts == ()
    assert "give t or groups" in display.data.why_no_rollouts


def test_axes_of_the_user_are_used_and_a_wrong_wish_is_refused(report):
    _, axes = plt.subplots(2, 2)
    assert report.plot(ax=axes).ax_[0] is axes[0, 0]
    with pytest.raises(ValueError, match="this display draws 4 panels"):
        report.plot(ax=plt.subplots()[1])
    with pytest.raises(ValueError, match="equation='torque' is unknown; choose among theta, omega"):
        report.plot(equation="torque")
    with pytest.raises(ValueError, match="effect=1 is too large; give a number below 1"):
        report.plot(effect=1)


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("effect", "axis", "is_function", "has_band"),
    [
        (Backlash(), "u", False, True),  # a loop
        (PeriodicForcing(), "time", True, True),
        (SensorOffset(), "x", False, False),  # shown as the change of the prediction
    ],
)
def test_shapes_of_other_kinds(effect, axis, is_function, has_band):
    pandas = pytest.importorskip("pandas")
    data = make_undeclared(effect.kind, n_samples=800, random_state=0)
    frame = pandas.DataFrame(data.X, columns=data.feature_names)
    search = EffectSearchCV(data.estimator, effects=[effect, Bias()], max_effects=1)
    report = search.fit(frame, data.Xdot, t=data.t, groups=data.groups).report_
    (shape,) = report.data.shapes
    assert (shape.axis, shape.is_function) == (axis, is_function)
    assert np.isfinite(shape.half_width).all() == has_band
    assert shape.target == 1  # the law of v is what is wrong, even if the sensor of x is
    display = report.plot()
    assert display.ax_[2].get_xlabel() == axis and display.ax_[2].get_ylabel() == "share of d/dt v"


# --- the page -------------------------------------------------------------------------------


class _Page(HTMLParser):
    """What a browser would see: headings, pictures, balanced tags, things to load."""

    EMPTY = {"img", "meta", "br", "link"}

    def __init__(self, text):
        super().__init__()
        self.open, self.headings, self.pictures, self.loaded, self.words = [], [], [], [], []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attributes):
        attributes = dict(attributes)
        self.loaded += [attributes[name] for name in ("href", "src") if name in attributes]
        if tag == "img":
            self.pictures.append(attributes)
        if tag not in self.EMPTY:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, text):
        self.words.append(text)
        if self.open and self.open[-1] in ("h1", "h2", "h3"):
            self.headings.append(text)


def test_the_page_has_all_parts_and_loads_nothing(report, tmp_path):
    path = tmp_path / "page.html"
    text = report.to_html(path, units=UNITS, title="Pendulum <1>")
    assert path.read_text(encoding="utf-8") == text
    page = _Page(text)
    assert page.open == []
    assert page.headings == [
        "Pendulum <1>",
        "Error before and after",
        "Effects",
        "1. coulomb friction of omega in omega'",
        "The model",
        "Residual before and after",
        "Left over by the declared model",
        "Left over by the model with the effects",
        "Error by trajectory",
        "Rollouts before and after",
        "The search",
    ]
    # shape, residuals, two residual reports, errors by trajectory, and the rollouts
    assert len(page.pictures) == 6 + len(report.rollouts)
    assert all(picture["alt"] for picture in page.pictures)
    assert all(source.startswith("data:image/png;base64,") for source in page.loaded)
    words = " ".join(page.words)
    for told in ("asymmetric friction of omega", "needs logged signals", "omega' [rad/s^2]"):
        assert told in words
    assert report.errors[0]["held_out"][1] > report.errors[1]["held_out"][1]
    assert all(f"{row['held_out'][1]:.4g}" in words for row in report.errors)


def test_a_notebook_shows_the_page(report):
    assert report._repr_html_() == report.to_html()


def test_the_page_of_a_complete_model_says_so(data):
    clean = make_undeclared(None, system="pendulum", n_samples=600, random_state=1)
    search = EffectSearchCV(clean.estimator, effects=[CoulombFriction()])
    report = search.fit(clean.X, clean.Xdot, t=clean.t, groups=clean.groups).report_
    assert report.clean and "No effect is missing" in str(report)
    page = _Page(report.to_html())
    assert "Effects" not in page.headings and "Error by trajectory" in page.headings
    assert len(report.plot().ax_) == 3  # no shape


def test_an_effect_may_be_missing_where_free_rollouts_leave_more_than_noise(data):
    clean = make_undeclared(None, system="pendulum", n_samples=600, random_state=1)
    search = EffectSearchCV(clean.estimator, effects=[CoulombFriction()])
    report = search.fit(clean.X, clean.Xdot, t=clean.t, groups=clean.groups).report_
    assert report.data.free is None  # nothing tells the noise of states
    told = "Free rollouts leave: theta 7 of the noise."
    vars(report.data)["free"] = SimpleNamespace(holds=False, sentence=lambda: told)
    assert "No effect is missing" not in str(report)
    assert "free rollouts of the model leave more" in str(report) and told[1:] in str(report)


def test_the_page_of_an_exact_model_has_no_picture_of_nothing():
    X = np.random.default_rng(0).uniform(-1, 1, (300, 2))
    Xdot = (X[:, 1] - X[:, 0]).reshape(-1, 1)
    declared = SwitchingSystemRegressor(n_modes=1, feature_library=1)
    report = EffectSearchCV(declared, effects=[CoulombFriction()]).fit(X, Xdot).report_
    page = _Page(report.to_html())
    assert report.clean and any("zero to rounding" in words for words in page.words)


def test_a_page_without_a_test_to_draw_has_the_verdicts_all_the_same(report):
    leftover = replace(report.residual_before, tests=())
    page = replace(report, residual_before=leftover, residual_after=leftover).to_html()
    assert "Left over by the declared model" in page
    assert "against what tells most about it" not in page


# --- the documentation ------------------------------------------------------------------------

ROOT = Path(__file__).parents[2]


def test_the_table_of_effects_in_the_documentation_is_the_library():
    page = (ROOT / "docs" / "effects.md").read_text(encoding="utf-8")
    assert script("effect_table").page_with_tables() == page, "run docs/effect_table.py --write"
    assert all(f"| `{effect.kind}` |" in page for effect in all_effects())
    for name in ("README.md", "CHANGELOG.md"):
        assert f"{len(all_effects())} kinds" in (ROOT / name).read_text(encoding="utf-8")


def test_the_texts_name_when_where_and_what(report, data):
    text = str(report)
    assert "Left over of omega' without the effects: " in text
    assert "Left over of omega' with the effects: " in text
    noted, said = replace(report, dropped=("reset in omega",)), "Dropped at the end, since chance"
    for shown in (noted.to_html(), str(noted)):
        assert f"{said} explains it as well: reset in omega." in shown
    assert said not in report.to_html()
    assert said not in text
    records = make_records(data.X, 2, t=data.t, groups=data.groups, names=NAMES)
    numbers, rows = np.unique(data.groups), np.arange(len(records))
    found = stretches(records, rows, numbers.astype(float))
    assert [name for name, _ in found] == [str(number) for number in numbers]


def test_an_exact_equation_is_no_headline():
    # q' = v holds to rounding, of which a joint fit may leave a little more or less
    rng = np.random.default_rng(0)
    X = rng.uniform(-1.0, 1.0, (800, 2))
    force = -2.0 * X[:, 0] - 0.4 * np.sign(X[:, 1]) + 0.01 * rng.standard_normal(800)
    search = EffectSearchCV(SwitchingSystemRegressor(n_modes=1), effects=[CoulombFriction()])
    report = search.fit(X, np.column_stack([X[:, 1], force])).report_
    assert "of x1' is" in report.summary
    assert report.data.most_changed == 1
    assert [effect.target for effect in report.effects] == [1]


def test_velocities_have_the_unit_of_their_state_by_time(search):
    page = search.report_.to_html(units={"theta": "rad", "omega": "rad/s"})
    assert escape("theta' [rad/s]") in page and escape("omega' [rad/s^2]") in page


def test_the_first_line_does_not_say_that_all_is_well_where_the_residual_says_otherwise():
    rng = np.random.default_rng(0)
    X = rng.uniform(-1.0, 1.0, (800, 1))
    y = -X + 0.5 * np.cos(6.0 * X) + 0.01 * rng.standard_normal((800, 1))
    search = EffectSearchCV(SwitchingSystemRegressor(n_modes=1), effects=[CoulombFriction()])
    report = search.fit(X, y).report_
    assert not report.residual_before.clean
    assert report.clean and "not all noise" in report.summary


def test_the_rounding_that_an_exact_law_leaves_has_no_digits():
    data = make_undeclared("quadratic_drag", system="pendulum", noise=0.0, random_state=1)
    library = [QuadraticDrag(), CoulombFriction()]
    search = EffectSearchCV(data.estimator, effects=library, max_effects=1)
    search.fit(data.X, data.Xdot, t=data.t, groups=data.groups)
    (found,) = search.effects_
    least = 1e-12 * found.error_before
    assert found.error_after < least
    lines = str(search.report_).splitlines()
    assert f"is < {least:.1g} instead of {found.error_before:.4g}." in lines[1]
    assert sum(f"< {least:.1g}" in line for line in lines) == 3
    assert f"&lt; {least:.1g} with it" in search.report_.to_html()
