"""Bands of rollouts: by hand, by differences, by many recordings, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from swsysid import (
    EffectRegressor,
    HybridAutomaton,
    HybridAutomatonRegressor,
    IdentificationWarning,
    SwitchingSystemRegressor,
    TrajectoryIdentifier,
    load_model,
    save_model,
)
from swsysid.refinement import StatedModel, StatedSurface, refine
from swsysid.uncertainty import bootstrap

WITHIN = norm.ppf(0.975)
T = np.linspace(0.0, 3.0, 4)


def decay(variance):
    model = StatedModel(None, [[-1.0]], states=["x"])
    model.covariance_ = np.array([[variance]])
    return model


def test_the_band_of_a_decay_is_known_by_hand():
    done = decay(0.01).simulate([2.0], T, n_draws=400, random_state=0)
    for end, sign in ((done.lower, -1.0), (done.upper, 1.0)):
        # a quantile of 400 draws is certain to .14 standard errors of the rate
        rates = -np.log(end[1:, 0] / 2.0) / T[1:]
        np.testing.assert_allclose(rates, 1.0 - sign * WITHIN * 0.1, atol=3 * 0.14 * 0.1)
        assert end[0, 0] == 2.0
    narrow = decay(0.01).simulate([2.0], T, n_draws=400, random_state=0, confidence=0.5)
    ratio = np.ptp([narrow.lower[2, 0], narrow.upper[2, 0]]) / np.ptp(
        [done.lower[2], done.upper[2]]
    )
    assert ratio == pytest.approx(norm.ppf(0.75) / WITHIN, rel=0.2)


def half_width(done, at=-1):
    return (done.upper[at] - done.lower[at]) / (2.0 * WITHIN)


def test_surfaces_guards_and_resets_move_with_their_coefficients():
    """In linear order the band is as wide as differences of rollouts say."""
    steps = StatedModel(
        1, [[[1.0, 0.0]], [[-0.5, 0.0]]], states=["x"], surface=StatedSurface([[-1.0, 1.0]], 1)
    )
    jumps = HybridAutomaton.stated(
        [{"x": "1"}, {"x": "-0.5"}],
        [(0, 1, "x >= 1 and x >= -5", {"x": "0.5 x + 0.1"}), (1, 0, "x <= 0.2")],
        states=["x"],
    )
    spread = np.random.default_rng(0).uniform(0.5, 1.0, 40) * 1e-3
    for system, begin in ((steps.switching_model, {}), (jumps, {"mode": 0})):
        mean = system.parameters
        np.testing.assert_array_equal(system.with_parameters(mean).parameters, mean)
        covariance = np.diag(spread[: len(mean)]) ** 2
        slopes = []
        for k in range(len(mean)):
            moved = mean.copy()
            moved[k] += 1e-6
            here, there = (
                one.simulate([0.0], [0.0, 1.3], **begin).x[-1]
                for one in (system, system.with_parameters(moved))
            )
            slopes.append((there - here) / 1e-6)
        wanted = np.sqrt(np.einsum("ki,kl,li->i", slopes, covariance, slopes))
        if begin:
            found = _automaton(system, covariance).simulate
        else:
            steps.covariance_ = covariance
            found = steps.simulate
        done = found([0.0], [0.0, 1.3], n_draws=200, random_state=1, **begin)
        np.testing.assert_allclose(half_width(done), wanted, rtol=0.2)  # 200 draws: .07


def _automaton(automaton, covariance):
    """One as if it had been found."""
    t = np.arange(0.0, 4.0, 0.02)
    noise = 0.01 * np.random.default_rng(0).standard_normal((len(t), 1))
    found = HybridAutomatonRegressor(2, random_state=0).fit(
        automaton.simulate([0.0], t, mode=0).x + noise, t
    )
    found.automaton_ = automaton
    found.refinement_ = replace(found.refinement_, covariance=covariance, kept=True)
    return found


@pytest.mark.nightly
def test_a_band_of_recordings_is_as_wide_as_their_answers_differ(tmp_path):
    """Errors of rollouts in units of the band, over draws of the noise, have spread one."""
    plant, t = (
        StatedModel(1, [[0.5, 0.0, 1.0], [0.0, -1.0, -0.4]], states=["x", "v"]),
        np.arange(0.0, 6.0, 0.1),
    )
    true, later = plant.simulate([1.0, 0.0], t).x, plant.simulate([0.0, 1.0], [0.0, 2.0, 5.0]).x
    off = []
    for seed in range(12):
        noise = 0.05 * np.random.default_rng(seed).standard_normal(true.shape)
        found = TrajectoryIdentifier(SwitchingSystemRegressor(1, feature_library=1)).fit(
            true + noise, t
        )
        errors = np.sqrt(np.diag(found.covariance_)[: found.coef_.size])
        np.testing.assert_allclose(errors, found.coef_errors_.ravel(), rtol=1e-9)
        done = found.simulate([0.0, 1.0], [0.0, 2.0, 5.0], n_draws=40, random_state=0)
        off.append((done.x - later)[1:] / half_width(done, slice(1, None)))
    # 12 draws of 4 numbers that go together in part: the root mean square is certain to a fifth
    assert 0.6 < np.sqrt(np.mean(np.square(off))) < 1.5
    save_model(found, tmp_path / "model.json")
    again = load_model(tmp_path / "model.json")
    same = again.simulate([0.0, 1.0], [0.0, 2.0, 5.0], n_draws=40, random_state=0)
    np.testing.assert_array_equal(same.upper, done.upper)
    np.testing.assert_array_equal(again.noise_, found.noise_)


def test_refined_and_resampled_models_have_bands():
    rng, t = np.random.default_rng(0), np.arange(0.0, 6.0, 0.1)
    plant = StatedModel(None, [[0.0, 1.0], [-1.0, -0.4]], states=["x", "v"])
    runs = [plant.simulate(x0, t).x for x0 in ([1.0, 0.0], [0.0, 2.0], [-1.0, 1.0])]
    noisy = [{"t": t, "x": run + 0.02 * rng.standard_normal(run.shape)} for run in runs]
    result = refine(plant, noisy)
    some = np.flatnonzero(np.diag(result.model.covariance_))
    np.testing.assert_array_equal(result.model.covariance_[np.ix_(some, some)], result.covariance)
    done = result.model.simulate([1.0, 0.0], T, n_draws=40, random_state=0)
    assert (done.lower[1:] < done.upper[1:]).all()

    X, velocity = np.vstack(runs), np.vstack(runs) @ plant.coef_[0].T
    velocity += 0.02 * rng.standard_normal(velocity.shape)
    groups = np.repeat([0, 1, 2], len(t))
    model = SwitchingSystemRegressor(1, random_state=0).fit(X, velocity)
    assert model.covariance_ is None
    told = bootstrap(model, X, velocity, groups=groups, n_resamples=40, random_state=0)
    np.testing.assert_allclose(np.sqrt(np.diag(told.covariance)), told.standard_error.ravel())
    model.covariance_ = told.covariance
    done = model.simulate([1.0, 0.0], T, n_draws=40, random_state=0)
    assert (done.lower[1:] < done.upper[1:]).all()
    assert model.fit(X, velocity).covariance_ is None


@pytest.mark.filterwarnings("error")
def test_what_nothing_tells_stays_and_is_said():
    model = StatedModel(None, [[-1.0, 0.0], [0.0, -2.0]], states=["x", "y"])
    model.covariance_ = np.diag([0.01, 0.0, 0.0, np.inf])
    with pytest.warns(IdentificationWarning, match="do not tell 1 coefficient; draws leave it"):
        done = model.simulate([1.0, 1.0], T, n_draws=20, random_state=0)
    assert done.lower[2, 0] < done.x[2, 0] < done.upper[2, 0]
    both = [done.lower[2, 1], done.upper[2, 1]]  # but for the steps of the integrator
    np.testing.assert_allclose(both, done.x[2, 1], rtol=1e-7)


def test_where_drawn_models_end_the_band_has_no_end():
    grows = decay(1.0)
    done = grows.simulate([1.0], [0.0, 1.0, 60.0], n_draws=50, random_state=0, state_bound=1e3)
    assert np.isfinite(done.upper[1]).all() and np.isinf(done.upper[2]).all()


def test_frames_and_pictures_have_the_band():
    pytest.importorskip("matplotlib")
    done = decay(0.01).simulate([2.0], T, n_draws=20, random_state=0)
    frame = done.to_frame()
    assert list(frame) == ["x", "mode", "x_lower", "x_upper"]
    np.testing.assert_array_equal(frame["x_upper"], done.upper[:, 0])
    [shade] = done.plot().collections
    assert shade.get_paths()[0].get_extents().ymax == done.upper.max()
    assert list(decay(0.01).simulate([2.0], T).to_frame()) == ["x", "mode"]


def _effects():
    X = np.random.default_rng(0).uniform(-1.0, 1.0, (60, 2))
    law = SwitchingSystemRegressor(1)
    return EffectRegressor(law, []).fit(X, X @ [[0.0, -1.0], [1.0, -0.1]], t=0.1 * np.arange(60))


def _rows():
    X = np.random.default_rng(0).uniform(-1.0, 1.0, (60, 2))
    return SwitchingSystemRegressor(1).fit(X, X @ [[0.0, -1.0], [1.0, -0.1]])


@pytest.mark.parametrize("model", [
    StatedModel(None, [[0.0, 1.0], [-1.0, 0.0]], states=["x", "v"]),
    HybridAutomaton.stated([{"x": "v", "v": "-x"}], states=["x", "v"]), _rows(), _effects(),
], ids=lambda one: type(one).__name__)  # fmt: skip
def test_a_model_without_covariance_says_so(model):
    with pytest.raises(ValueError, match="certain the coefficients of this model are together"):
        model.simulate([1.0, 0.0], T, n_draws=50)


@pytest.mark.parametrize(("options", "words"), [
    ({"n_draws": 5}, "n_draws=5"), ({"n_draws": 50, "confidence": 1.5}, "confidence=1.5"),
    ({"n_draws": "many"}, "n_draws='many'"), ({"n_draws": 50, "random_state": "a"}, "random_state"),
    ({"n_draws": 50, "rtoll": 1.0}, "no option 'rtoll'"),
])  # fmt: skip
def test_options_of_a_band_are_checked(options, words):
    with pytest.raises((ValueError, TypeError), match=words):
        decay(0.01).simulate([1.0], T, **options)
