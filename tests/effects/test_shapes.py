"""Functions without a name: columns that are one at a knot and zero at the others."""

import numpy as np
import pytest
from scipy.interpolate import RBFInterpolator

from swsysid.effects import UnknownFunction


@pytest.mark.parametrize("n_knots", [2, 6, 12])
def test_a_function_of_one_channel_is_the_spline_of_least_curvature(n_knots):
    """Radial functions that SciPy fits are an independent way to it."""
    rng = np.random.default_rng(n_knots)
    knots = rng.permutation(np.cumsum(rng.uniform(0.5, 2.0, n_knots)) - 4.0)
    width, points = np.ptp(knots), np.linspace(-9.0, 25.0, 400)[:, None]
    shape = UnknownFunction((0,), tuple((knot,) for knot in knots.tolist()))
    radial = RBFInterpolator(knots[:, None] / width, np.eye(n_knots), kernel="cubic", degree=1)
    # solved in powers of distances up to the cube of 34: rounding
    np.testing.assert_allclose(shape.basis(points), radial(points / width), atol=1e-8)
    np.testing.assert_allclose(shape.basis(knots[:, None]), np.eye(n_knots), atol=1e-12)


def test_it_goes_on_as_a_straight_line():
    knots = np.array([0.0, 1.0, 2.5, 3.0])
    shape = UnknownFunction((0,), tuple((knot,) for knot in knots.tolist()))
    for beyond in (np.array([-7.0, -2.0, 0.0]), np.array([3.0, 4.0, 90.0])):
        values = shape.basis(beyond[:, None])
        slopes = np.diff(values, axis=0) / np.diff(beyond)[:, None]
        np.testing.assert_allclose(slopes[0], slopes[1], atol=1e-12)
    straight = shape.basis(np.linspace(-5.0, 9.0, 30)[:, None]) @ (2.0 - 3.0 * knots)
    np.testing.assert_allclose(straight, 2.0 - 3.0 * np.linspace(-5.0, 9.0, 30), atol=1e-12)
