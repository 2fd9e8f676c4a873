"""Frames whose rows, or entries, are not what their user takes them for, refused in a sentence."""

import numpy as np
import pandas as pd
import pytest

from swsysid import (
    IdentificationWarning,
    PolynomialSurfaceClassifier,
    SwitchingSystemRegressor,
)

RNG = np.random.default_rng(0)
STATES = pd.DataFrame(RNG.uniform(-1.0, 1.0, (60, 2)), columns=["q", "v"])
RATES = pd.DataFrame(STATES.to_numpy() @ [[0.0, -1.0], [1.0, -0.2]], columns=["dq", "dv"])
DATES = pd.date_range("2026-01-01", periods=60, freq="s", tz="Europe/Berlin")
SPANS = pd.Series(DATES - DATES[0]).astype(object)


def fitted(X, y):
    return SwitchingSystemRegressor(1, random_state=0).fit(X, y)


def test_labels_of_rows_in_another_order_are_no_pairs():
    mixed = RATES.sample(frac=1.0, random_state=0)
    with pytest.raises(ValueError, match=r"same row labels in another order; give y\.loc"):
        fitted(STATES, mixed)
    with pytest.raises(ValueError, match="same row labels"):
        PolynomialSurfaceClassifier().fit(STATES, (mixed["dq"] > 0.0).astype(int))
    sorted_again = fitted(STATES, mixed.loc[STATES.index])
    np.testing.assert_array_equal(sorted_again.coef_, fitted(STATES, RATES).coef_)


def test_rows_of_other_labels_are_pairs_by_their_place():
    # the next state of a map has the label of the row after
    model = SwitchingSystemRegressor(1, discrete_time=True, random_state=0)
    model.fit(STATES[:-1], STATES[1:].rename(columns={"q": "q1", "v": "v1"}))
    assert model.coef_.shape == (1, 2, 2)


@pytest.mark.parametrize(
    ("entries", "words"),
    [
        (DATES, "holds dates; give numbers, such as the seconds since"),
        (SPANS, "holds time spans; give numbers"),
        (pd.array([None, *RNG.uniform(size=59)], dtype="Float64"), "fill them in"),
        (pd.Series([pd.NA, *RNG.uniform(size=59)], dtype=object), "fill them in"),
    ],
    ids=["dates", "spans", "nullable", "objects"],
)
def test_entries_of_pandas_that_are_no_numbers(entries, words):
    with pytest.raises((ValueError, TypeError), match=words):
        fitted(STATES.assign(t=entries), RATES)


def test_velocities_that_do_not_change_divide_by_nothing():
    with np.errstate(divide="raise"), pytest.warns(IdentificationWarning, match="1 of 2 modes"):
        model = SwitchingSystemRegressor(2, feature_library=1, random_state=0)
        model.fit(STATES, np.full((60, 1), 0.3) + np.zeros((60, 2)))
    np.testing.assert_allclose(model.predict(STATES), 0.3, atol=1e-9)
