"""Least output error of any plant: derivatives, bounds, and parameters that are tied."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from swsysid._data.recordings import Record
from swsysid._results import Array
from swsysid._stays.laws import Laws
from swsysid._stays.output_error import OutputError, Parts, Sensor
from swsysid._stays.recordings import Recordings
from swsysid._stays.rollouts import along, nowhere

TIMES, STARTS = np.linspace(0.0, 2.0, 21), np.array([[3.0, 1.0], [1.0, 2.0]])


@dataclass(frozen=True)
class Decays:
    """x' = -a x and y' = -b y + .3 x, of which a square and a gain times y are read.

    The parameters are a, b and the gain; with `tied` a and b are one.
    """

    low: float = 0.0
    high: float = np.inf
    tied: bool = False

    @property
    def limits(self) -> tuple[Array, Array]:
        n = 2 if self.tied else 3
        return np.full(n, self.low), np.full(n, self.high)

    @property
    def by_parameters(self) -> Array:
        rates = [[-1.0, 0.0], [-1.0, 0.0]] if self.tied else [[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]
        return np.array([*rates, np.zeros(len(rates[0]))])

    def parts(self, vector: Array) -> Parts:
        a, b, gain = np.insert(vector, 0, vector[0]) if self.tied else vector
        coef = np.array([[[-a, 0.0], [0.3, -b]]])
        free = np.eye(2, dtype=bool)[None]
        laws = Laws(coef, lambda X: X, np.ones(2), free, inside=(np.zeros_like,))
        sensor = Sensor(
            lambda X: np.column_stack([X[:, 0] ** 2, gain * X[:, 1]]),
            [(len(vector) - 1, lambda X: np.column_stack([0.0 * X[:, 0], X[:, 1]]))],
        )
        return Parts(laws, nowhere(np.ones(2)), sensor)


def problem_of(plant: Decays, y: Array) -> OutputError:
    records = [Record(TIMES, np.empty((len(TIMES), 0)), np.empty((len(TIMES), 0)))] * 2
    grid = Recordings.of(records, [np.ones((len(TIMES), 2))] * 2).divided(2).with_long_steps()
    return OutputError(plant, grid, y, np.array([0.5, 2.0]), np.full(2, 1e6))


def closed_form(unknowns: Array) -> Array:
    """What is read at all samples for a, b, gain and both starts."""
    a, b, gain = unknowns[:3]
    read = []
    for x, y in unknowns[3:].reshape(2, 2):
        fast, slow = np.exp(-a * TIMES), np.exp(-b * TIMES)
        apart = 0.3 * x * (TIMES * fast if a == b else (fast - slow) / (b - a))
        read.append(np.column_stack([(x * fast) ** 2, gain * (y * slow + apart)]))
    return np.concatenate(read)


TRUTH = np.array([0.8, 1.3, 1.7, *STARTS.ravel()])
NOISY = closed_form(TRUTH) + 0.05 * np.random.default_rng(0).standard_normal((42, 2))


def fitted(plant: Decays, vector: Array) -> Array:
    problem = problem_of(plant, NOISY)
    found, answer = problem.least(problem.begun(vector, 0.9 * STARTS), 50, 1e-10)
    assert answer.status > 0
    return found.unknowns


def test_derivatives_are_those_of_differences():
    """Of what sensors read, by parameters of laws and sensors and by the starts."""
    problem, vector = problem_of(Decays(), NOISY), np.array([0.7, 1.1, 1.5])
    slopes = problem.begun(vector, STARTS).slopes
    for k in range(5):
        both = []
        for sign in (1.0, -1.0):
            move = 1e-5 * sign * np.eye(5)[k]
            both.append(problem.begun(vector + move[:3], STARTS + move[3:]).misfit)
        np.testing.assert_allclose(slopes[:, k], (both[0] - both[1]) / 2e-5, atol=2e-5)


def test_least_squares_are_those_of_the_closed_form():
    known = least_squares(
        lambda one: ((closed_form(one) - NOISY) / [0.5, 2.0]).ravel(), 0.9 * TRUTH, xtol=1e-12
    )
    # the error of Runge and Kutta's steps of .05
    np.testing.assert_allclose(fitted(Decays(), TRUTH[:3] * 0.7), known.x, atol=2e-5)


def test_a_bound_holds_what_would_pass_it():
    """A gain of at most 1.5 is that, and the others are what least squares make of it."""
    known = least_squares(
        lambda one: ((closed_form(one) - NOISY) / [0.5, 2.0]).ravel(), 0.7 * TRUTH, xtol=1e-12,
        bounds=(-np.inf, np.where(np.arange(7) < 3, 1.5, np.inf)),
    )  # fmt: skip
    found = fitted(Decays(high=1.5), TRUTH[:3] * 0.7)
    assert found[2] == pytest.approx(1.5, abs=1e-6)
    np.testing.assert_allclose(found, known.x, atol=1e-4)


def test_tied_parameters_are_one():
    """Rates that are one: least squares of the closed form in which they are."""
    known = least_squares(
        lambda one: ((closed_form(np.insert(one, 0, one[0])) - NOISY) / [0.5, 2.0]).ravel(),
        0.7 * TRUTH[1:],
        xtol=1e-12,
    )
    np.testing.assert_allclose(fitted(Decays(tied=True), TRUTH[1:3] * 0.7), known.x, atol=2e-5)


def test_a_robust_loss_bends_at_its_scale():
    """Half the square within it, and beyond it the size less half of it."""
    problem = replace(problem_of(Decays(), closed_form(TRUTH)), loss="huber", scale=0.1)
    off = closed_form(TRUTH)
    off[0] += [0.5 * 3.0, 0.0]
    one = replace(problem, y=off).begun(TRUTH[:3], STARTS)
    assert one.problem.value(one) == pytest.approx(0.1 * 3.0 - 0.5 * 0.1**2, abs=1e-4)
    assert one.weight[0] == pytest.approx(0.1 / 3.0, rel=1e-3)
    assert one.weight[1:] == pytest.approx(1.0)


def test_what_goes_on_along_recordings_is_what_steps_say():
    rng = np.random.default_rng(0)
    slopes, right = rng.standard_normal((9, 3, 3)), rng.standard_normal((9, 3, 2))
    slopes[[0, 4]] = 0.0  # where recordings begin
    found = along(slopes, right)
    expected = right.copy()
    for k in range(1, 9):
        expected[k] += slopes[k] @ expected[k - 1]
    np.testing.assert_allclose(found, expected, atol=1e-12)
