"""Rollouts of untouched stretches as judge: cases by hand."""

import numpy as np
import pytest

from swsysid._effect_search.rollouts import are_worse, errors_of_all
from swsysid.diagnosis import Rollout

T = np.arange(5.0)
MEASURED = np.array([[-1.0], [1.0], [-1.0], [1.0], [0.0]])
SPREAD = np.sqrt(0.8)  # of these five values


def rollout(before, after, ended=("", ""), chatters=False):
    """Simulations that are off by a constant."""
    return Rollout("1", T, MEASURED, MEASURED + before, MEASURED - after, ended, chatters)


def test_errors_of_all_are_root_mean_squares_in_spreads():
    before, after = errors_of_all([rollout(0.3, 0.1), rollout(0.1, 0.7)])
    assert before == pytest.approx(np.sqrt(0.05) / SPREAD, rel=1e-12)
    assert after == pytest.approx(np.sqrt(0.25) / SPREAD, rel=1e-12)


@pytest.mark.parametrize(
    ("rollouts", "worse"),
    [
        ([], False),
        ([rollout(0.1, 0.2)], True),
        ([rollout(0.1, 0.2), rollout(0.1, 0.11)], True),
        ([rollout(0.1, 0.2), rollout(0.1, 0.09)], False),  # one is better
        ([rollout(0.1, 0.104), rollout(0.1, 0.102)], False),  # by less than luck
        (
            [rollout(0.2, 0.1, ("", "state limit at 3"))],
            True,
        ),  # it ends early
        ([rollout(0.2, 0.1, ("state limit at 2", "state limit at 3"))], False),
        ([rollout(0.2, 0.1, ("", "switch limit at 3"), True)], False),  # it slides along a surface
        (
            [rollout(0.1, 0.2, ("", "switch limit at 3"), True)],
            True,
        ),  # and is farther from the data
    ],
)
def test_worse_is_each_rollout_and_all_of_them_clearly(rollouts, worse):
    assert are_worse(rollouts) is worse


@pytest.mark.parametrize(
    ("rollouts", "worse"),
    [
        ([rollout(0.1, 0.3), rollout(0.1, 0.09)], True),  # .22 instead of .1
        ([rollout(0.1, 0.11), rollout(0.1, 0.09)], False),  # .1005
        ([], False),
    ],
)
def test_what_is_in_doubt_already_need_not_make_each_rollout_worse(rollouts, worse):
    assert are_worse(rollouts, in_doubt=True) is worse


@pytest.mark.parametrize(
    ("rollouts", "options", "worse"),
    [
        ([rollout(0.1, 0.15)], {"gained": 2.0}, False),  # velocities gain more than rollouts lose
        ([rollout(0.1, 0.15)], {"gained": 1.4}, True),
        ([rollout(0.1, 0.15)], {"gained": 2.0, "in_doubt": True}, True),
        ([rollout(0.1, 0.102)], {"gained": 2.0, "in_doubt": True}, False),
        ([rollout(0.1, 0.102)], {"gained": 2.0, "in_doubt": True, "luck": 0.0}, True),
        ([rollout(0.1, 0.098)], {"gained": 2.0, "in_doubt": True, "luck": 0.0}, False),
        ([rollout(0.1, 0.15, ("", "state limit at 3"))], {"gained": 2.0}, True),
        ([rollout(0.1, 1e8)], {"gained": 7.0}, True),  # a lag of a state rebuilds its derivative
    ],
)
def test_what_velocities_gain_is_weighed_against_what_rollouts_lose(rollouts, options, worse):
    assert are_worse(rollouts, **options) is worse
