"""Differentiators that count samples instead of reading the times are told, with their error."""

import re
import warnings

import numpy as np
import pytest
from pysindy.differentiation import FiniteDifference, SINDyDerivative, SmoothedFiniteDifference

from swsysid.differentiation import differentiate

RNG = np.random.default_rng(0)
EVEN = np.linspace(0.0, 10.0, 500)
STEP = EVEN[1]
JITTER = EVEN + RNG.uniform(-0.2, 0.2, 500) * STEP
TWO_RATES = np.concatenate([np.linspace(0.0, 5.0, 400), np.linspace(5.05, 10.0, 100)])
SCATTERED = np.sort(RNG.uniform(0.0, 10.0, 500))

WIDE = SmoothedFiniteDifference(smoother_kws={"window_length": 31, "polyorder": 3})


def _differentiated(times, method, noise=0.0):
    """What is warned of counting, and the error of the derivative of sin(2 t) over its spread."""
    x = np.sin(2.0 * times) + noise * np.random.default_rng(1).standard_normal(len(times))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        _, Xdot, kept, *_ = differentiate(x, times, method=method)
    exact = 2.0 * np.cos(2.0 * kept)
    error = np.sqrt(np.mean((Xdot[:, 0] - exact)[20:-20] ** 2)) / exact.std()
    said = [str(one.message) for one in caught if "counts samples" in str(one.message)]
    return said, error


@pytest.mark.parametrize("method", [SmoothedFiniteDifference(), WIDE], ids=["11", "31"])
@pytest.mark.parametrize("times", [JITTER, TWO_RATES, SCATTERED], ids=["jitter", "rates", "random"])
def test_counting_is_told_with_the_size_of_its_error(times, method):
    (said,), error = _differentiated(times, method)
    told = float(re.search(r"off by (\S+) of the spread", said)[1])
    # measured on a curve through the samples, not on the signal itself
    assert told == pytest.approx(error, rel=0.25)


@pytest.mark.parametrize(
    ("times", "method", "noise"),
    [
        (EVEN, WIDE, 0.0),
        (EVEN + RNG.uniform(-1e-4, 1e-4, 500) * STEP, WIDE, 0.0),  # a clock's rounding
        (JITTER, FiniteDifference(), 0.0),
        (SCATTERED, FiniteDifference(order=4), 1e-3),
        (SCATTERED, SINDyDerivative(kind="savitzky_golay", left=0.3, right=0.3, order=3), 0.02),
        (SCATTERED, SINDyDerivative(kind="spline", s=1e-2), 1e-3),
        # noise is several times what counting adds
        (EVEN + RNG.uniform(-0.05, 0.05, 500) * STEP, SmoothedFiniteDifference(), 0.02),
    ],
)
def test_nothing_is_told_of_those_that_read_the_times_or_where_it_does_not_matter(
    times, method, noise
):
    assert _differentiated(times, method, noise)[0] == []
