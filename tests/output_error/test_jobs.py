"""Candidates that are tried at a time say what they say one by one, also where work goes on."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from swsysid import EffectSearchCV, SwitchingSystemRegressor
from swsysid.effects import Bias, Delay, QuadraticDrag


@pytest.fixture(scope="module")
def recording():
    """x' = -.3 x - .5 |x| x + u, noise .01, u a new value every second."""
    rng = np.random.default_rng(3)
    t, u = 0.1 * np.arange(500), np.repeat(rng.uniform(-2.0, 2.0, 50), 10)

    def rate(now, x):
        return -0.3 * x - 0.5 * np.abs(x) * x + u[min(int(now / 0.1 + 1e-9), 499)]

    states = solve_ivp(rate, (0.0, t[-1]), [0.0], t_eval=t, max_step=0.05, rtol=1e-8).y.T
    return {"t": t, "x": states + 0.01 * rng.standard_normal(states.shape), "inputs": u[:, None]}


def found(recording, **options):
    """The search with one declared linear law."""
    declared = SwitchingSystemRegressor(1, feature_library=1, random_state=0)
    library = [Bias(), QuadraticDrag(), Delay()]
    search = EffectSearchCV(declared, effects=library, input_hold="zero", **options)
    return search.fit([recording])


def test_two_jobs_find_what_one_finds_and_go_on_from_each_other(recording, tmp_path):
    one = found(recording)
    two = found(recording, n_jobs=2, checkpoint=tmp_path)
    steps = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()}
    again = found(recording, checkpoint=tmp_path)
    assert [effect.kind for effect in one.effects_] == ["quadratic_drag"]
    (size,) = one.effects_[0].parameters.values()
    assert abs(size - 0.5) < 0.02  # four standard errors
    for other in (two, again):
        assert other.effects_[0].parameters == one.effects_[0].parameters
        assert other.report_.errors == one.report_.errors
    kept = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()}
    worked = {path for path in kept if kept[path] != steps.get(path)}
    assert not [path for path in worked if "tried" in path.name or "fitted" in path.name]
