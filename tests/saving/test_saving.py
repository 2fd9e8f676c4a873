"""Model files: bit-equal models back, and one sentence for everything that is no model."""

import hashlib
import json
import pickle
import re
from pathlib import Path

import numpy as np
import pytest
from effect_fits import MASS, fit_by_hand, relay
from sklearn.compose import ColumnTransformer
from sklearn.kernel_approximation import RBFSampler
from sklearn.linear_model import LogisticRegression, Ridge
from sklearn.pipeline import make_pipeline, make_union
from sklearn.preprocessing import FunctionTransformer, PolynomialFeatures, StandardScaler

import swsysid
from swsysid import (
    EffectRegressor,
    EffectSearchCV,
    FunctionLibrary,
    MomentRelaxation,
    PolynomialSurfaceClassifier,
    Recording,
    SwitchingSystemRegressor,
    load_model,
    save_model,
)
from swsysid._saving.values import read_objects, write_objects
from swsysid.datasets import make_damped_oscillator, make_undeclared
from swsysid.effects import (
    CoulombFriction,
    Delay,
    Effect,
    PlacedEffect,
    all_effects,
    special_effects,
)

DATA = make_damped_oscillator(300, random_state=0)
WRITTEN = sorted(Path(__file__).parent.glob("model_of_*.json"))  # one by each version


def pysindy_library():
    import pysindy

    return pysindy.PolynomialLibrary(2) + pysindy.FourierLibrary(1)


def squares_of_the_second():
    chosen = ColumnTransformer([("second", "passthrough", [1])], verbose_feature_names_out=False)
    passed = FunctionTransformer(feature_names_out="one-to-one")
    return make_union(passed, make_pipeline(chosen, PolynomialFeatures(2)))


REGRESSORS = {
    "columns": {},
    "monomials": {"feature_library": 2},
    "numpy's functions": {"feature_library": FunctionLibrary([np.sin, np.positive, np.multiply])},
    "transformers": {"feature_library": squares_of_the_second()},
    "random features": {"feature_library": RBFSampler(n_components=5, random_state=0)},
    "PySINDy": {"feature_library": pysindy_library()},
    "surface library": {"surface": PolynomialSurfaceClassifier(feature_library=2)},
    "paper": {"coupling": 0, "surface": PolynomialSurfaceClassifier(1, standardize=False)},
    "moments": {"relaxation": MomentRelaxation(order=1), "max_iter": 2, "n_init": 1},
    "another classifier": {"surface": LogisticRegression()},
    "one mode": {"n_modes": 1},
    "counted modes": {"n_modes": "auto", "max_modes": 3},
    "generator": {"random_state": np.random.RandomState(3)},
}


def there_and_back(model, folder, **options):
    save_model(model, folder / "model.json", **options)
    return load_model(folder / "model.json")


@pytest.mark.parametrize("name", REGRESSORS)
def test_a_regressor_comes_back_bit_by_bit(name, tmp_path):
    parameters = {"n_modes": 2, "random_state": 0} | REGRESSORS[name]
    model = SwitchingSystemRegressor(**parameters).fit(DATA.X, DATA.Xdot)
    same = there_and_back(model, tmp_path)
    for method in ("predict", "predict_modes", "predict_mode_proba", "mode_velocities"):
        ours, theirs = getattr(model, method)(DATA.X), getattr(same, method)(DATA.X)
        assert ours.dtype == theirs.dtype and ours.tobytes() == theirs.tobytes(), method
    assert same.equations() == model.equations()
    assert same.guard_score_ == model.guard_score_ or np.isnan(model.guard_score_)
    np.testing.assert_array_equal(same.membership_, model.membership_)
    rollouts = [each.simulate([1.0, 0.0], np.linspace(0.0, 2.0, 21)) for each in (model, same)]
    np.testing.assert_array_equal(rollouts[0].x, rollouts[1].x)
    assert repr(same) == repr(model) or name == "generator"


def test_what_came_back_is_plotted_fitted_and_saved_again(tmp_path):
    pytest.importorskip("matplotlib")
    from swsysid.plotting import ConvergenceDisplay, SwitchingSurfaceDisplay

    model = SwitchingSystemRegressor(2, random_state=0).fit(DATA.X, DATA.Xdot)
    same = there_and_back(model, tmp_path)
    ConvergenceDisplay.from_estimator(same)
    display = SwitchingSurfaceDisplay.from_estimator(same, DATA.X)
    expected = SwitchingSurfaceDisplay.from_estimator(model, DATA.X)
    np.testing.assert_array_equal(display.regions, expected.regions)
    first = (tmp_path / "model.json").read_bytes()
    save_model(same, tmp_path / "model.json")
    assert (tmp_path / "model.json").read_bytes() == first
    again = same.fit(DATA.X, DATA.Xdot)
    np.testing.assert_array_equal(again.coef_, model.coef_)


@pytest.mark.parametrize("classes", [["in", "out"], [False, True], [3, 7]])
def test_a_classifier_comes_back(classes, tmp_path):
    labels = np.array(classes)[(DATA.X[:, 0] > 0).astype(int)]
    model = PolynomialSurfaceClassifier(degree=1).fit(DATA.X, labels)
    same = there_and_back(model, tmp_path)
    np.testing.assert_array_equal(same.predict(DATA.X), model.predict(DATA.X))
    np.testing.assert_array_equal(same.predict_proba(DATA.X), model.predict_proba(DATA.X))
    assert same.equations() == model.equations() and same.status_ is model.status_


def test_three_modes_in_pairs_come_back(tmp_path):
    sector = np.floor(3.0 * (np.arctan2(*DATA.X.T) / (2.0 * np.pi) + 0.5)).clip(0, 2)
    model = PolynomialSurfaceClassifier(1, mode_book="pairwise").fit(DATA.X, sector)
    same = there_and_back(model, tmp_path)
    np.testing.assert_array_equal(same.decision_function(DATA.X), model.decision_function(DATA.X))
    np.testing.assert_array_equal(same.predict_proba(DATA.X), model.predict_proba(DATA.X))


def test_a_pipeline_and_names_come_back(tmp_path):
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame(DATA.X, columns=["angle", "rate"])
    model = SwitchingSystemRegressor(2, random_state=0).fit(frame, DATA.Xdot)
    same = there_and_back(model, tmp_path)
    assert same.equations() == model.equations() and "angle" in same.equations()[0]
    assert same.recording_.names == ["angle", "rate"]
    with pytest.raises(ValueError, match="feature names"):
        same.predict(frame[["rate", "angle"]])
    affine = SwitchingSystemRegressor(2, feature_library=1, random_state=0)
    line = make_pipeline(StandardScaler(), affine)
    line.fit(frame, DATA.Xdot)
    np.testing.assert_array_equal(
        there_and_back(line, tmp_path).predict(frame), line.predict(frame)
    )


def test_what_was_recorded_stays_with_the_model(tmp_path):
    recording = Recording(
        "runs.csv", ["x", "v"], {"x": "m"}, {"method": "savitzky_golay", "window": 11}
    )
    model = SwitchingSystemRegressor(2, random_state=0).fit(DATA.X, DATA.Xdot)
    same = there_and_back(model, tmp_path, recording=recording)
    assert same.recording_ == recording
    assert there_and_back(same, tmp_path).recording_ == recording
    content = json.loads((tmp_path / "model.json").read_text(encoding="utf-8"))
    assert content["written_by"]["swsysid"] == swsysid.__version__
    assert content["recording"]["smoothing"]["window"] == 11
    assert content["equations"][0].startswith("mode 0: x0' = 1.000000 x1")
    assert content["surface_equations"][0].startswith("f0(x0, x1) = ")


# -- effects ---------------------------------------------------------------------------------------


def test_effects_that_were_found_are_inside_the_laws(tmp_path):
    data = make_undeclared("coulomb_friction", n_samples=1000, random_state=0)
    search = EffectSearchCV(data.estimator, effects=[CoulombFriction()])
    search.fit(data.X, data.Xdot, t=data.t, groups=data.groups)
    again = there_and_back(search, tmp_path)
    assert again.report_.to_dict() == search.report_.to_dict()
    assert again.equations() == search.equations()
    model = search.best_estimator_
    same = there_and_back(model, tmp_path)
    assert same.equations() == model.equations()
    assert any("sign(x1)" in law for law in same.equations())
    seen = {"t": data.t, "groups": data.groups}
    np.testing.assert_array_equal(same.predict(data.X, **seen), model.predict(data.X, **seen))
    t, inputs = data.t[:50], data.X[:50, 2:]
    rolled = [each.simulate(data.X[0, :2], t, inputs) for each in (model, same)]
    np.testing.assert_array_equal(rolled[0].x, rolled[1].x)


def adopted(fit, names):
    model = EffectRegressor(fit.estimator, fit.terms)
    model.n_features_in_, model._one_target, model._n_targets = len(names), False, len(names)
    return model._adopt(fit, names)


def test_every_effect_of_the_library_can_be_in_a_file():
    for effect in [*all_effects(), *special_effects()]:
        placed = PlacedEffect(effect, place=(0, 1), target=0, theta=(0.1 + 0.2,))
        same = read_objects(json.loads(json.dumps(write_objects(placed))))
        assert type(same.effect) is type(effect) and repr(same) == repr(placed)


def test_a_guard_with_memory_comes_back(tmp_path):
    fit, _ = relay(-0.5, 0.5)
    model = adopted(fit, ("T",))
    same = there_and_back(model, tmp_path)
    assert same.surface_equations() == model.surface_equations()
    t = np.linspace(0.0, 6.0, 61)
    trajectories = [each.simulate([0.0], t) for each in (model, same)]
    np.testing.assert_array_equal(trajectories[0].x, trajectories[1].x)


def test_an_effect_that_needs_times_is_saved_without_a_probe(tmp_path):
    delay = PlacedEffect(Delay(), place=2, target=1, theta=(0.1,))
    there_and_back(adopted(fit_by_hand(MASS, [delay], [np.ones(1)]), ("x", "v", "u")), tmp_path)
    assert json.loads((tmp_path / "model.json").read_text(encoding="utf-8"))["probe"] is None


# -- what cannot be saved --------------------------------------------------------------------------


class OwnLibrary(PolynomialFeatures):
    pass


class OwnEffect(Effect):
    kind = "own"


UNSAVABLE = {
    "feature_library.functions[1] is the function <lambda>": {
        "feature_library": FunctionLibrary([np.sin, lambda x: x**3])
    },
    "feature_library is an object of the class OwnLibrary": {"feature_library": OwnLibrary(2)},
    "feature_library.func is the function with_cube_roots": {
        "feature_library": FunctionTransformer()
    },
}


def with_cube_roots(X):
    return np.column_stack([X, np.cbrt(X)])


@pytest.mark.parametrize("part", UNSAVABLE)
def test_code_is_refused_by_the_name_of_the_part(part, tmp_path):
    parameters = UNSAVABLE[part]
    if "func is" in part:
        parameters["feature_library"].set_params(func=with_cube_roots)
    model = SwitchingSystemRegressor(2, random_state=0, **parameters).fit(DATA.X, DATA.Xdot)
    with pytest.raises(TypeError, match=re.escape(part)) as caught:
        save_model(model, tmp_path / "model.json")
    assert "numpy.sin" in str(caught.value) and str(caught.value).count(". ") == 0
    assert not (tmp_path / "model.json").exists()


def test_an_effect_of_a_user_is_refused(tmp_path):
    placed = PlacedEffect(OwnEffect(), place=0, target=0)
    model = adopted(fit_by_hand(MASS, [placed], [np.zeros(1)]), ("x", "v", "u"))
    with pytest.raises(TypeError, match=r"effects\[0\].effect is an object of the class OwnEffect"):
        save_model(model, tmp_path / "model.json")


def test_what_is_no_fitted_model_is_refused(tmp_path):
    with pytest.raises(TypeError, match="Ridge is not a model that save_model knows"):
        save_model(Ridge().fit(DATA.X, DATA.Xdot), tmp_path / "model.json")
    with pytest.raises(ValueError, match="not fitted"):
        save_model(SwitchingSystemRegressor(), tmp_path / "model.json")


# -- what is not loaded ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    path = tmp_path_factory.mktemp("written") / "model.json"
    model = SwitchingSystemRegressor(2, random_state=0).fit(DATA.X, DATA.Xdot)
    save_model(model, path)
    return path.read_text(encoding="utf-8")


def with_checksum(content):
    """A file as a forger would write it: the checksum fits."""
    rest = {key: value for key, value in content.items() if key != "checksum"}
    text = json.dumps(rest, sort_keys=True, separators=(",", ":"))
    return json.dumps(rest | {"checksum": hashlib.sha256(text.encode()).hexdigest()})


def objects(*entries):
    return lambda content: content | {"objects": list(entries)}


def state(**changes):
    def forged(content):
        *parts, last = content["objects"]
        return content | {"objects": [*parts, last | {"state": last["state"] | changes}]}

    return forged


FORGED = {
    "no model of swsysid": objects({"class": "StandardScaler", "state": {}}),
    "does not hold a model": objects({"class": "os.system", "state": {"command": "true"}}),
    "'builtins.eval'": objects({"class": "builtins.eval", "state": {}}),
    "0 is no place|list index": objects({"class": "Guard", "state": {"terms": {"object": 0}}}),
    "-1 is no place": objects({"class": "Guard", "state": {"terms": {"object": -1}}}),
    "numpy has no function of arrays called load": state(coef_={"ufunc": "load"}),
    "has no attribute predict": state(predict={"ufunc": "sin"}),
    "the type O": state(coef_={"bytes": "gASVAAAA", "type": "O", "shape": [1]}),
    "buffer size|reshape": state(coef_={"bytes": "AAAA", "type": "<f8", "shape": [2, 2, 2]}),
    "the shape": state(coef_={"array": [1.0], "type": "<f8", "shape": [-1]}),
    "'pickle'": state(coef_={"pickle": "gASVAAAA"}),
    "KeyError|'state'|does not hold": objects({"class": "Guard"}),
    "holds a PolynomialFeatures": objects(
        {"class": "sklearn.PolynomialFeatures", "state": {"degree": 2}}
    ),
}


@pytest.mark.parametrize("reason", FORGED)
def test_a_forged_file_is_refused_and_runs_nothing(reason, written, tmp_path):
    path = tmp_path / "forged.json"
    path.write_text(with_checksum(FORGED[reason](json.loads(written))), encoding="utf-8")
    with pytest.raises(ValueError, match="does not hold a model|is no model") as caught:
        load_model(path)
    assert "\n" not in str(caught.value)


def test_a_file_of_something_else_is_refused(written, tmp_path):
    path = tmp_path / "other"
    for content in (
        pickle.dumps({"a": 1}),
        b"",
        b"[1, 2]",
        b'{"format": "swsysid model", "format_version": 1, "probe": NaN}',
        b"[" * 100_000,
        written[: len(written) // 2].encode(),
        written.encode("utf-16"),
    ):
        path.write_bytes(content)
        with pytest.raises(ValueError, match=r"is no model file of swsysid; write one with save"):
            load_model(path)
    with pytest.raises(FileNotFoundError):
        load_model(tmp_path / "absent.json")


def test_a_damaged_file_is_refused(written, tmp_path):
    path = tmp_path / "damaged.json"
    generator = np.random.default_rng(0)
    digits = [place for place, letter in enumerate(written) if letter in "123456789"]
    for place in generator.choice(digits, 40):
        turned = str(int(written[place]) % 9 + 1)
        damaged = written[:place] + turned + written[place + 1 :]
        # the seventeenth digit of a number may say no more than the sixteen before it
        if json.loads(damaged) == json.loads(written):
            continue
        path.write_text(damaged, encoding="utf-8")
        with pytest.raises(ValueError, match="damaged or was edited|is in format"):
            load_model(path)


def test_a_newer_file_is_refused(written, tmp_path):
    path = tmp_path / "newer.json"
    content = json.loads(written) | {"format_version": 2}
    path.write_text(with_checksum(content), encoding="utf-8")
    with pytest.raises(ValueError, match="is in format 2 and this version .* up to 1; update"):
        load_model(path)


def test_a_model_that_predicts_otherwise_here_is_refused(written, tmp_path):
    path = tmp_path / "otherwise.json"
    content = json.loads(written)
    content["probe"][0] += 1e-6
    path.write_text(with_checksum(content), encoding="utf-8")
    with pytest.raises(ValueError, match="predicts other velocities here .* scikit-learn"):
        load_model(path)


@pytest.mark.parametrize("path", WRITTEN, ids=lambda path: path.stem)
def test_a_file_of_every_version_is_still_read(path):
    model = load_model(path)
    assert model.recording_.source == "the damped oscillator"
    # planted: damping 0.5 left of x0 = 0, 0.1 right of it
    velocities = model.predict([[-1.0, 1.0], [1.0, 1.0]])
    np.testing.assert_allclose(velocities, [[1.0, 0.5], [1.0, -1.1]], atol=1e-9)
    sides = model.predict_mode_proba([[-1.0, 1.0], [1.0, 1.0]]).argmax(axis=1)
    np.testing.assert_array_equal(sides, model.predict_modes([[-1.0, 1.0], [1.0, 1.0]]))
    assert set(sides) == {0, 1}


def test_reading_uses_nothing_that_runs_code():
    package = Path(swsysid.__file__).parent
    for path in (package / "_saving").glob("*.py"):
        source = path.read_text(encoding="utf-8")
        assert not re.search(r"^\s*(import|from) (pickle|joblib|marshal|shelve)", source, re.M)
        assert not re.search(r"\b(eval|exec|compile|__import__)\(", source)
