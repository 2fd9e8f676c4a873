"""One surface beside states that walk: laws are not bent by what pushes the states."""

import numpy as np
import pytest

from swsysid import PolynomialSurfaceClassifier, SwitchingSystemRegressor, TrajectoryIdentifier

STEP, N, PARTS, SENSOR, WALK, STOP = 0.02, 250, 10, 0.005, 0.1, 0.4
LAWS = np.array([[[0.0, 0.0, 1.0], [0.0, -4.0, -0.2]], [[0.0, 0.0, 1.0], [12.0, -34.0, -1.2]]])


def swing(rng, walk):
    """A mass at an elastic stop, pushed at random."""
    x, measured = rng.uniform(-1.5, 1.5, 2), []
    for _ in range(N):
        measured.append(x + SENSOR * rng.standard_normal(2))
        for _ in range(PARTS):
            law = LAWS[int(x[0] > STOP)]
            middle = x + 0.5 * STEP / PARTS * law @ np.append(1.0, x)
            x = x + STEP / PARTS * law @ np.append(1.0, middle)
            x[1] += walk * np.sqrt(STEP / PARTS) * rng.standard_normal()
    return {"t": STEP * np.arange(N), "x": np.array(measured)}


def identified(walk):
    rng = np.random.default_rng(0)
    surface = PolynomialSurfaceClassifier(degree=1)
    laws = SwitchingSystemRegressor(2, feature_library=1, surface=surface, random_state=0)
    return TrajectoryIdentifier(laws, random_state=0).fit([swing(rng, walk) for _ in range(3)])


@pytest.mark.parametrize("walk", [0.0, WALK])
def test_noise_in_the_equation_is_told_from_that_of_the_sensor(walk):
    found = identified(walk)
    assert (np.abs(found.coef_ - LAWS) < 3.5 * found.coef_errors_).all()  # twelve of them
    # a walk of three times the noise of the speed's sensor leaves that to be seen less well
    np.testing.assert_allclose(found.noise_, SENSOR, rtol=0.3 if walk else 0.1)
    [constant, slope, speed] = found.estimator_.surface_.coef_[0]
    assert -constant / slope == pytest.approx(STOP, abs=0.03)
    if walk:
        np.testing.assert_allclose(found.equation_noise_[1], walk * np.sqrt(STEP), rtol=0.15)
        assert found.equation_noise_[0] < 0.1 * SENSOR
        assert "no proof against the laws" in found.report_.advice
    else:
        assert found.equation_noise_ is None
