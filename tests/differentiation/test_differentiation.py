"""Differentiation: exact on polynomials, independent of SciPy's filter, fair to its noise."""

import numpy as np
import pytest
from scipy.signal import butter, filtfilt, savgol_filter

from swsysid.differentiation import differentiate, estimate_noise

EVEN = np.linspace(0.0, 4.0, 201)
UNEVEN = np.sort(np.random.default_rng(0).uniform(0.0, 4.0, 300))


def wave(t):
    return np.sin(2 * t) + 0.3 * t**2


@pytest.mark.parametrize("t", [EVEN, UNEVEN], ids=["even", "uneven"])
@pytest.mark.parametrize("order", [1, 2])
def test_a_polynomial_of_the_window_degree_is_differentiated_exactly(t, order):
    x = np.column_stack([t**4 - 2 * t, 3 * t**3])
    X, Xdot, kept, _, _ = differentiate(x, t, window=11, order=order)
    jets = [
        np.column_stack([kept**4 - 2 * kept, 3 * kept**3]),
        np.column_stack([4 * kept**3 - 2, 9 * kept**2]),
        np.column_stack([12 * kept**2, 18 * kept]),
    ]
    np.testing.assert_allclose(X, np.hstack(jets[:order]), rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(Xdot, np.hstack(jets[1 : order + 1]), rtol=1e-5, atol=1e-5)
    np.testing.assert_array_equal(kept, t[5:-5])


def test_on_an_even_grid_it_is_the_savitzky_golay_filter_of_scipy():
    x = wave(EVEN) + 0.1 * np.random.default_rng(1).standard_normal(len(EVEN))
    X, Xdot, *_ = differentiate(x, EVEN, window=15, degree=3)
    step = EVEN[1] - EVEN[0]
    np.testing.assert_allclose(X[:, 0], savgol_filter(x, 15, 3)[7:-7], atol=1e-12)
    reference = savgol_filter(x, 15, 3, deriv=1, delta=step)[7:-7]
    np.testing.assert_allclose(Xdot[:, 0], reference, atol=1e-10)


def test_butterworth_is_a_zero_phase_low_pass_and_central_differences():
    t = np.arange(0, 4, 1e-3)
    x = wave(t) + 1e-3 * np.random.default_rng(2).standard_normal(len(t))
    X, Xdot, kept, *_ = differentiate(x, t, method="butterworth", cutoff=40.0)
    smooth = filtfilt(*butter(4, 40.0 / 500.0), x)
    rows = np.searchsorted(t, kept - 5e-4)
    np.testing.assert_allclose(X[:, 0], smooth[rows], atol=1e-6)
    np.testing.assert_allclose(Xdot[:, 0], np.gradient(smooth, 1e-3)[rows], atol=1e-4)


def test_finite_differences_by_hand_on_uneven_times():
    # x = t^2 at 0, 1, 3: the parabola through them has slope 2 at 1 and curvature 2
    X, Xdot, kept, _, _ = differentiate(
        [0.0, 1.0, 9.0], [0.0, 1.0, 3.0], method="finite_difference", order=2
    )
    np.testing.assert_allclose(X, [[1.0, 2.0]], atol=1e-12)
    np.testing.assert_allclose(Xdot, [[2.0, 2.0]], atol=1e-12)
    assert kept.tolist() == [1.0]


def test_whole_numbers_have_the_derivatives_of_floats():
    """PySINDy's differences of an encoder's integer counts are cut to integers."""
    from pysindy.differentiation import FiniteDifference

    t = np.arange(60.0)
    counts = np.round(100.0 * np.exp(-t / 20.0)).astype(int)
    whole, floats = (
        differentiate(x, t, method=FiniteDifference()) for x in (counts, counts.astype(float))
    )
    np.testing.assert_array_equal(whole.Xdot, floats.Xdot)
    assert (whole.Xdot % 1.0 != 0.0).any()


def test_pysindy_differentiators_are_accepted():
    from pysindy.differentiation import FiniteDifference, SmoothedFiniteDifference

    for differentiator in (FiniteDifference(), SmoothedFiniteDifference()):
        X, Xdot, kept, _, _ = differentiate(
            wave(EVEN), EVEN, method=differentiator, inputs=EVEN, order=2
        )
        np.testing.assert_allclose(X[20:-20, 0], wave(kept)[20:-20], atol=1e-3)
        slope = 2 * np.cos(2 * kept) + 0.6 * kept
        np.testing.assert_allclose(Xdot[20:-20, 0], slope[20:-20], atol=5e-3)
        np.testing.assert_array_equal(X[:, 2], kept)  # inputs stay as measured


@pytest.mark.parametrize("method", ["savitzky_golay", "butterworth"])
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("noise", [1e-4, 1e-2])
def test_the_automatic_strength_is_near_the_best_one(method, order, noise):
    t = np.arange(0, 20, 0.01)
    exact = [np.cos(t) + 0.9 * np.cos(3 * t), -np.sin(t) - 2.7 * np.sin(3 * t)][order - 1]
    x = np.sin(t) + 0.3 * np.sin(3 * t) + noise * np.random.default_rng(3).standard_normal(len(t))
    # the middle, which every strength keeps
    errors = {}
    strengths = {
        "savitzky_golay": [{"window": w} for w in (7, 15, 29, 57, 115, 163)],
        "butterworth": [{"cutoff": c} for c in (40.0, 14.0, 5.0, 2.5, 1.25)],
    }[method]
    for options in [{}, *strengths]:
        _, Xdot, kept, _, _ = differentiate(x, t, method=method, order=order, **options)
        middle = (kept > 2) & (kept < 18)
        error = Xdot[middle, -1] - np.interp(kept[middle], t, exact)
        errors[str(options)] = np.sqrt(np.mean(error**2))
    automatic = errors.pop("{}")
    assert automatic < 4.0 * min(errors.values())
    assert automatic < 0.2 * max(errors.values())


def test_noise_is_estimated_per_column_and_kinks_do_not_count():
    rng = np.random.default_rng(4)
    t = np.linspace(0, 10, 2000)
    clean = np.column_stack([np.abs(np.sin(t)), t**3])
    noisy = clean + rng.standard_normal(clean.shape) * [0.01, 0.2]
    np.testing.assert_allclose(estimate_noise(noisy), [0.01, 0.2], rtol=0.1)
    # a jump between two trajectories is not noise
    shifted = np.concatenate([clean[:, 0], clean[:, 0] + 50.0])
    groups = np.repeat([0, 1], 2000)
    assert estimate_noise(shifted, groups)[0] < 1e-6


def test_parallel_filtering_keeps_a_linear_law_exact():
    # v' = -v + u with a square-wave u: only when u passes the filter of v does the law survive
    t = np.arange(0, 20, 0.01)
    u = np.sign(np.sin(t))
    v = np.zeros_like(t)
    for k in range(len(t) - 1):
        v[k + 1] = u[k] + (v[k] - u[k]) * np.exp(-0.01)

    def worst(filter_inputs):
        X, Xdot, *_ = differentiate(
            v, t, method="butterworth", cutoff=2.0, inputs=u, filter_inputs=filter_inputs
        )
        return abs(Xdot[:, 0] + X[:, 0] - X[:, 1]).max()

    assert worst(True) < 0.05 < 0.5 < worst(False)


def test_trajectories_are_never_mixed():
    t = np.tile(EVEN, 2)
    groups = np.repeat(["a", "b"], len(EVEN))
    x = np.concatenate([wave(EVEN), 100.0 - wave(EVEN)])
    both = differentiate(x, t, groups, window=9, decimate=3)
    alone = differentiate(wave(EVEN), EVEN, window=9, decimate=3)
    first = both.groups == "a"
    np.testing.assert_allclose(both.Xdot[first], alone.Xdot, atol=1e-12)
    np.testing.assert_allclose(both.Xdot[~first], -alone.Xdot, atol=1e-9)
    np.testing.assert_array_equal(both.t[first], alone.t)
    assert len(alone.t) == int(np.ceil((len(EVEN) - 8) / 3))


def test_units_of_time_and_state_only_scale():
    x = wave(EVEN) + 0.01 * np.random.default_rng(5).standard_normal(len(EVEN))
    base = differentiate(x, EVEN, order=2)
    scaled = differentiate(1000 * x, 60 * EVEN, order=2)
    np.testing.assert_allclose(scaled.Xdot, base.Xdot * [1000 / 60, 1000 / 3600], rtol=1e-8)
    np.testing.assert_allclose(scaled.noise, 1000 * base.noise, rtol=1e-12)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"t": EVEN[::-1]}, "goes back in time"),
        (
            {"t": np.repeat(EVEN, 2)[:201]},
            "repeats a time at its sample 1; the clock is too coarse",
        ),
        ({"t": np.r_[EVEN[:100], EVEN[100:] + 50]}, "gap of 50"),
        ({"t": EVEN[:-1]}, "t has shape .200,.; give one value for each of the 201"),
        (
            {"x": np.where(EVEN == EVEN[7], np.nan, 1.0)},
            "x contains NaN or infinity in 1 of 201 rows, first in row 7",
        ),
        ({"inputs": np.full(201, np.inf)}, "inputs contains NaN or infinity"),
        ({"groups": np.r_[np.zeros(197), np.ones(4)]}, "Trajectory 1.0 has 4 samples"),
        ({"method": "magic"}, "method='magic' is unknown"),
        ({"order": 3}, "order=3 is out of reach; it must be at most 2"),
        ({"window": 8}, "window=8 must be odd"),
        ({"degree": 1}, "degree=1 must be an integer, at least 2"),
        ({"cutoff": -1.0, "method": "butterworth"}, "cutoff=-1.0 must be a positive number"),
        ({"cutoff": 1e3, "method": "butterworth"}, "half the sampling rate, 25"),
        ({"t": np.sqrt(EVEN), "method": "butterworth"}, "needs evenly spaced times"),
        ({"cutoff": 0.5, "method": "butterworth"}, "needs 405"),
        ({"decimate": 0}, "decimate=0 must be a positive integer"),
        ({"x": np.zeros((2, 2, 2))}, r"x has shape \(2, 2, 2\)"),
    ],
)
def test_bad_input_gets_a_sentence(change, sentence):
    given = {"x": wave(EVEN), "t": EVEN} | change
    with pytest.raises(ValueError, match=sentence):
        differentiate(**given)


def test_what_a_usual_step_is_a_few_samples_before_a_jump_do_not_say():
    t = np.r_[0.0, 1e-3, 3e-3, 6e-3, 0.5, np.arange(1.0, 60.0)]  # steps of a solver that begins
    x, groups = 3.0 + 2.0 * t[:, None], np.repeat([0, 1], [5, 59])
    _, rates, kept, *_ = differentiate(x, t, groups=groups, too_short="drop")
    np.testing.assert_allclose(rates, 2.0, rtol=1e-9)
    assert kept.min() > 0.5
    with pytest.raises(ValueError, match="gap of 0.494"):  # where nothing else is known
        differentiate(x[:5], t[:5], too_short="drop")
