"""What a report of an automaton says holds when the automaton is run, or is not said."""

import re
import warnings
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from swsysid import GuardWarning, HybridAutomaton, HybridAutomatonRegressor, MisfitWarning
from swsysid._automaton.transitions import PolynomialGuard
from swsysid._automaton_search.assembly import TransitionVerdict
from swsysid._automaton_search.doubts import doubts_of, imitates, strays, untold_switches
from swsysid._automaton_search.found import FoundGuard
from swsysid._automaton_search.judged import by_rollouts
from swsysid._automaton_search.resets import best_reset
from swsysid._discrete_stays.identify import KindsOfNoise

FINE = "guards tell all switches"
STEPS = np.arange(200)
RELAY = HybridAutomaton.stated(
    [{"T": "0.9 T + 3"}, {"T": "0.9 T + 1"}],
    [(0, 1, "T >= 22"), (1, 0, "T <= 18")],
    states=["T"],
    discrete_time=True,
)


def recordings(plant, starts, steps=STEPS, noise=0.0, **options):
    rng = np.random.default_rng(0)
    runs = [plant.simulate(np.atleast_1d(start), steps, mode=0, **options) for start in starts]
    return [
        {"t": np.asarray(steps), "x": run.x + noise * rng.standard_normal(run.x.shape)}
        for run in runs
    ]


def discrete(*args, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return HybridAutomatonRegressor(discrete_time=True, random_state=0, **options).fit(*args)


def test_where_rollouts_hold_guards_tell_all_switches():
    found = discrete(recordings(RELAY, [15.0, 16.3, 19.9]))
    told = found.report_.rollouts
    assert (
        told.holds
        and told.tells_switches
        and told.n_switches == len(np.concatenate(found.switch_times_))
    )
    assert FINE in found.report_.advice
    assert f"all {told.n_switches} switches within 1 sample" in str(found.report_)


def test_a_threshold_lies_between_the_samples_that_it_is_printed_with():
    data = recordings(RELAY, [15.0, 16.3, 19.9, 17.1])
    found = discrete(data)
    for line, threshold in ((">=", 22.0), ("<=", 18.0)):
        pattern = rf"x0\[k\] {line} (\S+) \((\S+) to (\S+)\)"
        value, low, high = map(float, re.search(pattern, str(found.report_)).groups())
        assert low < threshold < high and low < value < high
        [one] = [own for own in found.transitions_ if (own.guard.coef[-1] > 0.0) == (line == ">=")]
        samples = np.concatenate([own["x"][:, 0] for own in data])[found.modes_ == one.source]
        # none of its mode is inside
        assert not ((samples > low + 2e-3) & (samples < high - 2e-3)).any()


def test_one_switch_determines_no_guard_and_its_rivals_are_named():
    valve = HybridAutomaton.stated(
        [{"x": "0.9 x + 1"}, {"x": "0.8 x"}], [(0, 1, "x >= 7")], states=["x"], discrete_time=True
    )
    found = discrete(recordings(valve, [0.0], np.arange(40)))
    [verdict] = found.verdicts_
    assert (verdict.support, verdict.n_coefficients, verdict.is_determined) == (1, 2, False)
    [doubt] = [one for one in found.report_.doubts if "not determined" in one]
    assert "rests on one switch" in doubt and "`time >=" in doubt


def test_two_exits_at_one_guard_are_said_and_what_tells_them_apart():
    laws = [(0.02, 0.01), (-0.03, 0.018), (-0.014, -0.026)]
    data = []
    for start in range(3):
        x, y, mode, rows = 0.1 * start, 0.3 * (-1) ** start, 0, []
        for _ in range(400):
            rows.append((x, y))
            if mode == 0 and x >= 1.0:
                mode = 1 if y < 0.0 else 2
            elif mode and x <= 0.0:
                mode = 0
            x, y = x + laws[mode][0], 0.984 * y + laws[mode][1]
        data.append({"t": np.arange(400), "x": np.array(rows)})
    found = discrete(data, n_modes=3)
    assert found.score(data) < 0.5  # eleven exits are too few for a second condition
    assert FINE not in str(found.report_)
    assert "where the same guard rises" in str(found.report_)
    assert re.search(r"x1\[k\] may tell which", str(found.report_))
    assert not found.report_.rollouts.holds


def turning(step):
    """A relay that closes where the cosine of an angle that goes on turning rises to .95."""
    data = []
    for start in range(6):
        x, angle, closed, rows = 0.1 * start, 0.7 * start, True, []
        for _ in range(400):
            rows.append((x, angle))
            if closed and x >= 0.9:
                closed = False
            elif not closed and np.cos(angle) >= 0.95:
                closed = True
            x, angle = x + 0.1 * (closed - x), angle + 0.07 + 0.02 * x
        data.append({"t": step * np.arange(400), "x": np.array(rows)})
    return data


def warned(data, **options):
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        found = HybridAutomatonRegressor(random_state=0, **options).fit(data)
    return found, [
        str(one.message) for one in said if one.category in (GuardWarning, MisfitWarning)
    ]


@pytest.mark.parametrize("discrete_time", [True, False])
def test_the_transition_that_no_guard_of_the_library_tells_is_named(discrete_time):
    found, said = warned(turning(1.0 if discrete_time else 0.1), discrete_time=discrete_time)
    opened = int(np.argmin(found.coef_[:, 0, 0]))  # its law has no source
    assert found.n_modes_ == 2 and found.report_.rollouts.left_of_each.max() > 3.0
    [sentence] = said
    assert f"{opened} -> {1 - opened}" in sentence and f"{1 - opened} -> {opened}" not in sentence
    assert FINE not in str(found.report_)


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_what_follows_its_recordings_warns_of_nothing(noise):
    """The relay, and a plant whose guards are told in continuous time."""
    starts = [15.0, 16.3, 19.9, 17.1]
    assert warned(recordings(RELAY, starts, noise=noise), discrete_time=True)[1] == []
    heater = HybridAutomaton.stated(
        [{"T": "-0.1 (T - 30)"}, {"T": "-0.1 (T - 10)"}],
        [(0, 1, "T >= 22"), (1, 0, "T <= 18")],
        states=["T"],
    )
    found, said = warned(recordings(heater, starts, np.arange(0, 30, 0.1), noise))
    assert said == [] and found.report_.rollouts.holds


@pytest.mark.parametrize(
    ("doubt", "says"),
    [
        ({}, True),
        ({"hangs_on_start": True}, False),
        ({"left_of_each": np.array([[2.9]])}, False),
        ({"left_of_each": np.array([[1.1]]), "breaks": (SimpleNamespace(leaves=4.7),)}, True),
        # less noise than a rollout may be off by: what surely leaves is far from it
        ({"left_of_each": np.array([[1.6]]), "in_noise": False}, True),
        ({"breaks": ()}, False),  # a few outliers leave as much
    ],
)
def test_only_what_is_a_proof_against_the_automaton_is_warned_of(doubt, says):
    usual = {"left_of_each": np.array([[3.1]]), "hangs_on_start": False, "in_noise": True}
    usual["breaks"] = (SimpleNamespace(leaves=2.8),)
    rollouts = SimpleNamespace(**(usual | {"strays": "1 of 2 recordings"} | doubt))
    found = SimpleNamespace(rollouts=rollouts, noises=None, shared_exits=())
    assert bool(strays(found)) == says
    found.noises = SimpleNamespace(drives=True, goes_on=False)
    assert strays(found) == ""
    found.noises = SimpleNamespace(drives=True, goes_on=True)  # a law is missing, and no noise
    assert bool(strays(found)) == says


def test_guards_that_explain_no_more_than_their_coefficients_are_none():
    rng, x, mode, left, rows = np.random.default_rng(5), 1.0, 0, 4, []
    for _ in range(400):
        rows.append(x)
        left -= 1
        if not left:
            mode, left = 1 - mode, int(rng.integers(3, 40))
        x = 0.95 * x + (0.05 if mode == 0 else 0.0)
    found = discrete(np.array(rows)[:, None], n_modes=2)
    unsaid = [one for one in found.verdicts_ if not one.is_told]
    assert unsaid
    assert FINE not in str(found.report_)
    assert "inf" not in str(found.report_).replace("infinite", "")
    for one in found.verdicts_:
        pair = one.source, one.target
        taken = [pair == (own.source, own.target) for own in found.transitions_]
        assert any(taken) == one.is_in_model
        if not one.is_in_model:
            assert "no transition of the model" in one.advice()


@pytest.mark.parametrize(("samples", "said"), [(3, "something gradual"), (30, "stand without it")])
def test_modes_that_alternate_all_the_time_are_not_believed(samples, said):
    """Half of the stays have three samples, or thirty; no guard tells any of them."""
    modes = [np.repeat(np.arange(40) % 2, samples)]
    verdicts = [TransitionVerdict(one, 1 - one, 20, 0.1, 1.0) for one in (0, 1)]
    found = SimpleNamespace(modes=modes, verdicts=verdicts)
    assert said in untold_switches(found)
    assert imitates(found) == (samples == 3)
    told = [replace(one, explained=1.0) for one in verdicts]
    assert untold_switches(SimpleNamespace(modes=modes, verdicts=told)) == ""


def test_another_number_of_modes_than_asked_for_is_said():
    data = recordings(RELAY, [15.0, 16.3])
    assert "2 of the 4 modes asked for were found" in str(discrete(data, n_modes=4).report_)
    limited = discrete(data, max_modes=2)
    assert "2 modes are the most that were tried (max_modes)" in str(limited.report_)
    assert "max_modes" not in str(discrete(data).report_)


def test_a_few_samples_of_no_law_are_said():
    [data] = recordings(RELAY, [15.0])
    data["x"][100] += 5.0  # of a spread of 1.3
    report = str(discrete([data]).report_)
    assert re.search(r"\d of 200 samples follow none of the laws", report)


@pytest.mark.parametrize(
    ("cubic", "said"), [(0.0, "nothing but noise"), (0.06, "a term or a mode")]
)
def test_noise_that_differs_by_recording_is_no_missing_term_and_hides_none(cubic, said):
    """Four times as large in one of three: root mean squares of all are 2.4 times its median."""
    force = f"-2 x - 0.2 v - {cubic} x^3"
    plant = HybridAutomaton.stated([{"x": "v", "v": force}], [], states=["x", "v"])
    rng, t = np.random.default_rng(0), np.arange(0.0, 10.0, 0.05)
    runs = [
        {"t": t, "x": run.x + noise * rng.standard_normal(run.x.shape)}
        for run, noise in zip(
            [plant.simulate([start, 0.0], t) for start in (2.0, 1.5, -1.8)],
            (0.01, 0.01, 0.04),
            strict=True,
        )
    ]
    with warnings.catch_warnings(record=True) as named:
        warnings.simplefilter("always")
        report = HybridAutomatonRegressor(1, random_state=0).fit(runs).report_
    assert ["the law of mode 0 leaves" in str(one.message) for one in named] == [True] * bool(cubic)
    assert "The noise of x0 differs by recording: 0.01 " in str(report)
    assert said in report.advice


@pytest.mark.parametrize("n", [25, 400])
def test_a_short_recording_says_both_answers_and_a_long_one_which_noise(n):
    rng, y = np.random.default_rng(2), np.zeros(n)
    for k in range(n - 1):
        y[k + 1] = 0.3 * y[k] + rng.standard_normal()
    found = discrete(y[:, None], n_modes=1)
    report = str(found.report_)
    if n == 25:
        assert "do not tell noise of the sensor from noise in the equation" in report
    else:
        assert "There is noise in the equation" in report
        assert found.equation_noise_[0] == pytest.approx(1.0, rel=0.1)
        assert abs(found.coef_[0, 0, 1] - 0.3) < 3.0 * found.coef_errors_[0, 0, 1]


def test_where_either_noise_may_be_no_law_is_named_that_nobody_has():
    nothing = np.zeros(0)  # in continuous time there are no laws of either noise alone
    found = SimpleNamespace(
        automaton=SimpleNamespace(n_modes=1),
        verdicts=(),
        shared_exits=(),
        n_unexplained=0,
        noises=KindsOfNoise(np.ones(1), np.ones(1), 0.5, 0.5, nothing, nothing),
    )
    (said,) = doubts_of(found, 1, 1)
    assert "do not tell noise of the sensor from noise in the equation. A longer" in said


def test_noise_in_the_equation_does_not_blame_the_laws():
    rng, y, u = (
        np.random.default_rng(1),
        np.zeros(500),
        np.random.default_rng(2).uniform(-1, 1, 500),
    )
    for k in range(499):
        law = (0.5, 1.0, 0.0) if y[k] < 0.2 else (-0.4, 0.5, 0.3)
        y[k + 1] = law[0] * y[k] + law[1] * u[k] + law[2] + 0.05 * rng.standard_normal()
    found = discrete(y[:, None], None, None, u[:, None])
    order = np.argsort(-found.coef_[:, 0, 1])
    truth = np.array([[0.0, 0.5, 1.0], [0.3, -0.4, 0.5]])
    errors = found.coef_errors_[order, 0]
    assert (np.abs(found.coef_[order, 0] - truth) < 4.0 * errors).all()
    assert "no proof against the laws" in found.report_.advice


@dataclass
class Rolled:
    """Free rollouts of which so many switches are wrong."""

    missing: tuple
    left: np.ndarray
    extra: tuple = ()

    @property
    def holds(self):
        return self.left[0] <= 1.0

    @property
    def tells_switches(self):
        return not self.missing


def test_rollouts_decide_between_guards_that_tell_the_same_switches():
    powers = np.array([[0, 0], [1, 0]])
    clock, state, other = (
        FoundGuard(PolynomialGuard(np.array([-1.0, k]), powers), 0.0, np.zeros(3), np.array([0]))
        for k in (1.0, 2.0, 3.0)
    )
    given = replace(clock, rivals=(other, state))
    wrong = {1.0: 3, 2.0: 0, 3.0: 2}
    left = {1.0: 9.0, 2.0: 1.0, 3.0: 5.0}

    def judge(guards):
        slope = guards[0].guard.coef[1]
        return Rolled(("",) * wrong[slope], np.array([left[slope]]))

    [chosen] = by_rollouts([given], judge)
    assert chosen.guard is state.guard
    assert chosen.rivals == ()
    # the first one stays where it holds, and what holds as well is its rival
    wrong[1.0], left[1.0] = 0, 1.0
    [chosen] = by_rollouts([given], judge)
    assert chosen.guard is clock.guard
    assert [one.guard for one in chosen.rivals] == [state.guard]


def test_errors_of_a_reset_are_those_of_its_jumps():
    rng = np.random.default_rng(0)
    off = []
    for _ in range(200):
        before = np.column_stack([np.zeros(20), rng.uniform(-9.0, -3.0, 20)])
        after = before * [1.0, -0.8] + [0.0, 0.02] * rng.standard_normal((20, 2))
        found = best_reset(before, after, np.array([1e-3, 1e-3]), np.array([0]))
        off.append((found.reset.matrix[1, 1] + 0.8) / found.errors[1, 2])
    # least absolute deviations scatter by the root of pi / 2 more than least squares
    assert 0.9 < np.std(off) < 1.4
