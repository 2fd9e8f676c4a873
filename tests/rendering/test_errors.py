"""Numbers with their standard errors: as many digits as the errors leave."""

import re

import numpy as np
import pytest

from swsysid._rendering.printing import determined, sum_with_errors, with_error


@pytest.mark.parametrize("value", [22.0, 0.02541, -3.3e-9, 8.1e12, 0.0, 1.0])
@pytest.mark.parametrize("relative", [3.0, 0.4, 1e-2, 1e-5])
def test_what_is_shown_is_off_by_no_more_than_half_the_error(value, relative):
    error = relative * (abs(value) or 1.0)
    shown = with_error(value, error)
    number, told = re.fullmatch(r"(\S+) \((\S+)\)", shown).groups()
    assert abs(float(number) - value) <= 0.5 * error
    assert float(told) == pytest.approx(error, rel=0.5)
    assert len(re.sub(r"e.*|[-.]", "", told).strip("0")) == 1


def test_a_number_that_is_known_to_all_digits_stands_alone():
    assert with_error(22.0, 1e-12) == "22"
    assert with_error(-9.81, 1e-14, signed=True) == "-9.81"
    assert with_error(2.0 / 3.0, 1e-12) == "0.666667"


@pytest.mark.parametrize("error", [np.inf, np.nan])
def test_what_nothing_tells_is_not_determined(error):
    assert with_error(1.25, error) == "1.25 (not determined)"
    assert "inf" not in sum_with_errors([1.0, 2.0], [error, 0.0], ["1", "x"])


def test_a_fixed_number_has_its_decimals():
    assert with_error(1.0, 0.0) == "1.000"
    assert with_error(1.0, 0.0, signed=True) == "+1.000"
    assert sum_with_errors([0.0, 0.0], [0.0, 0.0], ["1", "x"]) == "0"


def test_terms_that_are_zero_for_sure_are_left_out():
    told = sum_with_errors([0.0, 2.0, -1.0], [0.0, 0.01, 0.3], ["1", "x", "x v"])
    assert told == "+2.000 (0.01) x -1.00 (0.3) x v"


def test_a_term_that_may_be_as_large_as_the_law_and_none_is_not_determined():
    coef = np.array([[[2.0, 30.0, -0.1]], [[1.0, 0.5, 0.0]]])  # modes, one state, features
    errors = np.array([[[0.1, 40.0, 0.2]], [[0.1, 0.1, 0.0]]])
    shown = determined(coef, errors, np.array([1.0, 1.0, 2.0]))
    np.testing.assert_array_equal(np.isinf(shown), [[[False, True, False]], [[False] * 3]])
    np.testing.assert_array_equal(shown[~np.isinf(shown)], errors[~np.isinf(shown)])


def test_a_constant_far_from_zero_is_determined():
    kelvin = np.array([[[109.0, -0.4]]])
    errors = np.array([[[1.4, 0.005]]])  # the velocity is below 1 everywhere
    np.testing.assert_array_equal(determined(kelvin, errors, np.array([1.0, 273.0])), errors)
