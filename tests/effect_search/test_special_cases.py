"""A kind that another one becomes where a gain vanishes, and where that other one is the answer."""

from types import SimpleNamespace

import numpy as np
import pytest

from swsysid import EffectSearchCV, SwitchingSystemRegressor
from swsysid._effect_search.acceptance import simplest
from swsysid._effect_search.candidates import Trial
from swsysid._effect_search.settings import SETTINGS
from swsysid.effects import DeadZone, GainChange, PlacedEffect, Polynomial, Saturation

LIBRARY = [DeadZone(), Saturation(), GainChange(), Polynomial()]


@pytest.mark.parametrize(
    ("inner", "outer", "kind"),
    [
        (1.0, 0.0, "saturation"),
        (0.0, 1.0, "dead_zone"),
        (1.0, 0.4, "gain_change"),
        (0.4, 1.0, "gain_change"),
    ],
)
def test_a_gain_that_is_none_has_its_own_name(inner, outer, kind):
    """``v' = -v + g(u)``, whose gain is `inner` up to a threshold of .6 and `outer` beyond it."""
    rng, t = np.random.default_rng(0), 0.05 * np.arange(1200)
    u = np.sin(0.9 * t) + 0.6 * np.sin(2.3 * t + 1.0)
    v = rng.uniform(-1.0, 1.0, len(t))
    beyond = u - np.clip(u, -0.6, 0.6)
    pull = inner * (u - beyond) + outer * beyond - v
    Xdot = pull + 0.02 * rng.standard_normal(len(t))
    declared = SwitchingSystemRegressor(1, feature_library=1, random_state=0)
    search = EffectSearchCV(declared, effects=LIBRARY)
    (found,) = search.fit(np.column_stack([v, u]), Xdot[:, None], t=t).effects_
    assert found.kind == kind
    assert found.parameters["threshold"] == pytest.approx(0.6, rel=0.05)


def trial(effect, place=2, target=1):
    placed = PlacedEffect(effect, place, target, theta=(0.6,))
    return Trial(placed, np.zeros(1), np.zeros((1, 1)), (0,))


def beside(*gains):
    """Candidates of which none is within a standard error of the first, with their gains."""
    told = {}

    def gains_of(trials):
        return np.array([[told[id(one)]] for one in trials])

    def knowing(trials):
        told.update(zip(map(id, trials), gains, strict=True))
        return SimpleNamespace(
            level_with=lambda best, trials: {0: 0.0},
            gains=gains_of,
            data=SimpleNamespace(settings=SETTINGS),
        )

    return knowing


@pytest.mark.parametrize(
    ("effect", "options", "gain", "taken"),
    [
        (Saturation(), {}, 996.0, True),
        (DeadZone(), {}, 996.0, True),
        (Saturation(), {}, 994.0, False),  # more than a trifle
        (Polynomial(), {}, 999.0, False),  # no special case
        (Saturation(), {"place": 0}, 999.0, False),
        (Saturation(), {"target": 0}, 999.0, False),
    ],
)
def test_a_special_case_is_taken_that_explains_all_but_a_trifle(effect, options, gain, taken):
    top = [trial(GainChange()), trial(effect, **options)]
    assert simplest(beside(1000.0, gain)(top), top) is top[int(taken)]
