"""Feature maps, the function library, and the printing of combinations of features."""

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.compose import ColumnTransformer
from sklearn.pipeline import FeatureUnion, make_pipeline
from sklearn.preprocessing import FunctionTransformer, PolynomialFeatures, StandardScaler

from swsysid import FunctionLibrary
from swsysid._data.features import FeatureMap, Monomials
from swsysid._rendering.printing import check_format, linear_combination, rate, symbol

X = np.array([[1.0, 2.0], [3.0, -4.0]])


def test_none_is_the_identity():
    feature_map = FeatureMap(None, X, ["x", "v"])
    assert np.array_equal(feature_map(X), X)
    assert list(feature_map.names_out) == ["x", "v"]


def test_degree_is_all_monomials():
    feature_map = FeatureMap(2, X, ["x", "v"])
    expected = [[1, 1, 2, 1, 2, 4], [1, 3, -4, 9, -12, 16]]
    assert np.array_equal(feature_map(X), np.array(expected, dtype=float))
    assert list(feature_map.names_out) == ["1", "x", "v", "x^2", "x v", "v^2"]


def test_monomials_of_some_columns_are_known_as_such():
    """A law of the second column: 1, v, v^2 by hand, and no pipeline's checks at a point."""
    chosen = ColumnTransformer([("chosen", "passthrough", [1])])
    feature_map = FeatureMap(make_pipeline(chosen, PolynomialFeatures(2)), X, ["x", "v"])
    assert feature_map.powers.tolist() == [[0, 0], [0, 1], [0, 2]]
    assert feature_map.at(X[1]).tolist() == [1.0, -4.0, 16.0]
    assert feature_map(X).tolist() == [[1.0, 2.0, 4.0], [1.0, -4.0, 16.0]]


def test_monomials_of_changed_columns_are_none_of_the_columns():
    scaled = make_pipeline(StandardScaler(), PolynomialFeatures(2))
    assert FeatureMap(scaled, X, ["x", "v"]).powers is None
    part = ColumnTransformer([("scaled", StandardScaler(), [1])])
    assert FeatureMap(make_pipeline(part, PolynomialFeatures(2)), X, ["x", "v"]).powers is None


def test_given_library_is_not_fitted_in_place():
    library = PolynomialFeatures(2)
    FeatureMap(library, X, ["x", "v"])
    assert not hasattr(library, "n_features_in_")


def test_pysindy_arrays_become_plain():
    import pysindy

    feature_map = FeatureMap(pysindy.FourierLibrary(1), X, ["x", "v"])
    features = feature_map(X)
    assert type(features) is np.ndarray
    assert np.allclose(features[:, 0], np.sin(X[:, 0]), atol=1e-15)
    assert list(feature_map.names_out)[:2] == ["sin(1 x)", "cos(1 x)"]


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_features_that_are_not_finite_are_refused(value):
    library = FunctionTransformer(lambda x: np.full_like(x, value))
    with pytest.raises(ValueError, match="NaN or infinite features"):
        FeatureMap(library, X, ["x", "v"])(X)


def test_object_without_transform_is_refused():
    with pytest.raises(TypeError, match="must have fit and transform"):
        FeatureMap("polynomial", X, ["x", "v"])


def test_functions_of_one_and_of_two_columns():
    library = FunctionLibrary([np.square, lambda a, b: a * b, np.arctan2])
    values = library.fit_transform(X)
    expected = np.column_stack([X**2, X[:, 0] * X[:, 1], np.arctan2(X[:, 0], X[:, 1])])
    assert np.allclose(values, expected, atol=1e-15)
    names = library.get_feature_names_out()
    assert list(names) == ["square(x0)", "square(x1)", "f(x0, x1)", "arctan2(x0, x1)"]


def test_functions_at_one_point_are_those_of_its_row():
    class Doubled:
        __hash__ = None  # as an object with its own equality has it

        def __call__(self, x):
            return 2 * x

    functions = [np.square, lambda a, b: a * b, lambda x: 3.0, lambda x, power=2: x**power]
    feature_map = FeatureMap(FunctionLibrary([*functions, Doubled()]), X, ["x", "v"])
    assert np.array_equal([feature_map.at(row) for row in X], feature_map(X))
    expected = [1.0, 4.0, 2.0, 3.0, 3.0, 1.0, 4.0, 2.0, 4.0]
    assert np.array_equal(feature_map.at(X[0]), expected)


def test_rows_of_a_simulation_that_runs_away_have_values_all_the_same():
    library = FunctionLibrary([lambda x: x, lambda x: x**3])
    library_map = FeatureMap(library, np.array([[1.0], [2.0]]), ["x"])
    far = np.array([[3.0], [1e93], [1e200]])
    np.testing.assert_array_equal(
        library_map.at_rows(far), [[3.0, 27.0], [1e93, 1e279], [1e200, np.inf]]
    )
    with pytest.raises(ValueError, match="lost in double precision"):
        library_map.library.transform(far)


def test_one_function_twice_keeps_both_names():
    library = FunctionLibrary([np.sin, np.sin], names=["sin({})", "again({})"]).fit(X[:, :1])
    assert list(library.get_feature_names_out(["x"])) == ["sin(x)", "again(x)"]


def test_constant_function_fills_its_column():
    assert np.array_equal(FunctionLibrary([lambda x: 1.0]).fit_transform(X), np.ones((2, 2)))


def test_function_library_survives_clone_and_repr():
    library = FunctionLibrary([np.sin], names=["sin({})"])
    assert clone(library).functions == [np.sin]
    assert "sin" in repr(library)


def test_pandas_out():
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame(X, columns=["angle", "rate"])
    library = FunctionLibrary([np.sin], names=["sin({})"]).set_output(transform="pandas")
    assert list(library.fit_transform(frame).columns) == ["sin(angle)", "sin(rate)"]


def test_names_must_match_functions():
    with pytest.raises(ValueError, match="2 entries for 1 functions"):
        FunctionLibrary([np.sin], names=["a({})", "b({})"]).fit(X)


def test_small_and_large_coefficients_keep_their_digits():
    assert linear_combination([0.00012346, 123456.789], ["1", "x"]) == "1.235e-4 + 1.235e5 x"
    assert linear_combination([1e-4], ["x"], style="latex") == r"1.000 \cdot 10^{-4} x"


@pytest.mark.parametrize(
    ("functions", "error", "sentence"),
    [
        (np.sin, TypeError, "must be a list of functions"),
        ([], ValueError, "give at least one function"),
        ([np.sin, lambda a, b, c: a], ValueError, r"functions\[1\] takes 3 columns and X has 2"),
        ([lambda: 1.0], ValueError, "takes 0 columns"),
        ([lambda x: x[:1]], ValueError, r"'f\({}\)' returned an array of shape \(1,\)"),
    ],
)
def test_functions_that_do_not_fit_the_columns_get_a_sentence(functions, error, sentence):
    with pytest.raises(error, match=sentence):
        FunctionLibrary(functions).fit(X).transform(X)


def test_several_lambdas_are_told_apart():
    library = FunctionLibrary([lambda x: x, np.sin, lambda x: x**2]).fit(X[:, :1])
    assert list(library.get_feature_names_out(["x"])) == ["f0(x)", "sin(x)", "f2(x)"]


def test_small_coefficients_of_large_features_are_printed():
    # x near 1e-9: the law x' = v beside a cubic term that amounts to a thousandth of it
    text = linear_combination([1.0, 1e15], ["v", "x^3"], sizes=[1e-9, 1e-27])
    assert text == "1.000 v + 1.000e15 x^3"
    assert linear_combination([1.0, 1e-13], ["v", "x"], sizes=[1.0, 1e9]) == "1.000 v + 1.000e-13 x"


@pytest.mark.parametrize("precision", [-1, 2.5, "3"])
def test_precision_is_checked(precision):
    with pytest.raises(ValueError, match="must be an integer, at least 0"):
        linear_combination([1.0], ["x"], precision=precision)


def test_round_off_is_not_printed():
    assert linear_combination([1.0, 1e-13], ["x", "v"]) == "1.000 x"
    assert linear_combination([0.0, 0.0], ["x", "v"]) == "0"


@pytest.mark.parametrize(
    ("name", "latex"),
    [("x0 x1^2", "x_{0} x_{1}^{2}"), ("sin(x1)", "sin(x_{1})"), ("T_box_degC", "T_{box,degC}")],
)
def test_symbols_in_latex(name, latex):
    assert symbol(name, "latex") == latex


@pytest.mark.parametrize(
    ("name", "latex"),
    [
        ("speed_m_per_s", "speed_{m/s}"),
        ("accel_m_per_s2", "accel_{m/s^{2}}"),
        ("v2_m_s", "v_{2,m,s}"),
        ("v_", "v"),
        ("q_rad''", "q_{rad}''"),
        ("q'^2", "q'^{2}"),
        ("speed_m_per_s force^2", r"speed_{m/s} \, force^{2}"),
        ("sin(x1) torque x2", r"sin(x_{1}) \, torque \, x_{2}"),
        ("duty_%", r"duty\%"),
        ("_", r"\_"),
        ("2nd_gear_on", "2nd_{gear,on}"),
        ("sign(v_m_per_s)", r"\operatorname{sign}(v_{m/s})"),
    ],
)
def test_symbols_of_long_names_are_valid_latex(name, latex):
    assert symbol(name, "latex") == latex


@pytest.mark.parametrize(
    ("name", "latex"),
    [
        ("x0", r"\dot{x}_{0}"),
        ("x", r"\dot{x}"),
        ("T_box_degC", r"\dot{T}_{box,degC}"),
        ("q'", "q''"),
        ("speed", r"\frac{d}{dt} speed"),
        ("speed_m_per_s", r"\frac{d}{dt} speed_{m/s}"),
    ],
)
def test_rates_in_latex(name, latex):
    assert rate(name, "latex") == latex
    assert rate(name, "text") == f"{name}'"


def test_format_is_checked():
    with pytest.raises(ValueError, match="choose 'text' or 'latex'"):
        check_format("html")


@pytest.mark.parametrize("n_states", [1, 2, 3])
@pytest.mark.parametrize("degree", [0, 1, 2, 5])
def test_monomials_are_those_of_scikit_learn(n_states, degree):
    X = np.random.default_rng(0).normal(size=(7, n_states))
    expected = PolynomialFeatures(degree).fit_transform(X)
    monomials = Monomials.up_to(degree, n_states)
    np.testing.assert_allclose(monomials(X), expected, rtol=1e-12)
    np.testing.assert_allclose(monomials.at(X[0]), expected[0], rtol=1e-12)


def test_unions_and_pipelines_of_known_steps_are_not_asked_row_by_row(monkeypatch):
    waves = FunctionLibrary([np.sin, np.cos])
    radians = ColumnTransformer([("angle", FunctionLibrary([np.deg2rad], names=["{}"]), [1])])
    library = FeatureUnion(
        [
            ("products", PolynomialFeatures(2)),
            ("waves", make_pipeline(ColumnTransformer([("angle", "passthrough", [0])]), waves)),
            ("of degrees", make_pipeline(radians, waves)),
        ],
        verbose_feature_names_out=False,
    )
    X = np.random.default_rng(0).normal(size=(50, 2))
    features = FeatureMap(library, X, ["q", "degrees"])
    expected = features.library.transform(X)
    monkeypatch.setattr(FeatureUnion, "transform", None)  # nobody asks for it
    np.testing.assert_allclose(features(X), expected, rtol=1e-14)
    np.testing.assert_allclose(features.at(X[0]), expected[0], rtol=1e-14)
