"""Bootstrap: intervals that hold the truth, agree with theory and feel the trajectories."""

import numpy as np
import pytest
from scipy.stats import t as student
from sklearn.base import clone

from swsysid import PolynomialSurfaceClassifier, SwitchingSystemRegressor
from swsysid.datasets import make_damped_oscillator
from swsysid.uncertainty import bootstrap

TRUTH = np.array([[[-0.5, 1.0], [0.0, -1.0]], [[-2.0, 0.0], [0.5, -1.0]]])  # right, left


def two_modes(seed, n_samples=120, noise=0.1):
    """A planted noisy system with more samples on the right, fitted from its true modes."""
    rng = np.random.default_rng(seed)
    X = rng.uniform([-1, -1], [2, 1], (n_samples, 2))
    modes = (X[:, 0] < 0).astype(int)
    Xdot = np.einsum("nij,nj->ni", TRUTH[modes], X) + noise * rng.standard_normal(X.shape)
    model = SwitchingSystemRegressor(
        loss="squared", surface=PolynomialSurfaceClassifier(degree=1), init=modes
    )
    return model.fit(X, Xdot), X, Xdot


@pytest.fixture(scope="module")
def single():
    """One linear mode with squared loss: ordinary least squares."""
    rng = np.random.default_rng(0)
    X = rng.normal(size=(400, 2))
    Xdot = X @ np.array([[0.0, -1.0], [1.0, -0.3]]) + 0.1 * rng.standard_normal((400, 2))
    return SwitchingSystemRegressor(n_modes=1, loss="squared").fit(X, Xdot), X, Xdot


def test_standard_errors_of_one_mode_are_those_of_least_squares(single):
    model, X, Xdot = single
    result = bootstrap(model, X, Xdot, n_resamples=150, random_state=0)
    sigma = np.sqrt(((Xdot - model.predict(X)) ** 2).sum(axis=0) / (len(X) - 2))
    analytic = sigma[:, None] * np.sqrt(np.diag(np.linalg.inv(X.T @ X)))
    # a standard deviation of 150 draws has a relative standard error of 1 / sqrt(300) = 6 %
    assert np.allclose(result.standard_error[0] / analytic, 1.0, atol=0.2)
    assert result.n_lost == 0 and result.blocks == "samples"
    assert (result.low < result.estimate).all() and (result.estimate < result.high).all()


def test_intervals_hold_the_truth():
    held = []
    for seed in range(10):
        result = bootstrap(*two_modes(seed), n_resamples=30, random_state=seed)
        held.append((result.low <= TRUTH) & (TRUTH <= result.high))
    # 80 intervals of 95 %, which 30 resamples make about 92 %: three binomial standard
    # deviations below that, sqrt(.92 * .08 / 80) = .03 each, is .83; intervals half as wide
    # would hold 65 %
    assert np.mean(held) >= 0.83


def test_number_of_jobs_does_not_matter(single):
    model, X, Xdot = single
    options = dict(n_resamples=20, random_state=3)
    one, two = (bootstrap(model, X, Xdot, n_jobs=n_jobs, **options) for n_jobs in (1, 2))
    assert np.array_equal(one.samples, two.samples)
    other = bootstrap(model, X, Xdot, n_resamples=20, random_state=4)
    assert not np.array_equal(one.samples, other.samples)


def test_errors_alike_within_trajectories_widen_the_intervals():
    rng = np.random.default_rng(1)
    groups = np.repeat(np.arange(20), 20)
    X = np.repeat(rng.normal(size=(20, 1)), 20, axis=0) + 0.1 * rng.normal(size=(400, 1))
    xdot = -X[:, 0] + 0.2 * rng.standard_normal(20)[groups]
    model = SwitchingSystemRegressor(n_modes=1, loss="squared").fit(X, xdot)
    single, whole = (
        bootstrap(model, X, xdot, groups=names, n_resamples=60, random_state=0)
        for names in (None, groups)
    )
    # twenty equal errors count as one: the standard error grows by up to sqrt(20) = 4.5
    assert whole.standard_error.item() > 2.5 * single.standard_error.item()
    assert whole.blocks == "trajectories"


@pytest.mark.nightly
def test_few_trajectories_are_corrected_for():
    # Eight trajectories, each with an error of its own: what is known of a constant velocity is
    # what Student's t says of the mean of eight numbers.
    groups, ratios, errors = np.repeat(np.arange(8), 2), [], []
    for seed in range(4):
        xdot = np.random.default_rng(seed).standard_normal(8)[groups]
        model = SwitchingSystemRegressor(n_modes=1, loss="squared").fit(np.ones((16, 1)), xdot)
        result = bootstrap(
            model, np.ones((16, 1)), xdot, groups=groups, n_resamples=400, random_state=seed
        )
        expected = xdot[::2].std(ddof=1) / np.sqrt(8)
        errors.append(result.standard_error.item() / expected)
        ratios.append((result.high - result.low).item() / (2 * student.ppf(0.975, 7) * expected))
    # 400 draws know a standard deviation to 1 / sqrt(800) = 3.5 %, four of them to 1.8 %; the
    # tails are extremes among them, of a distribution that is bounded; uncorrected: 0.94, 0.78
    assert np.mean(errors) == pytest.approx(1.0, abs=0.05)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.12)


def test_order_of_the_rows_does_not_matter():
    model, X, Xdot = two_modes(0)
    groups, order = np.arange(120) // 6, np.random.default_rng(1).permutation(120)
    shuffled = clone(model).set_params(init=model.modes_[order])
    shuffled.fit(X[order], Xdot[order])
    options = dict(n_resamples=20, random_state=0)
    one = bootstrap(model, X, Xdot, groups=groups, **options)
    other = bootstrap(shuffled, X[order], Xdot[order], groups=groups[order], **options)
    assert np.array_equal(one.samples, other.samples)


def test_other_samples_are_refused(single):
    with pytest.raises(ValueError, match="was fitted to 400"):
        bootstrap(single[0], single[1][:50], single[2][:50])


def test_modes_and_surfaces_come_in_the_order_of_the_estimator():
    model, X, Xdot = two_modes(0)
    points = np.array([[-1.0, 0.0], [2.0, 0.0]])
    result = bootstrap(model, X, Xdot, n_resamples=20, random_state=0, surface_points=points)
    assert (np.abs(result.samples - result.estimate) < 0.4).all()  # the modes differ by 1.5
    values = model.surface_.surface_values(points)
    assert (np.sign(result.surface_low) == np.sign(values)).all()
    assert (np.sign(result.surface_high) == np.sign(values)).all()


def test_basic_interval_mirrors_the_percentile_interval(single):
    result = bootstrap(*single, n_resamples=20, random_state=0)
    assert np.allclose(result.basic_low + result.high, 2 * result.estimate)
    assert np.allclose(result.basic_high + result.low, 2 * result.estimate)


def test_result_prints_as_a_table(single):
    lines = str(bootstrap(*single, n_resamples=20, random_state=0)).splitlines()
    assert lines[0] == "20 resamples of samples, 0 lost a mode, 95 % percentile intervals"
    assert len(lines) == 2 + 4
    assert lines[2].split()[:3] == ["0", "0", "x0"]


def test_lost_modes_are_counted():
    X = np.linspace(-1, 1, 41)[:, None]
    xdot = np.where(np.arange(41) == 0, 5.0, X[:, 0])  # one sample is a mode of its own
    model = SwitchingSystemRegressor(init=(np.arange(41) == 0).astype(int), coupling=0)
    result = bootstrap(model.fit(X, xdot), X, xdot, n_resamples=40, random_state=0)
    # that sample is missing from a share (1 - 1/41)^41 = .36 of the resamples
    assert 5 <= result.n_lost <= 25
    assert len(result.samples) == 40 - result.n_lost


@pytest.mark.parametrize(
    "options, message",
    [
        ({"n_resamples": 5}, "at least 20"),
        ({"confidence": 95}, "confidence=95 must be a number above 0 and below 1"),
        ({"groups": np.zeros(400)}, "single trajectory"),
        ({"groups": np.zeros(3)}, "groups has shape .3,.; give one name for each"),
    ],
)
def test_refusals(single, options, message):
    with pytest.raises(ValueError, match=message):
        bootstrap(*single, **options)


@pytest.mark.parametrize("loss", ["l1", "l2", "squared"])
def test_samples_with_other_digits_are_refused(loss):
    data = make_damped_oscillator(200, noise=0.05, random_state=0)
    model = SwitchingSystemRegressor(loss=loss, n_init=2, random_state=0).fit(data.X, data.Xdot)
    kept = bootstrap(model, data.X, data.Xdot, n_resamples=20, random_state=0)
    assert kept.n_resamples == 20
    for X, Xdot in ((data.X + 0.01, data.Xdot), (data.X, np.round(data.Xdot, 1))):
        with pytest.raises(ValueError, match="give the very samples"):
            bootstrap(model, X, Xdot, n_resamples=20, random_state=0)


def test_the_samples_of_a_weighted_fit_are_refused():
    # resamples know no weights: they would be of another fit
    data = make_damped_oscillator(200, noise=0.05, random_state=0)
    weight = np.where(data.t > 5.0, 3.0, 1.0)
    model = SwitchingSystemRegressor(n_init=2, random_state=0)
    model.fit(data.X, data.Xdot, sample_weight=weight)
    with pytest.raises(ValueError, match="without weights"):
        bootstrap(model, data.X, data.Xdot, n_resamples=20, random_state=0)
