"""The filter and the decoder are Kalman's and Viterbi's, written down densely and enumerated."""

from itertools import product

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.stats import multivariate_normal, norm

from swsysid._data.recordings import Record
from swsysid._stays.decoding import cheapest_modes, decode
from swsysid._stays.filtering import (
    Belief,
    FlowFilter,
    Linear,
    Surfaces,
    corrected,
    first_belief,
)
from swsysid._stays.laws import Laws
from swsysid._stays.recordings import Recordings

NOISE, DISTURBANCE = np.array([0.3, 0.2]), np.array([0.4, 0.7])
N_STEPS, N_RECORDINGS, N_KEPT = 3, 2, 4


def linear(rng, n_modes, size=1.0):
    shape = n_modes, N_STEPS, N_RECORDINGS
    slope = size * rng.standard_normal((2, 2, *shape)) + np.eye(2)[:, :, None, None, None]
    return Linear(rng.standard_normal((2, *shape)), slope)


def drawn_filter(n_modes=3, **others):
    rng = np.random.default_rng(3)
    halves, rates = (linear(rng, n_modes), linear(rng, n_modes)), linear(rng, n_modes)
    steps = rng.uniform(0.5, 1.5, (N_STEPS, N_RECORDINGS))
    return FlowFilter(NOISE, DISTURBANCE, np.ones(2), halves, rates, steps, steps, **others)


def beliefs(rng):
    """Of hypotheses of both recordings."""
    root = rng.standard_normal((2, 3, N_RECORDINGS, N_KEPT))
    mean = rng.standard_normal((2, N_RECORDINGS, N_KEPT))
    return Belief(mean, np.einsum("aqrk,bqrk->abrk", root, root))


def ahead(filter_, k, recording, mean, covariance, old, new):
    """A belief one interval later; the switch is somewhere in it."""

    def of(part, mode):
        return part.offset[:, mode, k, recording], part.slope[:, :, mode, k, recording]

    (first, A), (second, B) = of(filter_.halves[0], old), of(filter_.halves[1], new)
    half, duration = first + A @ mean, filter_.steps[k, recording]
    velocities = [b + F @ half for b, F in (of(filter_.rates, mode) for mode in (new, old))]
    jump = (velocities[0] - velocities[1]) * duration
    more = np.diag(filter_.disturbance**2 * duration)
    if filter_.entering is not None and new != old:
        more = more + np.diag(filter_.entering[:, new])
    covariance = B @ A @ covariance @ A.T @ B.T + np.outer(jump, jump) / 12.0 + more
    return second + B @ half, covariance, jump


@pytest.mark.parametrize("entering", [None, np.array([[0.5, 0.0, 2.0], [0.0, 1.0, 3.0]])])
def test_an_interval_is_two_halves_a_disturbance_and_a_switch_anywhere(entering):
    filter_ = drawn_filter(entering=entering)
    before = beliefs(np.random.default_rng(0))
    modes = np.array([[0, 1, 2, 0], [2, 1, 0, 1]])
    for k in range(N_STEPS):
        (mean, covariance), nats = filter_.ahead(k, before, modes)
        assert mean.shape == (2, N_RECORDINGS, N_KEPT, 3) and nats == 0.0
        for recording, slot, new in np.ndindex(N_RECORDINGS, N_KEPT, 3):
            own = before.mean[:, recording, slot], before.covariance[:, :, recording, slot]
            expected = ahead(filter_, k, recording, *own, modes[recording, slot], new)
            at = recording, slot, new
            np.testing.assert_allclose(mean[:, *at], expected[0], rtol=1e-10, atol=1e-12)
            np.testing.assert_allclose(covariance[:, :, *at], expected[1], rtol=1e-10, atol=1e-12)


def test_what_slides_is_on_its_surface_and_got_there_as_likely_as_a_crossing():
    rng = np.random.default_rng(1)
    shape = 1, N_STEPS, N_RECORDINGS
    surfaces = Surfaces(rng.standard_normal(shape), rng.standard_normal((2, *shape)))
    free, filter_ = drawn_filter(), drawn_filter(surfaces=surfaces)
    before, modes = beliefs(rng), np.array([[0, 1, 2, 0], [2, 1, 0, 1]])
    (mean, covariance), nats = filter_.ahead(1, before, modes)
    (loose, wide), _ = free.ahead(1, before, modes)
    np.testing.assert_allclose(mean[..., :2], loose[..., :2], rtol=1e-12)
    assert (nats[..., :2] == 0.0).all()
    for at in np.ndindex(N_RECORDINGS, N_KEPT):
        gradient, offset = surfaces.gradient[:, 0, 1, at[0]], surfaces.offset[0, 1, at[0]]
        x, P = loose[:, *at, 2], wide[:, :, *at, 2]
        f, variance = offset + gradient @ x, gradient @ P @ gradient
        gain = P @ gradient / variance
        np.testing.assert_allclose(mean[:, *at, 2], x - gain * f, rtol=1e-9, atol=1e-12)
        expected = P - np.outer(gain, gain) * variance
        np.testing.assert_allclose(covariance[:, :, *at, 2], expected, rtol=1e-9, atol=1e-11)
        if modes[at] == 2:
            assert nats[*at, 2] == 0.0
            continue
        own = before.mean[:, *at], before.covariance[:, :, *at]
        jump = ahead(free, 1, at[0], *own, modes[at], 2)[2]
        density = norm.logpdf(f, scale=np.sqrt(variance)) + np.log(abs(gradient @ jump))
        assert f**2 / variance < 60.0
        assert nats[*at, 2] == pytest.approx(density, rel=1e-9)


def test_a_measurement_corrects_as_a_joint_gaussian_says():
    rng = np.random.default_rng(2)
    root, mean = rng.standard_normal((3, 4, 2, 1, 2)), rng.standard_normal((3, 2, 1, 2))
    P, noise = np.einsum("aqrkm,bqrkm->abrkm", root, root), np.array([0.3, 0.5, 0.2])
    y = np.array([[0.2, 1.0, -0.4], [np.nan, 0.3, np.nan]])
    after, likelihood = corrected(Belief(mean, P), y, noise)
    for recording, mode in np.ndindex(2, 2):
        seen = np.flatnonzero(np.isfinite(y[recording]))
        x, own = mean[:, recording, 0, mode], P[:, :, recording, 0, mode]
        total = own[np.ix_(seen, seen)] + np.diag(noise[seen] ** 2)
        gain = own[:, seen] @ np.linalg.inv(total)
        expected = x + gain @ (y[recording, seen] - x[seen])
        np.testing.assert_allclose(after.mean[:, recording, 0, mode], expected, rtol=1e-9)
        np.testing.assert_allclose(
            after.covariance[:, :, recording, 0, mode],
            own - gain @ own[seen],
            rtol=1e-8,
            atol=1e-12,
        )
        density = multivariate_normal.logpdf(y[recording, seen], x[seen], total)
        density += 0.5 * len(seen) * np.log(2.0 * np.pi)
        assert likelihood[recording, 0, mode] == pytest.approx(density, rel=1e-9)


def test_an_outlier_costs_no_more_than_sixty_squares():
    belief = Belief(np.zeros((1, 1, 1, 1)), np.ones((1, 1, 1, 1, 1)))
    cost = [corrected(belief, np.array([[y]]), np.ones(1))[1].item() for y in (3.0, 1e3, 1e6)]
    np.testing.assert_allclose(cost, -0.5 * (np.array([4.5, 60.0, 60.0]) + np.log(2.0)))


COEF = np.array([[[0.0, 0.0, 1.0, 0.0], [0.2, -1.0, -0.3, 1.0]],
                 [[1.1, 0.3, -1.0, 0.3], [-0.9, 2.0, -0.2, -0.5]]])  # fmt: skip


def campaign(n_times=(6, 4), step=0.05):
    """Recordings of two affine laws with inputs, one shorter than the other, one value lost."""
    rng, records = np.random.default_rng(4), []
    for n in n_times:
        t = step * np.arange(n) + 0.1 * step * rng.uniform(-1.0, 1.0, n)
        y = np.cumsum(rng.normal(0.0, 0.2, (n, 2)), axis=0)
        records.append(Record(t, y, rng.standard_normal((n, 1))))
    records[0].y[2, 1] = np.nan
    laws = Laws(COEF, lambda X: np.column_stack([np.ones(len(X)), X]), np.array([1.5, 2.0]),
                np.ones(COEF.shape, dtype=bool))  # fmt: skip
    return laws, Recordings.of(records)


def flow(coef, u, after, duration):
    """Offset and slope of the flow of an affine law, by the exponential of a matrix."""
    matrix = np.zeros((4, 4))
    matrix[:2, :2], matrix[:2, 2], matrix[:2, 3] = coef[:, 1:3], coef[:, 3], coef[:, 0]
    matrix[2, 3] = (after - u) / duration
    end = expm(matrix * duration)
    return end[:2, 2] * u + end[:2, 3], end[:2, :2]


def test_the_filter_of_affine_laws_is_that_of_their_exponentials():
    laws, recordings = campaign()
    filter_ = FlowFilter.of(laws, recordings, NOISE, DISTURBANCE)
    assert filter_.n_modes == 2
    for recording, t in enumerate(recordings.times):
        u = recordings.u[:, recording, 0]
        for k, mode in np.ndindex(len(t) - 1, 2):
            middle, half = 0.5 * (u[k] + u[k + 1]), 0.5 * (t[k + 1] - t[k])
            at, ends = (mode, k, recording), [(u[k], middle), (middle, u[k + 1])]
            for found, own in zip(filter_.halves, ends, strict=True):
                offset, slope = flow(COEF[mode], *own, half)
                np.testing.assert_allclose(found.offset[:, *at], offset, rtol=1e-5, atol=1e-7)
                np.testing.assert_allclose(found.slope[:, :, *at], slope, rtol=1e-5, atol=1e-7)
            for x in np.eye(2):  # velocities in the middle, anywhere: to the third order of a step
                rate = COEF[mode] @ np.concatenate([[1.0], x, [middle]])
                found = filter_.rates.offset[:, *at] + filter_.rates.slope[:, :, *at] @ x
                np.testing.assert_allclose(found, rate, atol=2e-2 * abs(COEF[mode]).max())
    assert filter_.disturbed(2.0 * DISTURBANCE).disturbance.tolist() == (2 * DISTURBANCE).tolist()


def score(filter_, recordings, recording, path, price, prior):
    """Log likelihood of a path of modes, by a filter of its own; the first mode costs nothing."""
    y = recordings.y[:, recording]
    guess = recordings.guess[0, recording]
    seen = np.isfinite(y[0])
    mean = np.where(seen, y[0], guess)
    covariance = np.diag(np.square(np.where(seen, NOISE, 0.5 * filter_.spread)))
    total, old = 0.0, path[0]
    for k, new in enumerate(path):
        mean, covariance, _ = ahead(filter_, k, recording, mean, covariance, old, new)
        seen = np.flatnonzero(np.isfinite(y[k + 1]))
        P = covariance[np.ix_(seen, seen)] + np.diag(NOISE[seen] ** 2)
        error = y[k + 1, seen] - mean[seen]
        squares = error @ np.linalg.solve(P, error)
        total -= 0.5 * (min(squares, 60.0) + np.linalg.slogdet(P)[1])
        gain = covariance[:, seen] @ np.linalg.inv(P)
        mean, covariance = mean + gain @ error, covariance - gain @ covariance[seen]
        total -= price * (new != old)
        total += 0.0 if prior is None else prior[k, recording, new]
        old = new
    return total


@pytest.mark.parametrize("price", [0.05, 1.0])
@pytest.mark.parametrize("with_prior", [False, True])
def test_the_decoder_finds_the_best_of_all_paths(price, with_prior):
    laws, recordings = campaign(step=0.4)
    recordings.y[0, 1, 0] = np.nan  # a state that is roughly known where it begins
    filter_ = FlowFilter.of(laws, recordings, NOISE, DISTURBANCE)
    prior = None
    if with_prior:
        prior = np.log(np.random.default_rng(6).dirichlet([1.0, 1.0], (5, 2)))
    found = decode(filter_, recordings, prior, price=price, n_kept=40)
    for recording, t in enumerate(recordings.times):
        paths = list(product(range(2), repeat=len(t) - 1))
        scores = [score(filter_, recordings, recording, one, price, prior) for one in paths]
        best = int(np.argmax(scores))
        assert tuple(found.modes[: len(t) - 1, recording]) == paths[best]
        assert found.log_likelihood[recording] == pytest.approx(scores[best], rel=1e-9)


def test_a_prior_that_rules_a_mode_out_is_heeded():
    laws, recordings = campaign(step=0.4)
    filter_, prior = FlowFilter.of(laws, recordings, NOISE, DISTURBANCE), np.zeros((5, 2, 2))
    prior[2, 0, 0] = prior[3:, 0, 1] = -np.inf
    path = decode(filter_, recordings, prior, price=0.0, n_kept=6).modes[:, 0]
    assert path[2:].tolist() == [1, 0, 0]


def test_the_first_belief_is_the_sample_or_a_guess():
    laws, recordings = campaign()
    recordings.y[0, 1, 1] = np.nan
    filter_ = FlowFilter.of(laws, recordings, NOISE, DISTURBANCE)
    belief = first_belief(filter_, recordings.y[0], recordings.guess[0] + 9.0)
    expected = recordings.y[0].copy()
    expected[1, 1] = recordings.guess[0, 1, 1] + 9.0
    np.testing.assert_array_equal(belief.mean.T, expected)
    np.testing.assert_allclose(belief.covariance[:, :, 0], np.diag(NOISE**2))
    np.testing.assert_allclose(belief.covariance[:, :, 1], np.diag([NOISE[0] ** 2, 1.0]))


@pytest.mark.parametrize("seed", range(5))
def test_modes_of_least_cost_are_the_cheapest_of_all(seed):
    rng = np.random.default_rng(seed)
    costs, begins = rng.uniform(0.0, 2.0, (7, 3)), np.isin(np.arange(7), [0, 3])

    def cost(path):
        turns = (np.diff(path) != 0) & ~begins[1:]
        return costs[np.arange(7), path].sum() + 0.7 * turns.sum()

    best = min(product(range(3), repeat=7), key=lambda path: cost(np.array(path)))
    assert tuple(cheapest_modes(costs, begins, 0.7)) == best
