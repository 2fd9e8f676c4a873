"""Weak form: exact sums, planted truths where derivatives are biased, and switches."""

import numpy as np
import pytest

from swsysid import SwitchingSystemRegressor
from swsysid.differentiation import differentiate
from swsysid.refinement import StatedModel, StatedSurface
from swsysid.weak_form import weak_form, weak_refit

OSCILLATOR = np.array([[0.0, 1.0], [-1.0, -0.1]])


def _spiral(times, start=(1.0, 0.0)):
    model = StatedModel(None, OSCILLATOR, states=["q", "v"])
    return model.simulate(start, times).x


def _regress(features, targets):
    return np.linalg.lstsq(features, targets, rcond=None)[0].T


def test_straight_lines_and_constants_are_exact_on_any_times():
    t = np.sort(np.random.default_rng(0).uniform(0.0, 5.0, 40))
    rows = weak_form(2.0 - 3.0 * t, t, feature_library=1, window=9)
    np.testing.assert_allclose(rows.targets, -3.0, rtol=1e-10)
    np.testing.assert_allclose(rows.features[:, 0], 1.0, rtol=1e-12)
    assert rows.features.shape == (32, 2) and (np.diff(rows.t) > 0).all()


@pytest.mark.parametrize(("per_period", "bound"), [(6, 2e-3), (8, 5e-4), (12, 3e-4)])
def test_coarse_samples_without_noise(per_period, bound):
    t = np.arange(8 * per_period) * 2 * np.pi / per_period
    x = _spiral(t)
    rows = weak_form(x, t)
    error = np.abs(_regress(rows.features, rows.targets) - OSCILLATOR).max()
    D = differentiate(x, t, method="finite_difference")
    biased = np.abs(_regress(D.X, D.Xdot) - OSCILLATOR).max()
    assert error < bound
    assert biased > 30 * error and biased > 0.03


def test_coarse_noisy_samples():
    """Eight samples a period, 3 % noise, ten draws: derivatives are 6 to 10 % off, integrals 1."""
    t = np.arange(64) * 2 * np.pi / 8
    starts = np.random.default_rng(0).standard_normal((10, 2))
    starts *= 2.0 / np.linalg.norm(starts, axis=1, keepdims=True)
    clean = np.vstack([_spiral(t, start) for start in starts])
    groups, times = np.repeat(np.arange(10), 64), np.tile(t, 10)
    errors = {"weak": [], "difference": [], "local": []}
    for seed in range(10):
        x = clean + 0.03 * np.random.default_rng(seed).standard_normal(clean.shape)
        rows = weak_form(x, times, groups)
        errors["weak"].append(_regress(rows.features, rows.targets) - OSCILLATOR)
        for name, method in (("difference", "finite_difference"), ("local", "savitzky_golay")):
            D = differentiate(x, times, groups, method=method)
            errors[name].append(_regress(D.X, D.Xdot) - OSCILLATOR)
    bias = {name: np.abs(np.mean(error, axis=0)).max() for name, error in errors.items()}
    size = {name: np.abs(error).max() for name, error in errors.items()}
    assert bias["weak"] < 0.004 and size["weak"] < 0.01
    assert bias["difference"] > 0.08
    assert bias["local"] > 0.05


def _switching(damping=(0.1, 0.5)):
    coef = [[[0.0, 1.0], [-1.0, -d]] for d in damping]
    surface = StatedSurface([[0.0, -1.0, 0.0]])
    return StatedModel(None, coef, states=["q", "v"], surface=surface)


def _switching_samples(step, noise, n=20, seed=0):
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 12.0, step)
    x = np.vstack([_switching().simulate(start, t).x for start in 2 * rng.standard_normal((n, 2))])
    x += noise * rng.standard_normal(x.shape)
    return x, np.tile(t, n), np.repeat(np.arange(n), len(t))


def test_a_window_across_a_switch_is_not_lost():
    """With the modes of a model, mixtures count: their errors vanish with the step squared."""
    truth = _switching()
    errors = []
    for step, window in ((0.4, 9), (0.2, 17), (0.1, 33)):
        x, t, groups = _switching_samples(step, 0.0)
        refitted = weak_refit(_switching((0.3, 0.3)), x, t, groups, window=window)
        errors.append(np.abs(refitted.coef_ - truth.coef_).max())
        assert (refitted.coef_[:, 0, 0] == 0.0).all()
    assert errors[0] < 0.015 and errors[2] < 0.001
    assert errors[0] > 3 * errors[1] > 9 * errors[2]


def test_modes_from_integrals_alone_and_then_with_all_windows():
    x, t, groups = _switching_samples(0.25, 0.02)
    rows = weak_form(x, t, groups)
    model = SwitchingSystemRegressor(random_state=0).fit(rows.features, rows.targets)
    D = differentiate(x, t, groups, method="finite_difference")
    direct = SwitchingSystemRegressor(random_state=0).fit(D.X, D.Xdot)
    refitted = weak_refit(model, x, t, groups)
    truth = _switching().coef_

    def error(fitted):
        order = [fitted.predict_modes([[side, 0.0]])[0] for side in (1.0, -1.0)]
        return np.abs(fitted.coef_[order] - truth).max()

    assert error(refitted) < 0.02
    assert error(refitted) < 0.5 * error(direct)
    assert error(refitted) < error(model)


def test_units_and_order_of_trajectories_do_not_matter():
    x, t, groups = _switching_samples(0.4, 0.02, n=4)
    rows = weak_form(x, t, groups)
    scaled = weak_form(x * [1e3, 1e-3], 60 * t, groups)
    assert scaled.window == rows.window
    np.testing.assert_allclose(scaled.targets, rows.targets * [1e3 / 60, 1e-3 / 60], rtol=1e-8)
    order = np.argsort(-groups, kind="stable")
    other = weak_form(x[order], t[order], groups[order])
    np.testing.assert_array_equal(other.features[np.argsort(other.groups, kind="stable")], rows[0])


def test_wrong_arguments_are_refused_in_a_sentence():
    x, t, groups = _switching_samples(0.4, 0.0, n=2)
    with pytest.raises(ValueError, match="window=8 must be odd and at least 5"):
        weak_form(x, t, groups, window=8)
    with pytest.raises(ValueError, match="has 30 samples and the window 31; use a smaller window"):
        weak_form(x, t, groups, window=31)
    with pytest.raises(ValueError, match="Trajectory 0 goes back in time at its sample"):
        weak_form(x, t)
    with pytest.raises(ValueError, match="groups has shape .3,.; give one name for each of the 60"):
        weak_form(x, t, [0, 1, 2])
    with pytest.raises(ValueError, match="x contains NaN or infinity in 9 of 9 rows"):
        weak_form(np.full((9, 1), np.nan), np.arange(9))
    with pytest.raises(ValueError, match="the model needs 2 states and 0 inputs"):
        weak_refit(_switching(), x[:, 0], t, groups)
    discrete = StatedModel(None, [[0.5]], states=["x"], discrete_time=True)
    with pytest.raises(ValueError, match="gives next states"):
        weak_refit(discrete, x[:, 0], t, groups)
