"""A force that is built up over a way and forgotten over it: laws of its rate and of itself."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from swsysid import EffectSearchCV, SwitchingSystemRegressor
from swsysid._data.records import make_records
from swsysid.effects import CoulombFriction, DahlFriction, Hysteresis, Polynomial

STEP, STIFFNESS, SLIDING = 0.01, 50.0, 8.0


def damper(seed=0, n_samples=1500, noise=0.1):
    """F' = k v - k |v| F / L in steps of a twentieth: times, velocities and forces."""
    rng = np.random.default_rng(seed)
    t, n_parts = STEP * np.arange(n_samples), 20
    waves = [
        (rng.uniform(0.5, 3.0), rng.uniform(0.3, 2.0), rng.uniform(0.0, 6.0)) for _ in range(4)
    ]
    force, forces = 0.0, []
    for now in t:
        forces.append(force)
        for part in range(n_parts):
            at = now + STEP * part / n_parts
            v = sum(size * np.sin(rate * 2.0 * np.pi * at + phase) for size, rate, phase in waves)
            force += STEP / n_parts * STIFFNESS * (v - abs(v) * force / SLIDING)
    v = sum(size * np.sin(rate * 2.0 * np.pi * t + phase) for size, rate, phase in waves)
    return t, v, np.array(forces) + noise * rng.standard_normal(n_samples)


def plain():
    return SwitchingSystemRegressor(1, feature_library=1, random_state=0)


def test_the_rate_of_a_force_that_forgets_over_a_way():
    t, v, force = damper()
    library = [CoulombFriction(), Hysteresis(), Polynomial()]
    search = EffectSearchCV(plain(), effects=library, max_effects=1)
    search.fit(pd.DataFrame({"F": force}), t=t, inputs=pd.DataFrame({"v": v}))
    [effect] = search.effects_
    assert (effect.kind, effect.place) == ("hysteresis", "|v| F")
    assert effect.parameters["forgetting"] == pytest.approx(STIFFNESS / SLIDING, rel=0.05)
    before, after = (model["held_out"][0] for model in search.report_["errors"])
    assert after < 0.2 * before
    assert any("|v| F" in law for law in search.equations())


def test_the_hysteresis_of_a_force_is_no_saturation():
    t, v, force = damper(1)
    search = EffectSearchCV(plain(), max_effects=1)
    search.fit(pd.DataFrame({"v": v}), pd.Series(force, name="F"), t=t)
    [effect] = search.effects_
    assert (effect.kind, effect.place) == ("dahl_friction", "v")
    assert abs(effect.parameters["friction"]) == pytest.approx(SLIDING, rel=0.05)
    assert effect.parameters["distance"] == pytest.approx(SLIDING / STIFFNESS, rel=0.1)


def test_bristles_are_looked_for_in_forces_and_not_in_motions():
    rng = np.random.default_rng(0)
    X, t = rng.standard_normal((200, 2)), STEP * np.arange(200)
    motion = make_records(X, 1, t=t, names=["v", "u"])
    bristles = DahlFriction(in_motions=False)
    assert bristles.places(motion) == []
    assert DahlFriction().places(motion) == [0]
    force = replace(motion, quantity="F")
    assert bristles.places(force) == DahlFriction().places(force)


def test_an_input_of_one_sign_forgets_nothing():
    rng = np.random.default_rng(0)
    X = np.column_stack([rng.standard_normal(200), rng.uniform(0.1, 1.0, 200)])
    records = make_records(X, 1, t=STEP * np.arange(200), names=["T", "flow"])
    assert Hysteresis().places(records) == []
