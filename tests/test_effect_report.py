"""The report of a search for effects: words, a dictionary, pictures and a page."""

import json

import matplotlib

matplotlib.use("Agg")

import numpy as np
import pytest

from swsysid import EffectSearchCV
from swsysid.datasets import make_undeclared
from swsysid.diagnosis import EffectReport
from swsysid.effects import AsymmetricFriction, CoulombFriction, InputCoupling, Polynomial

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
    assert "polynomial of omega" in text.partition("Not identifiable")[2]
    assert "of the samples changed their mode" in text
    assert "Rollout of trajectory run" in text


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


def test_a_record_too_short_still_has_a_report(data):
    few = slice(0, 30)
    with pytest.warns(UserWarning, match="too few to hold any out"):
        search = EffectSearchCV(data.estimator).fit(data.X[few], data.Xdot[few])
    assert "too short" in str(search.report_)
    assert json.dumps(search.report_.to_dict(), allow_nan=False)
    assert search.report_.clean and isinstance(search.report_, EffectReport)
