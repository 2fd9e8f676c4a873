"""Which recording would tell most."""

import numpy as np
import pytest

from swsysid import SwitchingSystemRegressor, TrajectoryIdentifier
from swsysid.refinement import StatedModel, StatedSurface, suggest_experiment

T = np.linspace(0.0, 6.0, 121)
SOFTER = StatedModel(
    None, [[[0, 1], [-1, -0.1]], [[0, 1], [-4, -0.1]]],
    states=["x", "v"], surface=StatedSurface([[0, 1, 0]], 1),
)  # fmt: skip

DAMPED = StatedModel(
    None, [[[0, 1], [-1, -0.1]], [[0, 1], [-1, -0.5]]],
    states=["x", "v"], surface=StatedSurface([[0.2, 1, 0]], 1),
)  # fmt: skip


def recorded(starts, noise=0.02, seed=0):
    rng = np.random.default_rng(seed)
    runs = [SOFTER.simulate(start, T).x for start in starts]
    return [{"t": T, "x": run + noise * rng.standard_normal(run.shape)} for run in runs]


def test_errors_of_a_decay_by_hand():
    # x = s exp(a t), seen at 0 and T: with its start eliminated T tells (T e)^2 / (1 + e^2) of a,
    # e = exp(a T), in units of the noise
    model, noise = StatedModel(None, [[-1.0]], states=["x"]), 0.01
    times, given = [0.1, 1.3, 5.0], {"t": [0.0, 0.1], "x": np.exp([[0.0], [-0.1]])}
    candidates = [{"t": [0.0, end], "x0": [1.0]} for end in times]
    found = suggest_experiment(model, candidates, given, noise=noise)
    told = [(end * np.exp(-end) / noise) ** 2 / (1.0 + np.exp(-2.0 * end)) for end in times]
    np.testing.assert_allclose(found.before, told[0] ** -0.5, rtol=1e-4)
    np.testing.assert_allclose(found.after[:, 0], (told[0] + np.array(told)) ** -0.5, rtol=1e-4)
    assert found.order.tolist() == np.argsort(told)[::-1].tolist() == [1, 0, 2]
    assert "Record candidate 1" in str(found) and "from 0.15 to 0.029" in str(found)


def by_quotients(starts):
    """Information about coefficients and surface by differences of rollouts, starts eliminated."""
    free = [(0, 0, 1), (0, 1, 0), (0, 1, 1), (1, 0, 1), (1, 1, 0), (1, 1, 1)]
    total = np.zeros((len(free) + 1,) * 2)
    for start in starts:

        def run(unknowns, start=start):
            coef = DAMPED.coef_.copy()
            for place, move in zip(free, unknowns[2:], strict=False):
                coef[place] += move
            surface = StatedSurface([[0.2 + unknowns[-1], 1, 0]], 1)
            plant = StatedModel(None, coef, states=["x", "v"], surface=surface)
            return plant.simulate(start + unknowns[:2], T, rtol=1e-10, atol=1e-10).x.ravel()

        moves = 1e-5 * np.eye(3 + len(free))
        J = np.array([run(move) - run(-move) for move in moves]).T / 2e-5 / 0.01
        of_starts, J = J[:, :2], J[:, 2:]
        J -= of_starts @ np.linalg.lstsq(of_starts, J, rcond=None)[0]
        total += J.T @ J
    return total


def test_errors_are_those_of_difference_quotients():
    begun = np.array([[1.0, 1.0], [-2.0, 0.0]])
    given = [{"t": T, "x": DAMPED.simulate(start, T).x} for start in begun]
    candidates = [{"t": T, "x0": start} for start in ([0.5, 0.0], [3.0, 1.0])]
    found = suggest_experiment(DAMPED, candidates, given, noise=0.01)
    for candidate, after in zip(candidates, found.after, strict=True):
        information = by_quotients([*begun, np.array(candidate["x0"])])
        errors = np.sqrt(np.diag(np.linalg.inv(information)))
        np.testing.assert_allclose(after, errors, rtol=1e-3)  # steps of the engine are 1e-5 off


def test_what_is_asked_about_is_told():
    """The stiffer side is seen by recordings that go there."""
    given = recorded([[1.0, 1.0], [-2.0, 0.0]])
    estimator = SwitchingSystemRegressor(2, feature_library=1, sparsity="auto", random_state=0)
    found = TrajectoryIdentifier(estimator).fit(given)
    short = T[:12]
    candidates = [{"t": short, "x0": [-3.0, 0.0]}, {"t": short, "x0": [3.0, 0.0]}]
    for mode, row in enumerate(found.estimator_.coef_):
        side = suggest_experiment(found, candidates, given, about=f"mode {mode}: x1', x0")
        assert side.best == (1 if row[1, 1] < -2.0 else 0)
        assert side.after[side.best, side.names.index(side.about[0])] < 0.9 * side.before.max()


def test_rivals_are_told_apart_where_they_differ():
    rival = StatedModel(None, [[0, 1], [-1, -0.1]], states=["x", "v"])
    candidates = [{"t": T[:20], "x0": start} for start in ([-3.0, 0.0], [3.0, 0.0])]
    given = recorded([[-1.0, 0.0]])
    given = [{name: part[:40] for name, part in given[0].items()}]  # of the softer side alone
    found = suggest_experiment(SOFTER, candidates, given, rivals=[rival], noise=0.02)
    assert found.best == 1 and found.apart[0] < 1e-4 < 10.0 < found.apart[1]  # a root of rounding
    assert "standard deviations apart" in str(found)


def test_what_makes_no_sense_is_refused():
    given, one = recorded([[1.0, 1.0]]), {"t": T, "x0": [1.0, 0.0]}
    for said, candidates, options in (
        ("candidates is empty", [], {}),
        ("candidate 0 must be a dict with t, x0", [{"t": T}], {}),
        ("there are mode 0: x', v", [one], {"about": "mode 5"}),
    ):
        with pytest.raises(ValueError, match=said):
            suggest_experiment(SOFTER, candidates, given, noise=0.02, **options)
    with pytest.raises(ValueError, match="noise is not known"):
        suggest_experiment(SOFTER, [one], given)
