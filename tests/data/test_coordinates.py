"""Laws in the coordinates of the data, whatever a library makes of its columns first."""

import numpy as np
import pandas as pd
import pytest
from sklearn.compose import ColumnTransformer
from sklearn.decomposition import PCA
from sklearn.pipeline import FeatureUnion, make_pipeline
from sklearn.preprocessing import (
    FunctionTransformer,
    MinMaxScaler,
    PolynomialFeatures,
    PowerTransformer,
    StandardScaler,
)

from swsysid import (
    FunctionLibrary,
    PolynomialSurfaceClassifier,
    SwitchingSystemRegressor,
    TrajectoryIdentifier,
    load_model,
    save_model,
)
from swsysid._data.coordinates import data_polynomials, distinct_names
from swsysid._data.features import FeatureMap

RNG = np.random.default_rng(0)
X = RNG.uniform([2.0, 100.0], [5.0, 104.0], (300, 2))
FRAME = pd.DataFrame(X, columns=["h", "T"])
UPPER = X[:, 0] > 3.5
# h' = 2 - 0.5 h above 3.5 and 1 + h below, T' = 0.01 h T
XDOT = np.column_stack([np.where(UPPER, 2.0 - 0.5 * X[:, 0], 1.0 + X[:, 0]), 0.01 * X.prod(axis=1)])
LAWS = ["T' = 0.0100 h T", "T' = 0.0100 h T", "h' = 1.0000 + 1.0000 h", "h' = 2.0000 - 0.5000 h"]

POLYNOMIAL = {
    "standard": make_pipeline(StandardScaler(), PolynomialFeatures(2)),
    "range": make_pipeline(MinMaxScaler(), PolynomialFeatures(2, include_bias=True)),
    "turned": make_pipeline(StandardScaler(), PCA(), PolynomialFeatures(2)),
    "one of two": make_pipeline(
        ColumnTransformer([("s", StandardScaler(), [1])], remainder="passthrough"),
        PolynomialFeatures(2),
    ),
    "frames": make_pipeline(StandardScaler(), PolynomialFeatures(2)).set_output(transform="pandas"),
    "without names": make_pipeline(StandardScaler(), FunctionTransformer(), PolynomialFeatures(2)),
}


def _fitted(library, **parameters):
    model = SwitchingSystemRegressor(feature_library=library, random_state=0, **parameters)
    return model.fit(FRAME, XDOT)


@pytest.mark.parametrize("library", POLYNOMIAL.values(), ids=POLYNOMIAL)
def test_laws_of_scaled_and_turned_columns_are_those_of_the_data(library):
    laws = [law.partition(": ")[2] for law in _fitted(library).equations(precision=4)]
    assert sorted(laws) == LAWS


def test_they_are_printed_alike_from_a_file(tmp_path):
    model = _fitted(POLYNOMIAL["standard"])
    save_model(model, tmp_path / "model.json")
    assert load_model(tmp_path / "model.json").equations() == model.equations()


def test_surfaces_of_scaled_columns_are_those_of_the_data():
    surface = PolynomialSurfaceClassifier(feature_library=POLYNOMIAL["standard"], standardize=False)
    surface.fit(FRAME, UPPER)
    text, *_ = surface.equations(precision=12)
    terms = [
        part.partition(" ") for part in text.partition(" = ")[2].replace("- ", "+ -").split(" + ")
    ]
    values = {name: float(value) for value, _, name in terms}
    monomials = {"": 1.0, "h": X[:, 0], "T": X[:, 1], "h^2": X[:, 0] ** 2, "h T": X.prod(axis=1)}
    monomials["T^2"] = X[:, 1] ** 2
    printed = sum(value * monomials[name] for name, value in values.items())
    # the sum cancels terms that are thousands of times larger
    np.testing.assert_allclose(printed, surface.surface_values(FRAME)[:, 0], atol=1e-6)


@pytest.mark.parametrize(
    ("library", "names"),
    [
        (
            make_pipeline(StandardScaler(), FunctionLibrary([np.sin])),
            ["sin(z(h))", "sin(z(T))"],
        ),
        (make_pipeline(PowerTransformer(), PolynomialFeatures(1)), ["1", "z(h)", "z(T)"]),
        (
            FeatureUnion(
                [
                    ("own", "passthrough"),
                    ("sin", make_pipeline(StandardScaler(), FunctionLibrary([np.sin]))),
                ],
                verbose_feature_names_out=False,
            ),
            ["h", "T", "sin(h)", "sin(T)"],
        ),
        (make_pipeline("passthrough", PolynomialFeatures(1)), ["1", "h", "T"]),
        (FunctionLibrary([np.sin]), ["sin(h)", "sin(T)"]),
    ],
)
def test_columns_that_a_step_changed_are_told_apart(library, names):
    assert list(FeatureMap(library, X, ["h", "T"]).names_out) == names


def test_names_that_are_so_stay_and_features_in_between_are_no_polynomials():
    box = np.array([[1.0, -1.0], [2.0, 1.0]])
    library = PolynomialFeatures(2).fit(box)
    assert distinct_names(library, ["x", "v"], box) == ["1", "x", "v", "x^2", "x v", "v^2"]
    assert data_polynomials(lambda points: np.abs(points), box) is None
    assert data_polynomials(lambda points: np.sin(points), box) is None
    found = data_polynomials(lambda points: (points[:, :1] - 3.0) ** 2, box)
    assert found.terms(np.eye(1), ["x", "v"], box)[0] == pytest.approx(
        np.array([[9.0, -6.0, 0.0, 1.0, 0.0, 0.0]]), abs=1e-9
    )


@pytest.mark.nightly
def test_a_report_of_recordings_tells_scaled_columns_from_the_data():
    t = np.arange(0.0, 12.0, 0.05)
    x = 300.0 + 5.0 * np.exp(-0.3 * t) + 0.01 * RNG.standard_normal(len(t))
    scaled = make_pipeline(StandardScaler(), PolynomialFeatures(1))
    model = SwitchingSystemRegressor(1, feature_library=scaled, random_state=0)
    found = TrajectoryIdentifier(model).fit(pd.DataFrame({"T": x}), t)
    assert "z(T)" in "\n".join(found.report_.laws)
    assert "T' = 90" in found.estimator_.equations(precision=0)[0].replace("89", "90")
