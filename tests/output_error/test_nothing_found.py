"""What is said where no effect is found."""

import re

import numpy as np
import pytest
from scipy.signal import lsim

from swsysid import EffectSearchCV, SwitchingSystemRegressor
from swsysid._data.records import make_records
from swsysid._effect_search.folds import split_records
from swsysid.effects import CoulombFriction, Polynomial, QuadraticDrag, TimeInterval

NOISE = 0.5


def test_velocities_may_leave_more_than_rollouts_do():
    """A lag of two samples, of an input that jumps: what smooths velocities blurs the jumps."""
    t, rng, lag = 0.005 * np.arange(400), np.random.default_rng(0), 0.01
    recordings = []
    for _ in range(6):
        u = 100.0 * np.repeat(rng.uniform(-1.0, 1.0, 8), 50)
        _, x, _ = lsim(([1.0], [lag, 1.0]), u, t, interp=True)
        x = x + NOISE * rng.standard_normal(len(t))
        recordings.append({"t": t, "x": x[:, None], "inputs": u[:, None]})
    declared = SwitchingSystemRegressor(1, feature_library=1, random_state=0)
    report = EffectSearchCV(declared, effects=[CoulombFriction()]).fit(recordings).report_
    assert "free rollouts of the model leave nothing but noise, but velocities" in report.summary
    assert report.errors[0]["held_out"][0] == pytest.approx(NOISE, rel=0.1)
    assert not report.residual_before.clean


def test_the_law_that_lacks_nothing_is_told():
    """v' = 1 + 2 u - v / 2 and noise, no friction."""
    t, rng = 0.02 * np.arange(600), np.random.default_rng(0)
    u = np.repeat(rng.uniform(-2.0, 2.0, 12), 50)
    _, v, _ = lsim(([1.0], [1.0, 0.5]), 1.0 + 2.0 * u, t)
    v += 0.01 * rng.standard_normal(len(v))
    declared = SwitchingSystemRegressor(1, feature_library=1, random_state=0)
    search = EffectSearchCV(declared, effects=[CoulombFriction()])
    report = search.fit(v[:, None], t=t, inputs=u[:, None]).report_
    assert report.clean
    [told] = re.findall(r"^law: +x0' = (.*)$", str(report), re.MULTILINE)
    terms = re.findall(r"([+-]?) ?(\d[.\d]*)( x\d| u\d)?", told)
    found = {name.strip(): float(sign + size) for sign, size, name in terms}
    # their standard errors are about .002
    assert found == pytest.approx({"": 1.0, "x0": -0.5, "x1": 2.0}, abs=0.02)


def test_what_chance_may_explain_is_told_with_how_much_more_would_tell():
    """v' = u - .5 v - .3 v |v|, asked for certainty that so short a record cannot give."""
    rng, step = np.random.default_rng(0), 0.02
    u, v = np.repeat(rng.uniform(-2.0, 2.0, 12), 50), np.zeros(600)
    for k in range(len(v) - 1):
        v[k + 1] = v[k] + step * (u[k] - 0.5 * v[k] - 0.3 * v[k] * abs(v[k]))
    v += 0.01 * rng.standard_normal(len(v))
    declared = SwitchingSystemRegressor(1, feature_library=1, random_state=0)

    def asked(significance):
        search = EffectSearchCV(
            declared, effects=[QuadraticDrag()], significance=significance, input_hold="zero"
        )
        return search.fit(v[:, None], t=step * np.arange(len(v)), inputs=u[:, None])

    found, most = asked(0.01), 1e-300
    assert [effect.kind for effect in found.effects_] == ["quadratic_drag"]
    assert found.report_.unsure is None
    report = asked(most).report_
    near = report.unsure
    assert not report.effects
    assert near["effect"] == "quadratic drag of x0 in x0'"
    nats = np.log(2.0) - np.log(near["p_value"])  # of one kind and place, by two disturbances
    assert near["longer"] == pytest.approx(1.0 + (np.log(near["p_value"]) - np.log(most)) / nats)
    assert 0.5 < near["share"] < 1.0
    assert report.summary.startswith("No effect is sure. Nearest is quadratic drag of x0 in x0'")


def test_what_the_held_out_rows_speak_against_is_said_and_not_kept():
    """v' = u - .5 v - .3 v |v| where the search looks, + .3 v |v| in what it holds out."""
    rng, step, n = np.random.default_rng(0), 0.02, 1200
    u, v, t = np.repeat(rng.uniform(-1.0, 1.0, n // 50), 50), np.zeros(n), step * np.arange(n)
    records = make_records(v[:, None], 1, t=t, names=["v"])
    split = split_records(records, np.random.RandomState(0))
    drag = np.where(np.isin(np.arange(n), split.held_out), 0.3, -0.3)
    for k in range(n - 1):
        v[k + 1] = v[k] + step * (u[k] - 0.5 * v[k] + drag[k] * v[k] * abs(v[k]))
    v += 0.002 * rng.standard_normal(n)
    declared = SwitchingSystemRegressor(1, feature_library=1, random_state=0)
    search = EffectSearchCV(declared, effects=[QuadraticDrag()], input_hold="zero")
    report = search.fit(v[:, None], t=t, inputs=u[:, None]).report_
    assert not report.effects
    assert report.unsure["longer"] == 1.0 and report.unsure["p_value"] < 1e-4
    assert report.summary.startswith("No effect is sure. Nearest is quadratic drag of x0 in x0'")
    assert "what was held out speaks against it" in report.summary


def test_a_longer_record_is_no_promise_of_what_the_evidence_is_against():
    """A curve beneath what drifts as much: more of it would speak for no monomial."""
    rng, n = np.random.default_rng(1), 800
    u = np.repeat(rng.integers(-1, 2, n // 20), 20).astype(float)
    level, drift, steps = np.linspace(1.0, 0.0, n), np.zeros(n), rng.standard_normal(n)
    for k in range(1, n):
        drift[k] = 0.98 * drift[k - 1] + 0.002 * steps[k]
    y = 3.0 + 0.2 * u + 0.8 * level + 0.15 * (level - 0.5) ** 2 + drift
    y += 0.002 * rng.standard_normal(n)
    declared = SwitchingSystemRegressor(1, feature_library=1, random_state=0)
    search = EffectSearchCV(declared, effects=[TimeInterval(), Polynomial()])
    report = search.fit(np.column_stack([u, level]), y, t=np.arange(float(n))).report_
    assert not report.effects and report.unsure is None
    assert "more of such a record" not in report.summary
