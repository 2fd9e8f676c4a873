"""What explains the lesser part of an error is not named."""

from dataclasses import replace

import numpy as np
import pytest

from swsysid import EffectSearchCV, SwitchingSystemRegressor
from swsysid._effect_search.words import NO_NAME, probability
from swsysid.effects import Lag, Polynomial

NOISE = 0.01


@pytest.fixture(scope="module")
def recording():
    """x' = -x - .2 x^3 + .3 u + 1.5 w of a hidden 3 w' = u - w, by Runge and Kutta."""
    rng, step = np.random.default_rng(0), 0.1
    t = step * np.arange(1200)
    u = np.repeat(rng.uniform(-1.0, 1.0, 30), 40)
    states = np.zeros((len(t), 2))
    for k, now in enumerate(u[:-1]):

        def rate(z, now=now):
            return np.array([-z[0] - 0.2 * z[0] ** 3 + 0.3 * now + 1.5 * z[1], (now - z[1]) / 3.0])

        start = states[k]
        first = rate(start)
        second = rate(start + step / 2 * first)
        third = rate(start + step / 2 * second)
        last = rate(start + step * third)
        states[k + 1] = start + step / 6 * (first + 2 * second + 2 * third + last)
    x = states[:, :1] + NOISE * rng.standard_normal((len(t), 1))
    return {"t": t, "x": x, "inputs": u[:, None]}


@pytest.mark.parametrize("library", [[Lag()], [Lag(), Polynomial()]])
def test_a_name_is_given_where_it_explains_more_than_is_left(recording, library):
    declared = SwitchingSystemRegressor(1, feature_library=1, random_state=0)
    search = EffectSearchCV(declared, effects=library, input_hold="zero").fit([recording])
    first, report = search.effects_[0], search.report_
    left = report.errors[-1]["held_out"][0] ** 2 - NOISE**2
    is_minor = first.error_before**2 - first.error_after**2 < left
    assert first.kind == "lag"
    assert is_minor == (len(library) == 1)
    assert bool(first.doubts) == is_minor
    assert ("that these data do not name" in report.summary) == is_minor
    assert f"{first.error_before:.4g}" in report.summary
    if is_minor:  # chance speaks against nothing at all, and not for a name
        assert f"x0' lacks something ({probability(first.p_value)})" in report.summary
        return
    last = replace(report.effects[-1], doubts=(NO_NAME,))
    other = replace(report, effects=(*report.effects[:-1], last))
    assert len(report.effects) == 2 and "(and 1 more effect)" in report.summary
    assert "(and what these data do not name)" in other.summary
    assert f"2. no name, nearest {last.kind}" in str(other)
