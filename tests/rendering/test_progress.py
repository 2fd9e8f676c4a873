"""Progress goes to standard error: bars at a terminal, lines elsewhere, and both end full."""

import sys
from time import sleep

import numpy as np
import pytest

from swsysid import (
    EffectSearchCV,
    HybridAutomatonRegressor,
    SwitchingSystemRegressor,
    TrajectoryIdentifier,
)
from swsysid._rendering import progress as module
from swsysid._rendering.progress import progress, stage, watched
from swsysid.effects import CoulombFriction
from swsysid.refinement import StatedModel, refine

T = np.linspace(0.0, 3.0, 7)
DECAY = {"t": T, "x": np.exp(-2.0 * T)}


PLACES = pytest.mark.parametrize("place", ["terminal", "file"])


def _is(place, monkeypatch):
    """Make standard error a terminal, or no terminal, both in quick time."""
    monkeypatch.setattr(module, "_BEAT", 0.05)
    monkeypatch.setattr(module, "_LINE", 0.05)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: place == "terminal")


def _last(written):
    """What a terminal shows at the end of each bar."""
    return [line.split("\r")[-1] for line in written.split("\n") if line]


@pytest.mark.parametrize("most", [10, None])
def test_a_bar_ends_full_when_the_work_ends_early(most, capsys):
    with progress(most, "rounds", verbose=True) as bar:
        bar.update(3)
    (shown,) = _last(capsys.readouterr().err)
    assert shown.startswith("rounds: 100%") and "3/3" in shown


@PLACES
def test_short_work_leaves_its_full_bar_only(place, capsys, monkeypatch):
    _is(place, monkeypatch)
    assert list(watched([1, 2, 3], "steps", verbose=True)) == [1, 2, 3]
    drawn = [frame for frame in capsys.readouterr().err.split("\r") if frame]
    assert drawn and all("3/3" in frame for frame in drawn)


@PLACES
def test_a_long_step_is_seen_to_go_on(place, capsys, monkeypatch):
    _is(place, monkeypatch)
    with progress(None, "rounds", verbose=True):
        sleep(0.4)
    told = capsys.readouterr().err
    assert told.count("rounds: 0it") >= 2
    # a file is not written over
    assert ("\r" in told) == (place == "terminal")


def test_a_long_stage_that_nobody_watches_gets_a_line_now_and_then(capsys, monkeypatch):
    monkeypatch.setattr(module, "_BEAT", 0.05)
    monkeypatch.setattr(module, "_LINE", 0.05)
    with stage("Reading", verbose=False):
        pass
    assert capsys.readouterr().err == ""
    with stage("Reading", verbose=False):
        sleep(0.4)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) >= 2 and set(lines) == {"Reading ... 0 s"}
    with stage("Reading", verbose=True):
        sleep(0.2)
    assert capsys.readouterr().err == "Reading ...\n"


@PLACES
def test_the_first_sign_comes_with_the_second_second(place, capsys, monkeypatch):
    _is(place, monkeypatch)
    monkeypatch.setattr(module, "_LINE", 10.0)
    with progress(None, "rounds", verbose=True), stage("Reading", verbose=False):
        sleep(0.4)
        told = capsys.readouterr().err
    assert "rounds: 0it" in told and "Reading ... 0 s" in told


@PLACES
def test_work_that_fails_leaves_no_bar_open(place, capsys, monkeypatch):
    _is(place, monkeypatch)
    with pytest.raises(RuntimeError), progress(3, "rounds", verbose=True):
        sleep(0.2)
        raise RuntimeError
    shown = capsys.readouterr().err
    assert "0/3" in shown and shown.endswith("\n")
    with pytest.raises(RuntimeError), progress(3, "rounds", verbose=True):
        raise RuntimeError
    assert capsys.readouterr().err == ""  # a refusal comes without a bar


def test_an_identification_from_recordings_shows_its_rounds(capsys):
    t = np.linspace(0.0, 5.0, 60)
    noise = 0.01 * np.random.default_rng(0).standard_normal(60)
    one = SwitchingSystemRegressor(n_modes=1, random_state=0)
    found = TrajectoryIdentifier(one, verbose=1).fit(np.exp(-t) + noise, t)
    (shown,) = _last(capsys.readouterr().err)
    assert shown.startswith("rounds: 100%")
    assert found.history_


def test_refine_shows_its_integrations(capsys):
    model = StatedModel(None, [[-0.5]], states=["x"])
    silent = refine(model, DECAY)
    assert capsys.readouterr().err == ""
    told = refine(model, DECAY, verbose=1)
    (shown,) = _last(capsys.readouterr().err)
    assert shown.startswith("integrations: 100%") and f"{told.nfev}/{told.nfev}" in shown
    np.testing.assert_array_equal(told.values, silent.values)


def test_a_wrong_verbosity_is_refused():
    with pytest.raises(ValueError, match="verbose"):
        refine(StatedModel(None, [[-0.5]], states=["x"]), DECAY, verbose=-1)


def test_the_bar_of_a_search_that_finds_less_ends_full(capsys):
    X = np.random.default_rng(0).uniform(-2, 2, (300, 2))
    y = X[:, 1] - X[:, 0] - 0.8 * np.sign(X[:, 0])
    y += 0.01 * np.random.default_rng(1).standard_normal(300)
    plain = SwitchingSystemRegressor(n_modes=1, feature_library=1)
    search = EffectSearchCV(plain, effects=[CoulombFriction()], cv=3, random_state=0, verbose=1)
    search.fit(X, y)
    ends = [line for line in _last(capsys.readouterr().err) if line.startswith("rounds")]
    assert ends and all("100%" in line for line in ends)


def test_a_search_that_rolls_recordings_out_has_a_bar_as_well(capsys):
    t = np.arange(0.0, 12.0, 0.02)
    u = np.repeat(np.random.default_rng(0).uniform(-2.0, 2.0, 20), 30)
    x = np.zeros(len(t))
    for k in range(len(t) - 1):
        x[k + 1] = x[k] + 0.02 * (u[k] - x[k])
    x += 0.01 * np.random.default_rng(1).standard_normal(len(x))
    plain = SwitchingSystemRegressor(n_modes=1, feature_library=1)
    search = EffectSearchCV(plain, effects=[CoulombFriction()], random_state=0, verbose=1)
    search.fit(x[:, None], t=t, inputs=u[:, None])
    assert "rounds of the search: 100%" in capsys.readouterr().err


@pytest.mark.filterwarnings("ignore::swsysid.IdentificationWarning")
@pytest.mark.parametrize(("name", "shown"), [
    ("rows", "starts: 100%"), ("automaton", "rounds: 100%"), ("search", "rounds of the search"),
])  # fmt: skip
def test_all_that_take_long_print_whole_lines_where_there_is_no_terminal(
    name, shown, capsys, monkeypatch
):
    _is("file", monkeypatch)
    t = np.arange(0.0, 6.0, 0.1)
    x = np.column_stack([np.sin(t), np.cos(t)]) + 0.01 * np.random.default_rng(0).normal(
        size=(60, 2)
    )
    plain = SwitchingSystemRegressor(2, n_init=2, random_state=0)
    if name == "rows":
        plain.set_params(verbose=1).fit(x, np.where(x[:, :1] > 0.0, -x, x))
    elif name == "automaton":
        HybridAutomatonRegressor(1, random_state=0, verbose=1).fit(x, t)
    else:
        y = np.where(x[:, :1] > 0.0, -x, x) + 0.5 * np.sign(x[:, 1:])
        effects = [CoulombFriction()]
        EffectSearchCV(plain, effects=effects, cv=3, random_state=0, verbose=1).fit(x, y)
    told = capsys.readouterr().err
    assert shown in told and "\r" not in told and told.endswith("\n")
