"""The residual report: silent about noise, and right about what was planted."""

import json

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy.signal import lombscargle
from sklearn.linear_model import LinearRegression
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer
from statsmodels.stats.diagnostic import acorr_ljungbox
from statsmodels.stats.multitest import multipletests

from swsysid import EffectRegressor, SwitchingSystemRegressor
from swsysid._residual_report import dependence
from swsysid._residual_report.channels import between_shares, make_channel
from swsysid._residual_report.dependence import Clock, holm, max_statistic, rearrangements
from swsysid._residual_report.findings import describe, rounded
from swsysid._residual_report.whiteness import normal_scores
from swsysid.diagnosis import noise_floor, residual_report, whiteness_test
from swsysid.refinement import StatedModel


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
    # 98 of 100; one may be found by chance in 100, and none is with these seeds
    assert n_clean >= 0.98 * 40


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
    clock = Clock.of(t, np.repeat([0, 1], [50, 30]))
    ours = clock.shares(values[None])[:, 0]
    frequency = 2 * np.pi * clock.frequency
    powers = [lombscargle(t[rows], values[rows], frequency) for rows in (slice(50), slice(50, 80))]
    assert np.allclose(ours, 2.0 * sum(powers) / np.square(values).sum(), rtol=1e-6)


def test_long_trajectories_are_cut_for_the_spectrum(monkeypatch):
    codes = np.repeat([0, 1, 2], [100, 30, 5])
    monkeypatch.setattr(dependence, "_LONGEST_PIECE", 25)
    monkeypatch.setattr(dependence, "FEWEST_ROWS_OF_A_PIECE", 10)
    clock = Clock.of(np.arange(135.0), codes)
    assert [len(rows) for rows in clock.pieces] == [25, 25, 25, 25, 15, 15]
    assert Clock.of(np.arange(5.0), np.zeros(5, int)) is None


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


def test_correction_of_holm_is_that_of_statsmodels():
    p_values = [0.04, 0.001, 0.03, 0.2, 0.03]
    assert np.allclose(holm(p_values), multipletests(p_values, method="holm")[1], rtol=1e-12)


class Switching(Zero):
    """Zero velocity in two modes, on the two sides of x0 = 0.3."""

    class surface_:  # noqa: N801
        @staticmethod
        def surface_values(X):
            return X[:, :1] - 0.3

    def predict(self, X):
        return np.zeros((len(X), 2))

    def predict_modes(self, X):
        return (X[:, 0] > 0.3).astype(int)


def _switching_report(leftover, seed=0):
    """The report on noise 0.1 beside a leftover of the second equation."""
    rng = np.random.default_rng(seed)
    X = rng.uniform(-1, 1, (800, 2))
    noise = 0.1 * rng.standard_normal((800, 2))
    noise[:, 1] = leftover(X, noise[:, 1])
    return residual_report(Switching(), X, noise, random_state=0)


@pytest.mark.parametrize(
    ("leftover", "channel", "kind", "aspect", "verdict"),
    [
        (lambda X, e: e * (1 + 2 * abs(X[:, 1])), "x1", "state", "spread", "spread depends on x1"),
        (
            lambda X, e: np.where(abs(X[:, 0] - 0.3) < 0.05, 10 * e, e),
            "the switching surface",
            "surface",
            "spread",
            "larger near the switching surface",
        ),
        (lambda X, e: e + 0.1, "nothing", "bias", "mean", "off by 0.0952"),
        (lambda X, e: e + 0.1 * (X[:, 0] > 0.3), "mode", "mode", "mean", "depends on mode"),
        (
            lambda X, e: e + 0.3 * X[:, 0] * X[:, 1],
            "x0 and x1 together",
            "pair",
            "mean",
            "together",
        ),
    ],
    ids=["spread", "surface", "bias", "mode", "pair"],
)
def test_leftovers_of_other_kinds_are_named_first(leftover, channel, kind, aspect, verdict):
    report = _switching_report(leftover)
    first = report.findings[0]
    assert (first.equation, first.channel, first.kind, first.aspect) == (
        "x1",
        channel,
        kind,
        aspect,
    )
    assert verdict in report.verdicts["x1"] and verdict in str(report)
    assert report.verdicts["x0"].startswith("nothing is left")


def test_what_one_mode_lacks_is_said_of_that_mode():
    report = _switching_report(lambda X, e: e + 0.5 * (X[:, 0] > 0.3) * (X[:, 1] ** 2 - 1 / 3))
    of_modes = [test for test in report.tests if test.mode is not None and test.significant]
    assert [(test.mode, test.channel, test.shape) for test in of_modes] == [(1, "x1", "a parabola")]
    assert "in mode 1 alone it depends on x1" in report.verdicts["x1"]


def test_correlated_residuals_follow_no_channel_but_their_past():
    named = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        X = np.column_stack([autoregression(rng, 300, 0.9) for _ in range(2)])
        residual = autoregression(rng, 300, 0.7)
        report = residual_report(Zero(), X, residual, np.arange(300.0), random_state=seed)
        assert report.whiteness[0].significant and not report.clean
        named += [finding.kind for finding in report.findings]
    # one of 20 may be found by chance
    assert set(named) <= {"residual lag", "lag"} and named.count("lag") <= 1


def test_an_exact_model_is_not_tested():
    X = np.random.default_rng(0).uniform(-1, 1, (100, 2))
    Xdot = X @ [[0.0, -1.0], [1.0, -0.3]]
    report = residual_report(LinearRegression().fit(X, Xdot), X, Xdot, random_state=0)
    assert report.clean and all(size.exact for size in report.size) and not report.tests
    assert "zero to rounding" in str(report)
    with pytest.raises(ValueError, match="nothing of x1 was tested: there is nothing to draw"):
        report.plot()


def test_the_model_is_given_what_it_asks_for():
    class Asks(Zero):
        def predict(self, X, *, t, signals):
            return (0.5 * t + signals[:, 0])[:, None]

    rng = np.random.default_rng(0)
    t, signals = np.arange(100.0), rng.standard_normal(100)
    Xdot = 0.5 * t + signals + 0.1 * rng.standard_normal(100)
    report = residual_report(Asks(), rng.normal(size=(100, 2)), Xdot, t, signals=signals)
    assert report.size[0].rmse < 0.15


def test_equal_seeds_give_equal_reports_and_units_do_not_matter():
    rng = np.random.default_rng(0)
    X, t = rng.uniform(-1, 1, (200, 2)), np.arange(200.0)
    Xdot = np.sign(X[:, 0]) + rng.standard_normal(200)
    one, two = (residual_report(Zero(), X, Xdot, t, random_state=3) for _ in range(2))
    assert one.to_dict() == two.to_dict()
    other = residual_report(Zero(), 64.0 * X, 0.5**10 * Xdot, 2.0 * t, random_state=3)
    # powers of two scale without rounding
    assert [test.p_value for test in other.tests] == [test.p_value for test in one.tests]
    assert other.size[0].ratio == pytest.approx(one.size[0].ratio, rel=1e-9)


@pytest.mark.parametrize("tails", ["normal", "outliers"])
def test_noise_floor(tails):
    rng = np.random.default_rng(0)
    t = np.arange(1500) * 0.02
    X = np.column_stack([np.sin(3 * t), np.cos(1.7 * t)])
    noise = 0.1 * rng.standard_normal(1500)
    if tails == "outliers":
        noise[rng.random(1500) < 0.03] *= 30
    law = np.sign(X[:, 1]) + X[:, 0] ** 2
    # a standard deviation of 1500 rows has an error of 2 %, of their differences a little more
    in_time = noise_floor(law + noise, groups=np.zeros(1500))
    assert in_time.how == "neighbours in time"
    assert in_time.value == pytest.approx(0.1, rel=0.25 if tails == "outliers" else 0.1)
    in_space = noise_floor(law + noise, X)
    assert in_space.how == "neighbours in space"
    assert in_space.value == pytest.approx(0.1, rel=0.25)
    assert np.isnan(noise_floor([1.0, 2.0]).value)


def test_shapes_in_words():
    x = np.linspace(-1, 1, 400)
    assert describe("x", x, x, 1.0) == "rising in a line"
    assert describe("x", x, np.where(x > 0.25, -1.0, 0.0), 1.0) == "a step at x=0.25"
    assert describe("x", x, np.sign(x) - 1.5 * x, 1.0) == "a step at x=0.00 and a line"
    assert describe("x", x, x**2, 1.0) == "a parabola"
    assert describe("x", x, np.sin(9 * x), 1.0) == "a curve"


def test_rearrangements_keep_blocks_together():
    orders = rearrangements(100, 20, 50, np.random.RandomState(0))
    assert (np.sort(orders, axis=1) == np.arange(100)).all()
    assert (orders[0] == np.arange(100)).all()
    # five blocks of a ring: at most five places where neighbours part, and the end of the ring
    assert ((np.diff(orders[1:], axis=1) % 100 != 1).sum(axis=1) <= 5).all()


def test_largest_statistics_decide():
    statistics = np.random.default_rng(0).standard_normal((30, 200))
    assert max_statistic(statistics).min() > 0.01
    statistics[4, 0] = 20.0
    assert max_statistic(statistics)[4] == 1 / 200


_X, _T = np.random.default_rng(0).normal(size=(50, 2)), np.arange(50.0)


@pytest.mark.parametrize(
    ("arguments", "options", "sentence"),
    [
        ((_X, None), {}, "Xdot is None; give numbers"),
        ((_X, _T[:-1]), {}, "Xdot has shape .49,.; give one row for each of the 50"),
        ((_X, np.where(_T == 3, np.nan, _T)), {}, "Xdot contains NaN or infinity"),
        ((_X, np.ones((50, 2))), {}, "predicts an array of shape"),
        ((_X[:20], _T[:20]), {}, "needs at least 30"),
        ((_X, _T, _T[::-1]), {}, "t must increase along every trajectory"),
        ((_X, _T, _T[:-1]), {}, "t has shape"),
        ((_X, _T, None, _T[:-1]), {}, "groups has shape"),
        (
            (_X, _T, None, None, _X[:-1]),
            {},
            "signals has shape .49, 2.; give one row for each of the 50",
        ),
        ((_X, _T), {"n_permutations": 99}, "use at least 124"),
        ((_X, _T), {"significance": 1.0}, "significance=1.0 must be a number above 0 and below 1"),
        ((_X, _T), {"n_lags": 0}, "n_lags=0 must be a positive integer"),
    ],
)
def test_wrong_arguments_are_answered_in_a_sentence(arguments, options, sentence):
    with pytest.raises(ValueError, match=sentence):
        residual_report(Zero(), *arguments, **options)


def test_a_model_must_predict():
    with pytest.raises(TypeError, match="object has no predict"):
        residual_report(object(), _X, _T)


def test_short_trajectories_say_what_is_skipped():
    report = residual_report(Zero(), _X, _X[:, 0], _T, np.repeat(np.arange(25), 2), random_state=0)
    assert "spectrum" in report.skipped and report.n_trajectories == 25
    with pytest.raises(ValueError, match="whiteness needs longer trajectories"):
        whiteness_test(_T, np.arange(50))


def test_coloured_trajectories_are_named():
    rng = np.random.default_rng(0)
    residual = np.concatenate([rng.standard_normal(300), autoregression(rng, 300, 0.6)])
    groups = np.repeat(["first run", "second run"], 300)
    assert whiteness_test(residual, groups).coloured_trajectories == ("second run",)


def test_the_picture_shows_what_was_found():
    report = Oscillator(PLANTED["v"], n_rows=300).report()
    display = report.plot()
    assert display.equation == "v"
    assert [ax.get_xlabel() for ax in display.ax_][::3] == ["v", "frequency (Hz)"]
    assert display.ax_[0].get_ylabel() == "residual of d/dt v"
    pair = _switching_report(lambda X, e: e + 0.3 * X[:, 0] * X[:, 1]).plot()
    assert (pair.ax_[0].get_xlabel(), pair.ax_[0].get_ylabel()) == ("x0", "x1")
    with pytest.raises(ValueError, match="'y' is none of the equations x, v"):
        report.plot("y")
    plt.close("all")


@pytest.mark.parametrize("tail", [0.0, 1e-300])
def test_a_constant_residual_is_a_bias_and_nothing_else(tail):
    # a record that has come to rest: nothing is divided by the spread of nothing
    residual = np.full(200, 0.5)
    residual[-1] += tail
    rest = np.cos(np.arange(200.0))  # what the velocities are, beside the residual of 0.5
    report = residual_report(Zero(), np.column_stack([rest, rest**2]), residual, np.arange(200.0))
    assert {finding.kind for finding in report.findings} <= {"bias"}


def test_a_threshold_has_the_digits_that_a_reader_needs():
    # a heater that is hardly ever on: the 5 % and 95 % quantiles are both 0
    assert rounded(0.5, np.repeat([0.0, 1.0], [980, 20])) == "0.50"
    assert rounded(2.3456789e-9, np.linspace(0.0, 5e-9, 50)) == "2.3e-09"
    assert rounded(123456789.0, np.linspace(0.0, 2e8, 50)) == "1.23e+08"
    assert rounded(0.123456, np.linspace(0.0, 1.0, 50)) == "0.12"


def test_no_verdict_contradicts_the_size_of_the_residual():
    # nine tenths of the residual are slow, in a record too short for any test to say in what
    rng = np.random.default_rng(0)
    jump = np.where(np.arange(120) < 60, -1.0, 1.0) + 0.05 * rng.standard_normal(120)
    X = rng.uniform(-1.0, 1.0, (120, 1))
    report = residual_report(Zero(), X, jump, groups=np.zeros(120), random_state=0)
    (size,) = (size for size in report.size if size.mode is None)
    assert size.explainable > 0.9
    (verdict,) = report.verdicts.values()
    assert "nothing is left" not in verdict and "follows no channel" not in verdict
    if not report.findings:
        assert "changes smoothly in time, though no test names what it depends on" in verdict
    titles = [ax.get_title() for ax in report.plot().ax_]
    assert not any("nothing found" in title for title in titles)
    plt.close("all")


def test_the_surface_inside_a_pipeline_a_search_or_a_model_with_effects_is_known():
    rng = np.random.default_rng(0)
    X = rng.uniform(-1.0, 1.0, (400, 2))
    Xdot = np.where(X[:, :1] > 0.1, -1.0, 1.0) * X + 0.02 * rng.standard_normal((400, 2))
    plain = SwitchingSystemRegressor(2, random_state=0)
    models = [
        plain,
        make_pipeline(FunctionTransformer(), plain),
        EffectRegressor(make_pipeline(FunctionTransformer(), plain)),
    ]
    for model in models:
        assert "surface" not in residual_report(model.fit(X, Xdot), X, Xdot, random_state=0).skipped
    switching = plain.switching_model
    stated = StatedModel(
        None, switching.coef, states=["x0", "x1"], surface=switching.surface
    )  # whose surface has no underscore
    assert "surface" not in residual_report(stated, X, Xdot, random_state=0).skipped
    one = SwitchingSystemRegressor(1).fit(X, Xdot)
    report = residual_report(one, X, Xdot, random_state=0)
    assert report.skipped["surface"] == "the model has one mode"


def test_bins_ignore_the_rounding_of_a_column_that_rests():
    rng = np.random.RandomState(0)
    resting = np.where(rng.rand(400) < 0.5, 0.0, rng.randn(400))
    rounded = resting + 1e-17 * rng.randn(400)  # as a filter leaves it
    rested, filtered = (make_channel("u", column, "input") for column in (resting, rounded))
    assert np.array_equal(rested.bins, filtered.bins)
    values = rng.randn(400)
    assert np.array_equal(rested.columns(values) != 0, filtered.columns(values) != 0)
