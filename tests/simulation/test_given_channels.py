"""Channels that a rollout knows beforehand, between their samples; and by which method it steps."""

import numpy as np
import pytest
from switched import Switched

from swsysid._simulation.inputs import Given, refined_grid
from swsysid._simulation.simulate import simulate
from swsysid.effects import Lag, PlacedEffect


@pytest.mark.parametrize(("instants", "added"), [
    ([], []), ([0.5, 1.5], [0.5, 1.5]), ([1.5, 0.5, 0.5], [0.5, 1.5]), ([-1.0, 0.0, 2.0, 3.0], []),
    ([1.0 + 1e-12, 1.0 - 1e-12], []), ([0.5, 0.5 + 1e-12], [0.5]), ([1e-12, 2.0 - 1e-12], []),
], ids=["none", "between", "out of order", "ends and beyond", "at a sample", "twice",
        "at the ends"])  # fmt: skip
def test_instants_between_samples_are_times_of_the_grid(instants, added):
    grid = refined_grid(np.array([0.0, 1.0, 2.0]), np.array(instants))
    assert grid.tolist() == sorted([0.0, 1.0, 2.0, *added])


def test_one_sample_has_nothing_between():
    assert refined_grid(np.array([3.0]), np.array([3.0, 4.0])).tolist() == [3.0]


@pytest.mark.parametrize("linear", [True, False], ids=["linear", "held"])
def test_a_stretch_has_inputs_time_signals_and_what_effects_remember(linear):
    """u = 2, 2, 2 is the lag of itself; of the signal 0, 1, 4 one sees the line or the step."""
    t = np.array([0.0, 1.0, 3.0])
    signals = np.array([[0.0], [1.0], [4.0]])
    term = PlacedEffect(Lag(), place=1, target=0, theta=(0.7,))
    given = Given(1, t, np.full((3, 1), 2.0), signals, linear, [term])
    grid = np.array([0.0, 0.5, 1.0, 3.0])
    stretches = given.stretches(grid)
    assert [end for end, _ in stretches] == [0.5, 1.0, 3.0, 3.0]
    instants = [0.25, 0.75, 2.0, 3.0]
    found = np.array([signal(time) for (_, signal), time in zip(stretches, instants, strict=True)])
    between = [0.25, 0.75, 2.5, 4.0] if linear else [0.0, 0.0, 1.0, 4.0]
    expected = np.column_stack([np.full(4, 2.0), instants, between, np.full(4, 2.0)])
    np.testing.assert_allclose(found, expected, atol=1e-9)  # rounding of an inverse of order 1e6


@pytest.mark.parametrize(("inputs", "method"), [(None, "DOP853"), (np.ones(5), "RK45")])
def test_short_stretches_are_stepped_with_a_low_order(inputs, method):
    """Bit for bit what the method does that is said to be chosen, and not what the other does."""
    system = Switched(lambda x, u, mode: -x + np.sum(u), [lambda x, u: 1.0])
    t = np.linspace(0.0, 4.0, 5)
    named = {one: simulate(system, [0.3], t, inputs, method=one).x for one in ("DOP853", "RK45")}
    auto = simulate(system, [0.3], t, inputs).x
    assert [name for name, x in named.items() if np.array_equal(x, auto)] == [method]
