"""Long recordings begin from an answer to a part of them; equal steps share their derivatives."""

import numpy as np
import pytest

from swsysid._data.recordings import Record
from swsysid._stays.descent import descended
from swsysid._stays.given import Given
from swsysid._stays.laws import Laws
from swsysid._stays.lifted import Estimate, Objective
from swsysid._stays.nodes import Nodes
from swsysid._stays.pieces import part_of
from swsysid._stays.polynomial_laws import AffineLaws
from swsysid._stays.recordings import Recordings
from swsysid._stays.settings import LIMITS, SETTINGS
from swsysid._stays.stays import Stays

POWERS = np.array([[0, 0], [1, 0], [0, 1]])
COEF = np.array([[[0.0, 0.0, 1.0], [-1.0, -1.0, -0.1]], [[0.0, 0.0, 1.0], [0.5, -4.0, -0.1]]])


def affine(columns):
    return np.column_stack([np.ones(len(columns)), columns])


def given(n_samples, n_recordings=1):
    t = 0.1 * np.arange(n_samples)
    records = [Record(t, np.sin(t)[:, None] + k, np.empty((len(t), 0)))
               for k in range(n_recordings)]  # fmt: skip
    rows = [np.arange(n_samples) + k * n_samples for k in range(n_recordings)]
    return Given(records, rows, list(range(n_recordings)), None)


def test_a_part_is_stretches_from_everywhere():
    n_samples = 10 * LIMITS.samples_of_part
    part = part_of(given(n_samples))
    lengths = [len(record.t) for record in part.records]
    assert lengths == [LIMITS.samples_of_part // 10] * 10
    begins = np.array([rows[0] for rows in part.rows])
    assert (np.diff(begins) == LIMITS.samples_of_part).all()
    many = part_of(given(200, 3 * LIMITS.samples_of_part // 200))
    assert len(many.records) == LIMITS.samples_of_part // 200


def test_a_part_of_few_samples_or_of_a_channel_that_rests_there_is_none():
    assert part_of(given(2 * LIMITS.samples_of_part - 1)) is None
    long = given(3 * LIMITS.samples_of_part)
    long.records[0].y[1:] = 1.0
    long.records[0].y[0] = 1.0
    assert part_of(long) is None


def estimate(kind, *more, missing=()):
    t = np.linspace(0.0, 8.0, 81)
    x = np.column_stack([np.cos(t), -np.sin(t)])
    x[list(missing)] = np.nan
    guess = np.column_stack([np.cos(t), -np.sin(t)]) + 0.01
    recordings = Recordings.of([Record(t, x, np.empty((len(t), 0)))], [guess])
    stays = Stays(np.array([0, 1, 0]), np.array([2.04, 5.55]))
    laws = kind(COEF, affine, np.ones(2), np.ones(COEF.shape, dtype=bool), *more)
    return Estimate(laws, Nodes(recordings, [stays]), guess)


@pytest.mark.parametrize("missing", [(), (10, 11, 30)])
@pytest.mark.parametrize("tie", [0.4, 0.0055])
def test_equations_of_equal_steps_are_those_of_any_steps(missing, tie):
    noise, steps = np.full(2, 0.02), []
    for one in (estimate(AffineLaws, POWERS, missing=missing), estimate(Laws, missing=missing)):
        steps.append(Objective(noise, tie).normal_equations(one).step(1e-3))
    # derivatives of other laws are differences, right to about 1e-6
    np.testing.assert_allclose(steps[0][1], steps[1][1], rtol=1e-4)
    size = np.abs(steps[1][0]).max()
    np.testing.assert_allclose(steps[0][0], steps[1][0], atol=1e-3 * size)


def test_a_descent_that_does_not_promise_enough_is_left():
    start, objective = estimate(AffineLaws, POWERS), Objective(np.full(2, 0.02), 0.05)
    _, reached = descended(start, objective, 20, SETTINGS)
    # about where it ends is within reach, a value far below it is not
    assert descended(start, objective, 20, SETTINGS, reached)[1] == reached
    begun = objective.value(start)
    far = descended(start, objective, 20, SETTINGS, -1e3 * begun)[1]
    assert far == pytest.approx(begun, rel=1e-12)
