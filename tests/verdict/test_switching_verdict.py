"""The verdict on modes identified from recordings, in Python and as the command line prints it."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from sklearn.exceptions import NotFittedError

from swsysid import (
    HybridAutomaton,
    HybridAutomatonRegressor,
    PolynomialSurfaceClassifier,
    SwitchingSystemRegressor,
    TrajectoryIdentifier,
    load_model,
    save_model,
)
from swsysid.__main__ import main
from swsysid._stays.given import read_given
from swsysid._verdict.words import COMMAND_LINE
from swsysid.datasets import make_damped_oscillator
from swsysid.diagnosis import switching_verdict
from swsysid.refinement import StatedModel, StatedSurface
from swsysid.results import SwitchingVerdict, Verdict

T = np.arange(0.0, 7.5, 0.05)
NOISE = 0.01
CONTACT = StatedModel(
    1,
    [[[0.0, 0.0, 1.0], [0.0, -1.0, -0.1]], [[0.0, 0.0, 1.0], [10.0, -21.0, -0.6]]],
    states=["x", "v"],
    surface=StatedSurface([[-0.5, 1.0, 0.0]]),  # a bumper from x = 0.5 on
)
CUBIC = StatedModel(3, [[[0.0, 1.0, 0.0, -1.0]]], states=["x"])  # x' = x - x^3
HEATER = HybridAutomaton.stated(
    [{"T": "-0.1 (T - 30)"}, {"T": "-0.1 (T - 10)"}],
    [(0, 1, "T >= 22"), (1, 0, "T <= 18")],
    states=["T"],
)


def noisy(runs, noise=NOISE):
    generator = np.random.default_rng(0)
    return [run + noise * generator.standard_normal(run.shape) for run in runs]


def rows_of_contact(n_runs):
    """A frame of states, times and recordings."""
    starts = np.random.default_rng(1).uniform([-1.5, -1.5], [0.4, 1.5], (8, 2))[:n_runs]
    x = np.vstack(noisy([CONTACT.simulate(start, T).x for start in starts]))
    frame = pd.DataFrame(x, columns=["x", "v"])
    return frame, np.tile(T, n_runs), np.repeat(np.arange(n_runs), len(T))


def identifier(**options):
    surface = PolynomialSurfaceClassifier(degree=1)
    asked = {"feature_library": 1, "surface": surface, "random_state": 0} | options
    return TrajectoryIdentifier(SwitchingSystemRegressor(**asked))


@pytest.fixture(scope="module")
def contact():
    return identifier().fit(*rows_of_contact(6))


def test_a_planted_switch_is_trusted(contact):
    verdict = contact.verdict_
    assert isinstance(verdict, SwitchingVerdict)
    assert verdict.kind is Verdict.SWITCHES and verdict.trusted and verdict.stands
    assert verdict.channels == ("x", "v") and verdict.n_modes == 2
    # laws that never saw these samples leave their noise; 15 % is the error of 300 samples and laws
    assert verdict.errors == pytest.approx([NOISE, NOISE], rel=0.15)
    assert verdict.noise == pytest.approx([NOISE, NOISE], rel=0.15)
    best = verdict.errors_of_laws[verdict.best_law]
    assert (best > 2.0 * NOISE).all() and verdict.gain > 2.0
    assert verdict.improvement > 0.5
    assert verdict.free_of_held_out.holds
    assert str(verdict).endswith(verdict.sentence)
    assert repr(verdict) == "SwitchingVerdict(SWITCHES, n_modes=2, trusted)"


@pytest.mark.nightly
def test_what_is_known_holds_in_the_verdict_too():
    """What is true leaves what held-out rollouts leave; what is 10 % off does not."""
    plant = make_damped_oscillator(None, n_trajectories=4, time_step=0.05, random_state=0)
    x = plant.X + 0.02 * np.random.default_rng(0).standard_normal(plant.X.shape)
    right, wrong = (
        identifier(sparsity="auto").set_params(known=[told]).fit(x, plant.t, plant.groups).verdict_
        for told in ("x1'[x0] same in all modes", "x1'[x0] = -1.1")
    )
    assert right.kind is Verdict.SWITCHES
    assert right.errors == pytest.approx(right.noise, rel=0.15)  # as above: 240 samples and laws
    assert (wrong.errors > 1.5 * right.errors).all() and wrong.kind is not Verdict.SWITCHES
    # a law of more terms, of which nothing is known, is the same rival
    assert wrong.errors_of_laws["cubic"] == pytest.approx(right.errors_of_laws["cubic"], rel=0.01)


def test_where_a_smooth_law_follows_short_stretches_longer_ones_tell():
    # damped by 0.1 or 0.5: over 30 samples a cubic law is at the noise
    plant = make_damped_oscillator(None, n_trajectories=4, time_step=0.05, random_state=0)
    x = plant.X + 0.05 * np.random.default_rng(0).standard_normal(plant.X.shape)
    verdict = identifier(sparsity="auto").fit(x, plant.t, plant.groups).verdict_
    # the last 60 samples of each recording, whole
    assert verdict.comparison.stretch == 60 == np.bincount(verdict.comparison.blocks).max()
    assert len(set(verdict.comparison.blocks.tolist())) == 4
    assert "over stretches of 60 samples" in verdict.table()
    assert verdict.kind is Verdict.SWITCHES and verdict.gain > 2.0


def test_it_is_what_the_command_line_prints(contact, tmp_path, capsys):
    frame, t, run = rows_of_contact(6)
    frame.assign(t=t, run=run).to_csv(tmp_path / "runs.csv", index=False, float_format="%.17g")
    arguments = ["--states", "x", "v", "--time", "t", "--groups", "run"]
    assert main([str(tmp_path / "runs.csv"), *arguments, "--output", str(tmp_path)]) == 0
    printed, verdict = capsys.readouterr().out, replace(contact.verdict_, words=COMMAND_LINE)
    assert f"\n\n{verdict.table()}\n\n{verdict.sentence}\n" in printed


@pytest.mark.nightly
def test_modes_of_a_smooth_law_are_not_trusted():
    t = np.arange(0.0, 4.0, 0.04)
    runs = noisy([CUBIC.simulate([x0], t).x for x0 in (-1.9, -0.05, 0.1, 1.7, 0.3, -0.6)])
    found = identifier().fit([{"t": t, "x": run} for run in runs])
    verdict = found.verdict_
    assert found.n_modes_ == 2 and not verdict.trusted
    assert verdict.kind is Verdict.SMOOTH and verdict.best_law == "cubic"
    # the law that generated them leaves their noise
    assert verdict.errors_of_laws["cubic"] == pytest.approx([NOISE], rel=0.15)
    assert "ask for that law: n_modes=1, feature_library=3" in verdict.sentence
    assert "--" not in verdict.sentence
    advised = identifier(n_modes=1, feature_library=3).fit([{"t": t, "x": run} for run in runs])
    assert advised.verdict_.trusted and advised.verdict_.sentence.startswith("No switching")


@pytest.fixture(scope="module")
def tank():
    """A tank at rest until 5, filled until 10, drained from then on; all but empty from 40 on."""
    t = np.arange(0.0, 100.0, 0.2)
    level = np.where(t < 10.0, 8.0 * np.maximum(t - 5.0, 0.0), 40.0 * np.exp((10.0 - t) / 8.0))
    return [{"t": t, "x": run} for run in noisy([level], 0.1)]


def test_a_law_of_what_stands_still_is_no_rival(tank):
    """The held-out end is empty: a quadratic law leaves noise there, and far more before.

    It was called as good as the modes, and advised.
    """
    found = identifier().fit(tank)
    verdict = found.verdict_
    assert found.n_modes_ == 2 and verdict.stands
    best = verdict.errors_of_laws[verdict.best_law]
    # the deviation of 150 samples varies by 6 %
    assert best == pytest.approx([0.1], rel=0.2) and verdict.comparison.noise_alone
    assert verdict.comparison.lacks_something
    told = "leave nothing but noise, which no smooth law that was tried does"
    assert told in verdict.sentence and "ask for that law" not in verdict.sentence


def test_one_mode_proves_itself_by_what_it_was_made_from(tank):
    verdict = identifier(n_modes=1).fit(tank).verdict_
    assert not verdict.trusted and verdict.comparison.lacks_something
    assert verdict.sentence.startswith("Whether it switches is not shown: the model has one mode")
    assert "more than noise of the other samples" in verdict.sentence
    assert "ask for that law" not in verdict.sentence


def test_units_change_nothing(contact):
    frame, t, run = rows_of_contact(6)
    scaled = identifier().fit(frame * [1e3, 1e-3], t, run).verdict_
    assert scaled.kind is contact.verdict_.kind
    # the descents stop within a hundredth of a standard error
    assert scaled.improvement == pytest.approx(contact.verdict_.improvement, abs=0.01)
    assert scaled.errors == pytest.approx(contact.verdict_.errors * [1e3, 1e-3], rel=0.02)


def test_it_is_made_once_and_saved(contact, tmp_path):
    assert contact.verdict_ is contact.verdict_
    save_model(contact, tmp_path / "judged.json")
    loaded = load_model(tmp_path / "judged.json")
    assert str(loaded.verdict_) == str(contact.verdict_)
    assert '"_recordings"' not in (tmp_path / "judged.json").read_text(encoding="utf-8")


def test_no_verdict_without_a_fit_or_its_recordings(tmp_path):
    with pytest.raises(NotFittedError):
        identifier().verdict_  # noqa: B018
    frame, t, run = rows_of_contact(2)
    found = identifier(n_modes=1).fit(frame, t, run)
    save_model(found, tmp_path / "alone.json")
    with pytest.raises(AttributeError, match="needs the recordings"):
        load_model(tmp_path / "alone.json").verdict_  # noqa: B018


def test_what_is_too_short_to_hold_samples_out_is_said():
    frame, t, run = rows_of_contact(2)
    short = np.tile(np.arange(len(T)) < 10, 2)
    found = identifier(n_modes=1).fit(frame[short], t[short], run[short])
    with pytest.raises(ValueError, match="too short for a verdict: with 30% held out, one keeps 7"):
        found.verdict_  # noqa: B018


def test_another_fit_has_another_verdict():
    frame, t, run = rows_of_contact(5)
    found = identifier(n_modes=1).fit(frame, t, run)
    before = found.verdict_
    assert found.fit(frame, t, run).verdict_ is not before


@pytest.mark.parametrize("noise", [0.0, 0.03])
def test_a_guard_that_remembers_is_trusted(noise):
    t = np.arange(0.0, 30.0, 0.1)
    runs = noisy([HEATER.simulate([T0], t, mode=0).x for T0 in (15, 17, 19, 16, 20)], noise)
    found = HybridAutomatonRegressor(random_state=0).fit([{"t": t, "x": run} for run in runs])
    verdict = found.verdict_
    assert verdict.kind is Verdict.SWITCHES and verdict.trusted and verdict.n_modes == 2
    assert verdict.errors == pytest.approx([noise], rel=0.15, abs=1e-5)
    assert verdict.errors_of_laws[verdict.best_law] > 0.3  # of a temperature between 18 and 22


def test_a_jump_of_a_single_mode_is_no_smooth_law():
    ball = HybridAutomaton.stated(
        [{"h": "v", "v": "-9.81"}], [(0, 0, "h <= 0", {"v": "-0.8 v"})], states=["h", "v"]
    )
    t = np.arange(0.0, 1.5, 0.02)
    runs = noisy([ball.simulate([h, 0], t, mode=0).x for h in (2.0, 1.5, 1.8, 1.2, 1.0)], 0.005)
    found = HybridAutomatonRegressor(1, random_state=0).fit([{"t": t, "x": run} for run in runs])
    verdict = found.verdict_
    assert found.n_modes_ == 1 and verdict.kind is Verdict.SWITCHES and verdict.trusted
    assert "1 mode, affine" in verdict.table()


def test_a_ball_in_a_short_video_is_no_smooth_law():
    """110 frames, 30 a second, of which 33 are held out in four stretches."""
    ball = HybridAutomaton.stated(
        [{"h": "v", "v": "-9.81"}], [(0, 0, "h <= 0", {"v": "-0.85 v"})], states=["h", "v"]
    )
    t = np.arange(110) / 30.0
    (height,) = noisy([ball.simulate([1.2, 0.0], t, mode=0).x[:, :1]], 0.0015)
    found = HybridAutomatonRegressor(1, order=2, random_state=0).fit([{"t": t, "x": height}])
    verdict = found.verdict_
    assert verdict.kind is Verdict.SWITCHES and len(verdict.comparison.errors) == 33
    assert verdict.comparison.n_blocks == 4 and verdict.improvement > 0.9


@pytest.mark.nightly
@pytest.mark.filterwarnings("ignore:The switches")  # a GuardWarning says so, too
def test_modes_that_somebody_switches_are_there_and_the_model_is_not_trusted():
    """A valve is opened and closed at will: the level rises to 2 or falls to 0."""
    generator, recordings = np.random.default_rng(3), []
    for _ in range(6):
        level, mode, left, rows = 0.5, 0, 1.0, []
        for _ in range(400):
            rows.append(level)
            level += 0.05 * (1.0 - 0.5 * level if mode == 0 else -0.5 * level)
            left -= 0.05
            if left <= 0.0:
                mode, left = 1 - mode, generator.uniform(0.4, 1.6)
        noisy = np.array(rows)[:, None] + 0.002 * generator.standard_normal((400, 1))
        recordings.append({"t": 0.05 * np.arange(400), "x": noisy})
    verdict = HybridAutomatonRegressor(2, random_state=0).fit(recordings).verdict_
    assert verdict.kind is Verdict.HIDDEN and not verdict.trusted
    assert "the modes are there" in verdict.sentence and "Record the signal" in verdict.sentence


def test_one_law_of_a_room_lacks_nothing_though_its_heater_switches_between_rows():
    """Laws of a part of the recording are not told when it does so in the rest."""
    temperature, heater, rows = 16.0, 1.0, []
    for _ in range(400):
        rows.append((temperature, heater))
        for _ in range(50):
            temperature += 0.01 * (1.5 - 0.1 * temperature + 1.2 * heater)
            heater = 0.0 if temperature > 21.0 else 1.0 if temperature < 17.0 else heater
    T_room, u = np.array(rows).T
    x = T_room[:, None] + 0.02 * np.random.default_rng(0).standard_normal((400, 1))
    fit = identifier(n_modes=1).fit(x, 0.5 * np.arange(400), inputs=u[:, None])
    assert fit.coef_[0, 0] == pytest.approx([1.5, -0.1, 1.2], rel=0.03)
    verdict = fit.verdict_
    assert verdict.comparison.lacks_something and verdict.errors[0] > 0.05  # the laws of a part
    assert verdict.trusted and verdict.sentence.startswith("No switching")


def test_a_map_that_switches_is_trusted():
    def run(x, mode=0):
        states = []
        for _ in range(120):
            states.append(x)
            mode = 1 if x > 1.0 else 0 if x < -1.0 else mode
            x = 0.9 * x + 0.3 if mode == 0 else 0.8 * x - 0.5
        return np.array(states)[:, None]

    recordings = [{"t": np.arange(120.0), "x": run(x)} for x in (-0.5, 0.2, 0.4, 0.7, -0.3)]
    found = HybridAutomatonRegressor(discrete_time=True, random_state=0).fit(recordings)
    assert found.verdict_.trusted and found.verdict_.errors == pytest.approx([0.0], abs=1e-6)


# -- rows with velocities --------------------------------------------------------------------------


def spring(kind):
    """Rows of a spring, stiffer on one side or cubic, that is pushed."""
    generator = np.random.default_rng(2)
    x, u = generator.uniform(-1, 1, (2, 1500))
    force = {"stiffer": np.where(x > 0, 5.0, 1.0) * x, "cubic": x + 3.0 * x**3}[kind]
    rate = u - force + NOISE * generator.standard_normal(1500)
    return pd.DataFrame({"x": x, "u": u}), rate, np.repeat(np.arange(6), 250)


@pytest.mark.filterwarnings("ignore:Samples at neighbouring")  # of the cubic spring: it says so too
@pytest.mark.parametrize(
    ("kind", "verdict"), [("stiffer", Verdict.SWITCHES), ("cubic", Verdict.SMOOTH)]
)
def test_of_rows_it_is_what_the_command_line_prints(kind, verdict, tmp_path, capsys):
    X, rate, run = spring(kind)
    model = SwitchingSystemRegressor(
        feature_library=1, surface=PolynomialSurfaceClassifier(degree=1), random_state=0
    )
    found = switching_verdict(model.fit(X, rate, groups=run), X, rate, run)
    assert found.kind is verdict and found.trusted == (verdict is Verdict.SWITCHES)
    laws = found.errors_of_laws | ({"modes": found.errors} if found.trusted else {})
    truth = "modes" if found.trusted else "cubic"
    assert laws[truth] == pytest.approx([NOISE], rel=0.15)  # nothing but noise
    path = tmp_path / "spring.csv"
    X.assign(rate=rate, run=run).to_csv(path, index=False, float_format="%.17g")
    roles = ["--states", "x", "--inputs", "u", "--derivatives", "rate", "--groups", "run"]
    assert main([str(path), *roles, "--output", str(tmp_path)]) == 0
    printed, same = capsys.readouterr().out, replace(found, words=COMMAND_LINE)
    assert f"\n{same.sentence}\n" in printed
    assert same.table().partition("\n")[0] in printed  # how much is held out


@pytest.mark.filterwarnings("ignore:Samples at neighbouring")
def test_other_rows_than_those_of_the_fit_are_refused():
    X, rate, _ = spring("cubic")
    model = SwitchingSystemRegressor(random_state=0).fit(X, rate)
    with pytest.raises(ValueError, match="fitted to 1500; give those"):
        switching_verdict(model, X[:100], rate[:100])
    with pytest.raises(TypeError, match="must be a fitted SwitchingSystemRegressor"):
        switching_verdict(TrajectoryIdentifier(), X, rate)


def test_rows_are_given_again_as_they_were():
    """Frames with names, lost values, an event and inputs."""
    generator = np.random.default_rng(3)
    t = np.r_[0.0:1.0:0.1, 0.9, 1.0:2.0:0.1]
    x = pd.DataFrame(generator.standard_normal((len(t), 2)), columns=["x", "v"])
    x.iloc[4, 1] = np.nan
    u = pd.DataFrame({"force": generator.standard_normal(len(t))})
    first = read_given(x, t, None, u)
    again = read_given(*first.data())
    assert again.names == first.names == ["x", "v", "force"]
    for one, other in zip(first.records, again.records, strict=True):
        np.testing.assert_array_equal(one.t, other.t)
        np.testing.assert_array_equal(one.y, other.y)
        np.testing.assert_array_equal(one.u, other.u)
    some = first.data(np.arange(len(t)) < 12)
    assert [len(part) for part in some] == [12] * 4
