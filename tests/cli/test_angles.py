"""Angles that begin anew after a turn are unwrapped, and their sines are of radians."""

import numpy as np
import pytest

from swsysid import TrajectoryIdentifier
from swsysid._cli.job import run_job
from swsysid._cli.measurement import Measurement
from swsysid._cli.options import JobOptions
from swsysid._cli.samples import measure
from swsysid._cli.text import render
from swsysid._data.trajectories import turn_of
from swsysid._results import IdentificationWarning
from swsysid._tables.table import Table
from swsysid._verdict.terms import LawTerms, Terms
from swsysid.differentiation import differentiate

T = 0.01 * np.arange(1500)
RATE = 5.0 + np.sin(0.7 * T)
THETA = np.cumsum(RATE) * 0.01 + 1e-3 * np.random.default_rng(0).standard_normal(1500)
WRAPS = {
    "+-pi": lambda a: (a + np.pi) % (2.0 * np.pi) - np.pi,
    "0 to 2 pi": lambda a: a % (2.0 * np.pi),
    "+-180": lambda a: (np.degrees(a) + 180.0) % 360.0 - 180.0,
    "0 to 360": lambda a: np.degrees(a) % 360.0,
}


@pytest.mark.parametrize("wrap", WRAPS)
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_every_usual_range_is_recognised_and_unwrapped(wrap, direction):
    values = WRAPS[wrap](direction * THETA)
    turn = turn_of([values])
    assert turn == (360.0 if "0" in wrap[-2:] else 2.0 * np.pi)
    table = Table("log", {"t": T, "theta": values, "w": RATE}, {})
    samples = measure(table, Measurement(states=("theta", "w"), time="t"))
    recorded = samples.recorded.states[:, 0] * 2.0 * np.pi / turn
    np.testing.assert_allclose(np.diff(recorded), direction * np.diff(THETA), atol=1e-9)
    assert samples.unit("theta") == ("deg" if turn == 360.0 else "rad")
    assert any("theta begins anew after" in remark for remark in samples.remarks)


def test_a_column_around_the_end_of_the_range_is_an_angle_too():
    hovering = WRAPS["+-pi"](np.pi + 0.3 * np.sin(THETA))  # a pendulum that stands upright
    assert turn_of([hovering]) == pytest.approx(2.0 * np.pi)


def test_an_angle_that_moves_by_single_counts_amid_rests_is_one():
    assert turn_of([np.floor(np.linspace(0.0, 12.0 * 57.0, 3000)) % 360.0]) == 360.0


@pytest.mark.parametrize(
    "values",
    [
        np.where(np.sin(T) > 0, np.pi, -np.pi),  # a relay
        5.0 * (T % 1.0),  # a state that is reset from 5 to 0
        np.clip(8.0 * np.sin(T), -np.pi, np.pi),
        3.2 * np.sign(np.sin(T)) + 0.01 * np.sin(50.0 * T),
        THETA,
        180.0 * np.random.default_rng(1).uniform(-1.0, 1.0, 1500),
        np.append(np.repeat(np.random.default_rng(0).uniform(2.9, 4.66, 30), 50), 0.0),  # volts
        np.repeat([0.0, 2.3, 4.6, 2.3, 0.0, 4.6, 0.0], 50),
    ],
)
def test_what_jumps_otherwise_is_no_angle(values):
    assert turn_of([values]) is None


def test_the_unit_of_the_user_decides():
    table = Table("log", {"t": T, "q": WRAPS["0 to 360"](THETA)}, {"q": "m"})
    with pytest.warns(IdentificationWarning, match="q begins anew"):
        samples = measure(table, Measurement(states=("q",), time="t"))
    assert np.ptp(samples.recorded.states) < 360.0


def test_a_pendulum_in_degrees_has_the_law_of_one_in_radians():
    rng = np.random.default_rng(2)
    theta, omega = rng.uniform(-20.0, 20.0, 600), rng.uniform(-5.0, 5.0, 600)
    rate = -9.0 * np.sin(theta) - 0.3 * omega
    columns = {"theta": theta, "omega": omega, "dtheta": omega, "domega": rate}
    what = Measurement(states=("theta", "omega"), derivatives=("dtheta", "domega"))
    options = JobOptions(what, modes=1, waves=True)
    in_degrees = {name: np.degrees(values) for name, values in columns.items()}
    units = [{"theta": unit, "omega": f"{unit}/s"} for unit in ("rad", "deg")]
    laws = [
        run_job(Table("made", each, unit), options)
        for each, unit in zip((columns, in_degrees), units, strict=True)
    ]
    names = ["1", "theta", "omega", "sin(theta)", "cos(theta)"]
    assert list(laws[1].model.feature_names_out_) == names
    np.testing.assert_allclose(laws[0].model.coef_[0, 1], [0, 0, -0.3, -9.0, 0], atol=1e-6)
    np.testing.assert_allclose(
        laws[1].model.coef_[0, 1], [0, 0, -0.3, np.degrees(-9.0), 0], atol=1e-4
    )
    assert "Sines and cosines are those of theta, with theta in radians." in render(laws[1])


def test_both_forms_of_the_terms_have_the_same_values():
    X = np.random.default_rng(3).uniform(-90.0, 90.0, (40, 3))
    terms = Terms((0, 2), 1, True, angles=(2,), degrees=(1, 2))
    values = terms.library(3).fit_transform(X)
    np.testing.assert_allclose(values[:, 3:], np.column_stack([
        np.sin(np.radians(X[:, 2])), np.cos(np.radians(X[:, 2]))
    ]))  # fmt: skip
    fast = terms.of_rival()["feature_library"]
    assert isinstance(fast, LawTerms) and terms.n_features == values.shape[1]
    np.testing.assert_allclose(fast.fit_transform(X)[:, 3:], values[:, 3:])


def test_python_users_are_told_how_to_unwrap():
    values = np.column_stack([WRAPS["0 to 360"](THETA), RATE])
    with pytest.warns(IdentificationWarning, match=r"np.unwrap\(values, period=360\)"):
        differentiate(values, T)
    short = [{"t": T[:200], "x": WRAPS["+-pi"](THETA[:200])[:, None]}]
    with pytest.warns(IdentificationWarning, match=r"turn of 2 pi.*np.unwrap\(values\) along"):
        TrajectoryIdentifier().fit(short)
