"""Levenberg and Marquardt's steps: when they are taken, when they are taken back, when they end."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from swsysid._stays.descent import descended
from swsysid._stays.settings import StaySettings

SETTINGS = StaySettings()


@dataclass(frozen=True)
class Place:
    """How many steps an estimate is away from its start."""

    number: int = 0

    def moved(self, step):
        return Place(self.number + int(step[0]))


class Told:
    """Equations whose values at the places asked for, and whose promises, are told."""

    def __init__(self, values, promises, refused=()):
        self.values, self.promises, self.refused = values, promises, refused
        self.dampings, self.asked = [], []

    def allows(self, estimate):
        return estimate.number not in self.refused

    def normal_equations(self, estimate):
        self.asked.append(estimate.number)
        return Equations(self, estimate.number)


@dataclass(frozen=True)
class Equations:
    told: Told
    number: int

    @property
    def value(self):
        return self.told.values[self.number]

    def step(self, damping):
        self.told.dampings.append(damping)
        return np.ones(1), self.told.promises[self.number]


def walked(values, promises, n_turns=50, refused=(), enough=-np.inf, **options):
    told = Told(values, promises, refused)
    enough = {} if np.isneginf(enough) else {"enough": enough}
    at, value = descended(Place(), told, n_turns, replace(SETTINGS, **options), **enough)
    assert value == values[at.number]
    return at.number, np.array(told.dampings) / SETTINGS.damping, told.asked


def test_damping_falls_where_steps_do_what_they_promise_and_not_else():
    values, promises = [100.0, 60.0, 56.0, 50.0, 50.0], [40.0, 40.0, 8.0, 0.001, 0.0]
    end, dampings, asked = walked(values, promises)
    assert end == 3 and asked == [0, 1, 2, 3]
    # the second gained a tenth of its promise, the third three quarters
    np.testing.assert_allclose(dampings, [1.0, 1 / 3, 1 / 3, 1 / 9])


@pytest.mark.parametrize("n_turns", [1, 2, 3])
def test_so_many_turns_are_taken_and_no_more(n_turns):
    end, dampings, _ = walked(100.0 - 10.0 * np.arange(9), np.full(9, 10.0), n_turns)
    assert end == n_turns == len(dampings)


def test_it_ends_where_a_step_gains_next_to_nothing():
    end, dampings, _ = walked([100.0, 90.0, 90.0 - 0.019, 0.0], np.full(4, 10.0))
    assert end == 2 and len(dampings) == 2


def test_steps_that_raise_the_value_are_followed_and_what_they_lead_to_is_judged():
    end, dampings, _ = walked([100.0, 120.0, 110.0, 80.0, 80.0], [50.0, 50.0, 50.0, 0.0, 0.0])
    assert end == 3 and SETTINGS.most_followed == 2
    np.testing.assert_allclose(dampings, [1.0, 1.0, 1.0, 1 / 3])  # 20 of 50 are a good part


def test_what_leads_nowhere_is_taken_back_and_damped():
    values = [100.0, *np.full(9, 120.0)]
    end, dampings, asked = walked(values, np.full(10, 50.0), most_failures=3)
    assert end == 0
    # two are followed at first; after a failure each is judged at once
    np.testing.assert_allclose(dampings, [1.0, 1.0, 1.0, 30.0, 900.0])
    assert asked == [0, 1, 2, 3, 1, 1]


def test_a_value_that_is_not_finite_is_not_followed():
    _, dampings, asked = walked([100.0, np.inf, 0.0], np.full(3, 50.0), most_failures=2)
    np.testing.assert_allclose(dampings, [1.0, 30.0])
    assert asked == [0, 1, 1]


def test_an_estimate_that_is_not_allowed_is_not_even_asked():
    end, dampings, asked = walked([100.0, 0.0], np.full(2, 50.0), refused=[1], most_failures=2)
    assert end == 0 and asked == [0]
    np.testing.assert_allclose(dampings, [1.0, 30.0])


def test_a_promise_too_small_ends_it_but_not_amid_steps_that_are_followed():
    assert walked([100.0, 90.0, 80.0], [10.0, 0.019, 5.0])[0] == 1
    # the value has risen: what is promised from there is no reason to stay there
    assert walked([100.0, 110.0, 80.0, 80.0], [10.0, 0.001, 0.0, 0.0])[0] == 2


@pytest.mark.parametrize(("promise", "end"), [(4.9, 0), (5.1, 1)])
def test_a_tenth_of_what_is_missing_is_asked_of_a_promise(promise, end):
    assert walked([100.0, 80.0, 80.0], [promise, 0.0, 0.0], enough=50.0)[0] == end
