"""The residual report: silent about noise, and right about what was planted."""

import json

import numpy as np
import pytest
from scipy.signal import lombscargle
from sklearn.linear_model import LinearRegression
from statsmodels.stats.diagnostic import acorr_ljungbox

from swsysid.diagnosis import residual_report, whiteness_test
from swsysid.diagnosis._channels import between_shares, make_channel
from swsysid.diagnosis._spectrum import frequency_grid, spectrum
from swsysid.diagnosis._whiteness import normal_scores


def autoregression(rng, n_rows, coefficient):
    """A stationary AR(1) process of deviation one."""
    noise = rng.standard_normal(n_rows) * np.sqrt(1.0 - coefficient**2)
    values = np.empty(n_rows)
    values[0] = rng.standard_normal()
    for i in range(1, n_rows):
        values[i] = coefficient * values[i - 1] + noise[i]
    return values


class Oscillator:
    """x' = v, v' = -4 x - 0.3 v + 2 u + missing(i, x, v), driven by correlated u; noise 0.1."""

    names = ("x", "v", "u")

    def __init__(self, missing, seed=0, n_rows=800, step=0.04, noise=0.1):
        rng = np.random.default_rng(seed)
        self.t = step * np.arange(n_rows)
        self.u, self.signal = autoregression(rng, n_rows, 0.9), autoregression(rng, n_rows, 0.9)
        self.X, self.Xdot = np.empty((n_rows, 3)), np.empty((n_rows, 2))
        x, v = 1.0, 0.0
        for i in range(n_rows):
            force = -4.0 * x - 0.3 * v + 2.0 * self.u[i] + missing(self, i, x, v)
            self.X[i], self.Xdot[i] = (x, v, self.u[i]), (v, force)
            v += step * force
            x += step * v
        self.Xdot += noise * rng.standard_normal(self.Xdot.shape)

    def report(self, **options):
        pandas = pytest.importorskip("pandas")
        frame = pandas.DataFrame(self.X, columns=self.names)
        signals = pandas.DataFrame({"load": self.signal})
        model = LinearRegression().fit(frame, self.Xdot)
        return residual_report(
            model, frame, self.Xdot, self.t, signals=signals, random_state=0, **options
        )


PLANTED = {
    "v": lambda plant, i, x, v: -0.5 * np.sign(v),
    "t": lambda plant, i, x, v: 0.04 * plant.t[i],
    "load": lambda plant, i, x, v: 0.4 * plant.signal[i],
    "u 3 rows before": lambda plant, i, x, v: 2.0 * (plant.u[max(i - 3, 0)] - plant.u[i]),
    "time": lambda plant, i, x, v: 0.3 * np.sin(2.0 * np.pi * 3.3 * plant.t[i]),
}


@pytest.mark.parametrize("channel", PLANTED)
def test_what_was_planted_is_named_first(channel):
    report = Oscillator(PLANTED[channel]).report()
    first = report.findings[0]
    assert (first.equation, first.channel, first.aspect) == ("v", channel, "mean")
    assert first.share > 0.5 and first.p_value <= 0.01 and not report.clean
    assert {finding.equation for finding in report.findings} == {"v"}
    assert report.verdicts["x"].startswith("nothing is left")


class Zero:
    """Predicts nothing, so that Xdot is the residual."""

    def predict(self, X):
        return np.zeros((len(X), 1))


@pytest.mark.parametrize("tails", ["normal", "t3"])
def test_noise_beside_correlated_channels_is_clean(tails):
    n_clean = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        X = np.column_stack([autoregression(rng, 120, 0.9) for _ in range(3)])
        noise = rng.standard_normal(120) if tails == "normal" else rng.standard_t(3, 120)
        t = np.arange(120.0)
        report = residual_report(Zero(), X, noise, t, n_lags=3, random_state=seed)
        n_clean += report.clean
    # 1 of 100 may be found by chance: more than 2 of 40 has probability .007
    assert n_clean >= 38


def test_rows_without_order():
    rng = np.random.default_rng(0)
    X = rng.uniform(-1, 1, (300, 2))
    Xdot = (X[:, 0] > 0.3) + 0.3 * rng.standard_normal(300)
    report = residual_report(LinearRegression().fit(X, Xdot), X, Xdot, random_state=0)
    assert report.findings[0].channel == "x0"
    assert set(report.skipped) == {"whiteness", "lags", "spectrum", "time", "surface"}
    assert not report.whiteness and not report.spectrum and report.n_trajectories == 0
    # the order of the rows says nothing
    order = rng.permutation(300)
    again = residual_report(LinearRegression().fit(X, Xdot), X[order], Xdot[order], random_state=0)
    assert [f.channel for f in again.tests] == [f.channel for f in report.tests]


def test_the_report_is_a_dict_that_json_can_carry():
    report = Oscillator(PLANTED["v"], n_rows=300).report()
    plain = report.to_dict()
    assert json.loads(json.dumps(plain, allow_nan=False)) == plain == dict(report)
    assert report["clean"] is False and report["findings"][0]["channel"] == "v"
    assert len(report) == len(list(report))
    with pytest.raises(KeyError, match="'colour' is no part of the report"):
        report["colour"]


def test_whiteness_of_one_trajectory_is_the_test_of_ljung_and_box():
    residual = np.random.default_rng(0).standard_t(3, 300)
    ours = whiteness_test(residual, n_lags=7)
    theirs = acorr_ljungbox(normal_scores(residual), lags=[7])
    # the same formula, rounding apart
    assert np.isclose(ours.statistic, theirs["lb_stat"].iloc[0], rtol=1e-9)
    assert np.isclose(ours.p_value, theirs["lb_pvalue"].iloc[0], rtol=1e-9)


def test_spectrum_is_that_of_lomb_and_scargle():
    rng = np.random.default_rng(0)
    t = np.sort(rng.uniform(0, 10, 80))
    values = rng.standard_normal(80)
    pieces = [np.arange(50), np.arange(50, 80)]
    grid = frequency_grid(t, pieces)
    ours = spectrum(values[None], t, pieces, grid)[:, 0]
    powers = [lombscargle(t[rows], values[rows], 2 * np.pi * grid) for rows in pieces]
    assert np.allclose(ours, 2.0 * sum(powers) / np.square(values).sum(), rtol=1e-6)


def test_shares_are_those_of_an_analysis_of_variance():
    rng = np.random.default_rng(0)
    channels = [make_channel(f"x{i}", rng.standard_normal(200), "state") for i in range(2)]
    values = rng.standard_normal((3, 200))
    values[1:] = [rng.permutation(values[0]) for _ in range(2)]
    shares = between_shares(channels, values)
    for channel, row in zip(channels, shares, strict=True):
        indicator = channel.bins[:, None] == np.arange(channel.n_bins)
        for share, y in zip(row, values, strict=True):
            fit = indicator @ np.linalg.lstsq(indicator * 1.0, y, rcond=None)[0]
            assert np.isclose(share, fit.var() / y.var(), rtol=1e-9)
