"""A motion sampled in its position alone: at a switch the whole lagged state is made anew."""

import numpy as np
import pytest
from scipy.linalg import expm

from swsysid import HybridAutomatonRegressor

STEP = 0.05
FIELDS = {
    2: [np.array([[0.0, 1.0], [-0.8, -0.5]]), np.array([[0.0, 1.0], [-2.0, -0.5]])],
    3: [np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-stiff, -1.2, -1.5]]) for stiff in (0.8, 2.0)],
}


def recordings(order, count, seed=0):
    """Position, modes and input of a chain of integrators that switches at 1 and back at .2."""
    flows = [expm(STEP * field) for field in FIELDS[order]]
    unit = np.eye(order)[-1]
    driven = [
        np.linalg.solve(field, (flow - np.eye(order)) @ unit)
        for field, flow in zip(FIELDS[order], flows, strict=True)
    ]
    generator, found = np.random.default_rng(seed), []
    for _ in range(count):
        state, mode, positions = generator.uniform(-0.5, 0.5, order), 0, []
        u = np.repeat(generator.uniform(-0.2, 2.5, 20), 30)
        for force in u:
            positions.append(state[0])
            if (mode == 0 and state[0] >= 1.0) or (mode == 1 and state[0] <= 0.2):
                mode = 1 - mode
            state = flows[mode] @ state + driven[mode] * force
        found.append({"t": np.arange(len(u)), "x": np.array(positions)[:, None],
                      "inputs": u[:, None]})  # fmt: skip
    return found


@pytest.mark.parametrize("order", [2, 3])
def test_rollouts_of_unseen_recordings_are_exact(order):
    *seen, unseen = recordings(order, 5)
    found = HybridAutomatonRegressor(2, lags=order - 1, discrete_time=True).fit(seen)
    run = found.simulate(
        unseen["x"][:order],
        unseen["t"],
        unseen["inputs"],
        mode=int(found.modes_[order]),
        input_hold="zero",
    )
    # resets are told to a millionth of a spread; without them positions are off by a hundredth
    assert np.abs(run.x - unseen["x"]).max() < 2e-5
    assert all(one.reset.matrix.shape == (order, order) for one in found.transitions_)
    assert all((one.reset.matrix[0] == np.eye(order)[0]).all() for one in found.transitions_)
    levels = sorted(
        -one.guard.coef[~one.guard.powers.any(axis=1)][0]
        / one.guard.coef[one.guard.powers[:, 0] == 1][0]
        for one in found.transitions_
    )
    # anywhere between two samples, which are up to .04 apart
    np.testing.assert_allclose(levels, [0.2, 1.0], atol=0.02)
    assert "follow none of the laws" not in str(found.report_)


def test_a_state_that_jumps_still_resets_its_newest_row():
    """x[k+1] = .9 x[k] + .05 x[k-1] + .2, taken to .3 where it reaches 2: the newest row jumps."""
    x = [0.0, 0.1]
    for _ in range(400):
        new = 0.9 * x[-1] + 0.05 * x[-2] + 0.2
        x.append(0.3 if new >= 2.0 else new)
    found = HybridAutomatonRegressor(1, lags=1, discrete_time=True).fit(
        np.array(x)[:, None], np.arange(len(x))
    )
    [jump] = found.transitions_
    assert jump.reset.matrix.shape == (1, 1)
    np.testing.assert_allclose([jump.reset.matrix[0, 0], jump.reset.offset[0]], [0.0, 0.3],
                               atol=1e-6)  # fmt: skip
