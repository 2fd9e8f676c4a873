"""The search beside automata: guards that remember, states that jump, and what laws lack."""

import numpy as np
import pytest
from event_integration import integrate_events

from swsysid import (
    EffectRegressor,
    EffectSearchCV,
    HybridAutomaton,
    HybridAutomatonRegressor,
    SwitchingSystemRegressor,
    TrajectoryIdentifier,
    load_model,
    save_model,
)
from swsysid._results import GuardWarning
from swsysid.diagnosis import residual_report
from swsysid.effects import (
    Bias,
    CoulombFriction,
    DeadZone,
    ExtraMode,
    GuardHysteresis,
    InputCoupling,
    Polynomial,
    QuadraticDrag,
    Reset,
)

LIBRARY = [
    *(Bias(), CoulombFriction(), QuadraticDrag(), Polynomial()),
    *(GuardHysteresis(), Reset(), ExtraMode()),
]
T = np.arange(0.0, 12.0, 0.02)

# A mass on a spring is pushed to the right until x = 1.5 and to the left until it hits a wall at
# x = -1, from which it comes back with 0.6 of its speed. Its friction in mode 1 is not declared.
HAMMER = HybridAutomaton.stated(
    [{"x": "v", "v": "3 - x - 0.2 v"}, {"x": "v", "v": "-3 - x - 0.2 v"}],
    [(0, 1, "x >= 1.5"), (1, 0, "x <= -1", {"v": "-0.6 v"})],
    states=["x", "v"],
)
FRICTION = 0.5


def unchanged(x):
    return x


def integrated(laws, transitions, mode, x0, t):
    """States and modes of a plant by SciPy's events; its friction wants short steps."""
    run = integrate_events(laws, transitions, mode, x0, t, max_step=0.02)
    return np.array(run.x), np.array(run.modes)


def hammer(x0, t=T, mode=0, friction=FRICTION):
    def law(push, friction):
        return lambda time, x: [x[1], push - x[0] - 0.2 * x[1] - friction * np.sign(x[1])]

    transitions = [
        (0, 1, lambda time, x, entered: x[0] - 1.5, unchanged),
        (1, 0, lambda time, x, entered: -1.0 - x[0], lambda x: x * (1.0, -0.6)),
    ]
    return integrated([law(3.0, 0.0), law(-3.0, friction)], transitions, mode, x0, t)


def recordings(friction, noise=0.01, seed=0):
    rng = np.random.default_rng(seed)
    listed, modes = [], []
    for k in range(6):
        x, mode = hammer([rng.uniform(-0.8, 1.2), rng.uniform(-1.0, 1.0)], T, k % 2, friction)
        x = x + noise * x.std(axis=0) * rng.standard_normal(x.shape)
        listed.append({"t": T, "x": x})
        modes.append(mode)
    return listed, np.concatenate(modes)


def with_velocities(friction, seed=0):
    """Rows with velocities that have two per cent of noise, and their modes."""
    listed, modes = recordings(friction, 0.0, seed)
    X = np.vstack([one["x"] for one in listed])
    pushed = np.where(modes == 0, 3.0, -3.0 - friction * np.sign(X[:, 1]))
    Xdot = np.column_stack([X[:, 1], pushed - X[:, 0] - 0.2 * X[:, 1]])
    Xdot += 0.02 * Xdot.std(axis=0) * np.random.default_rng(seed + 1).standard_normal(Xdot.shape)
    return X, Xdot, np.tile(T, 6), np.repeat(np.arange(6), len(T)), modes


@pytest.fixture(scope="module")
def searched():
    """The search with recordings, and with velocities."""
    of_states = EffectSearchCV(HAMMER, effects=LIBRARY).fit(recordings(FRICTION)[0])
    X, Xdot, t, groups, _ = with_velocities(FRICTION)
    of_velocities = EffectSearchCV(HAMMER, effects=LIBRARY).fit(X, Xdot, t=t, groups=groups)
    return {"states": of_states, "velocities": of_velocities}


@pytest.mark.parametrize("given", ["states", "velocities"])
def test_friction_that_one_mode_lacks_is_found_there(searched, given):
    search = searched[given]
    (found,) = search.effects_
    assert (found.kind, found.target, found.mode) == ("coulomb_friction", 1, 1)
    assert found.parameters["friction"] == pytest.approx(FRICTION, rel=0.03)
    assert found.error_after < 0.5 * found.error_before
    skipped = "the modes and guards of an automaton are declared"
    assert search.report_.skipped == {"guard_hysteresis": skipped, "extra_mode": skipped}


@pytest.mark.parametrize("given", ["states", "velocities"])
def test_nothing_is_found_where_nothing_is_missing(given):
    search = EffectSearchCV(HAMMER, effects=LIBRARY)
    if given == "states":
        search.fit(recordings(0.0)[0])
    else:
        X, Xdot, t, groups, _ = with_velocities(0.0)
        search.fit(X, Xdot, t=t, groups=groups)
    assert search.effects_ == []


@pytest.mark.parametrize("given", ["states", "velocities"])
def test_what_is_found_rolls_out_like_the_plant(searched, given):
    t = T[:400]
    truth, modes = hammer([0.3, 0.2], t)
    rollout = searched[given].simulate([0.3, 0.2], t, mode=0)
    # a friction known to 3 % and laws to 1 %, over five switches and two impacts
    np.testing.assert_allclose(rollout.x, truth, atol=0.1)
    assert np.mean(rollout.modes == modes) > 0.98
    assert [event.kind for event in rollout.events[:2]] == ["transition", "jump"]
    declared = HAMMER.simulate([0.3, 0.2], t, mode=0)
    assert np.abs(declared.x - truth).max() > 2.0


def test_predictions_ask_the_recordings_for_their_modes(searched):
    search = searched["velocities"]
    X, Xdot, t, groups, modes = with_velocities(FRICTION, seed=7)
    # samples next to a switch may be told one too early or late
    assert np.mean(search.predict_modes(X, t=t, groups=groups) == modes) > 0.98
    assert search.score(X, Xdot, t=t, groups=groups) > 0.98
    with pytest.raises(ValueError, match="give t"):
        search.predict(X)
    with pytest.raises(ValueError, match="give mode"):
        search.simulate([0.0, 0.0], T)


def test_equations_report_and_file_of_an_automaton_with_effects(searched, tmp_path):
    search = searched["velocities"]
    laws, guards = search.equations(precision=1), search.surface_equations(precision=1)
    assert laws[3] == "mode 1: x1' = -3.0 - 1.0 x0 - 0.2 x1 - 0.5 sign(x1)"
    assert guards == ["mode 0 -> 1 where x0 >= 1.5", "mode 1 -> 0 where x0 <= -1.0: x1 := -0.6 x1"]
    for one in search.report_.rollouts:
        assert one["error_after"][0] < 0.2 * one["error_before"][0]
    assert "Coulomb friction" in search.report_.to_html()
    save_model(search.best_estimator_, tmp_path / "model.json")
    again = load_model(tmp_path / "model.json")
    runs = [one.simulate([0.3, 0.2], T, mode=0).x for one in (search, again)]
    np.testing.assert_array_equal(*runs)


def test_a_model_with_given_effects_is_fitted_in_the_modes_of_its_guards(searched):
    X, Xdot, t, groups, modes = with_velocities(FRICTION)
    placed = [found.placed for found in searched["velocities"].effects_]
    model = EffectRegressor(HAMMER, placed).fit(X, Xdot, t=t, groups=groups)
    # one recording switches between its last two samples: one row is not worth a switch
    assert np.sum(model.modes_ != modes) <= 1
    assert float(model.effect_coef_[0][0]) == pytest.approx(FRICTION, rel=0.03)
    known = EffectRegressor(HAMMER, placed).fit(X, Xdot, t=t, groups=groups, modes=modes)
    np.testing.assert_allclose(known.effect_coef_[0], model.effect_coef_[0], rtol=1e-3)
    report = residual_report(model, X, Xdot, t=t, groups=groups)
    assert report.skipped["surface"].startswith("the guards of an automaton remember")


# -- what is declared ------------------------------------------------------------------------------


def test_terms_that_a_stated_law_lacks_are_looked_for():
    # drag: h' = v is exact, and v' = -9.81 has no term in v that could take its shape
    ball = HybridAutomaton.stated(
        [{"h": "v", "v": "-9.81"}], [(0, 0, "h <= 0", {"v": "-0.9 v"})], states=["h", "v"]
    )
    t = np.arange(0.0, 4.0, 0.01)

    def fall(time, x):
        return [x[1], -9.81 - 0.3 * x[1]]

    bounce = [(0, 0, lambda time, x, entered: -x[0], lambda x: np.array([0.0, -0.9 * x[1]]))]
    rng = np.random.default_rng(0)
    listed = []
    for height in (3.0, 4.0, 5.0, 6.0):
        x, _ = integrated([fall], bounce, 0, [height, 0.0], t)
        listed.append({"t": t, "x": x + 0.002 * x.std(axis=0) * rng.standard_normal(x.shape)})
    search = EffectSearchCV(ball, effects=[Bias(), CoulombFriction(), Polynomial()])
    (found,) = search.fit(listed).effects_
    assert (found.kind, found.target, found.place) == ("polynomial", 1, "x1")
    (drag,) = found.parameters.values()
    assert drag == pytest.approx(-0.3, rel=0.05)
    assert [event.kind for event in search.simulate([3.0, 0.0], t[:100]).events] == ["jump"]


def thermostat(start, offset, t, coupling):
    def law(level):
        return lambda time, x: [-0.1 * (x[0] - level) + coupling * np.sin(0.9 * time + offset)]

    transitions = [
        (0, 1, lambda time, x, entered: x[0] - 22.0, unchanged),
        (1, 0, lambda time, x, entered: 18.0 - x[0], unchanged),
    ]
    return integrated([law(30.0), law(10.0)], transitions, 0, [start], t)


@pytest.mark.nightly
def test_an_automaton_is_identified_again_with_the_effect_inside():
    # while the outside temperature is missing, guards are found for switches that there are not
    t, rng, parts = np.arange(0.0, 30.0, 0.1), np.random.default_rng(0), []
    for k in range(4):
        x, _ = thermostat(14.0 + k, k, t, 0.3)
        parts.append((x + 0.02 * rng.standard_normal(x.shape), np.sin(0.9 * t + k)))
    x, outside = (np.concatenate(each) for each in zip(*parts, strict=True))
    search = EffectSearchCV(
        HybridAutomatonRegressor(2), effects=[Bias(), InputCoupling(), Polynomial(), Reset()]
    )
    with pytest.warns(GuardWarning, match="Nothing in the recordings tells"):
        search.fit(x, t=np.tile(t, 4), groups=np.repeat(np.arange(4), len(t)), signals=outside)
    (found,) = search.effects_
    assert found.kind == "input_coupling"
    assert found.parameters["coefficient"] == pytest.approx(0.3, rel=0.05)
    guards = sorted(search.surface_equations(precision=1), key=lambda line: line.split()[-2:])
    assert [line.split(" where ")[1] for line in guards] == ["x0 <= 18.0", "x0 >= 22.0"]
    truth, _ = thermostat(15.5, 0.4, t, 0.3)
    signals = np.sin(0.9 * t + 0.4)[:, None]
    heater = int(np.argmin([one.guard.coef[0] for one in search.automaton_.transitions]))
    mode = search.automaton_.transitions[heater].source
    rollout = search.simulate([15.5], t, signals=signals, input_hold="linear", mode=mode)
    # a switch is late by less than a sample, which is worth .2 degrees
    np.testing.assert_allclose(rollout.x, truth, atol=0.1)


def test_a_map_with_memory():
    relay = HybridAutomaton.stated(
        [{"y": "0.8 y + 0.5 u + 0.6"}, {"y": "0.8 y + 0.5 u - 0.6"}],
        [(0, 1, "y >= 1.5"), (1, 0, "y <= -1.5")],
        states=["y"],
        inputs=["u"],
        discrete_time=True,
    )
    rng = np.random.default_rng(0)
    u = rng.uniform(-1.0, 1.0, (6, 300, 1))
    y, k = np.empty((6, 300, 1)), np.arange(300)
    for run, own in zip(y, u, strict=True):
        state, mode = 0.0, 0
        for row in k:
            run[row] = state
            mode = 1 if state >= 1.5 else 0 if state <= -1.5 else mode
            dead = np.sign(own[row, 0]) * max(abs(own[row, 0]) - 0.3, 0.0)
            state = 0.8 * state + 0.5 * dead + (0.6 if mode == 0 else -0.6)
            state += 0.002 * rng.standard_normal()
    listed = [{"t": k, "x": x, "inputs": own} for x, own in zip(y, u, strict=True)]
    search = EffectSearchCV(relay, effects=[Bias(), DeadZone(), Polynomial()]).fit(listed)
    (found,) = search.effects_
    assert found.kind == "dead_zone"
    assert found.parameters["threshold"] == pytest.approx(0.3, rel=0.05)
    rollout = search.simulate([0.0], k, u[0], mode=0)
    # until the first switch, whose row depends on the noise
    first = next(k for k, event in enumerate(rollout.modes) if event)
    np.testing.assert_allclose(rollout.x[:first], y[0][:first], atol=0.02)


# -- what becomes of guards and jumps that are found -----------------------------------------------


def stiffness_law(stiffness, offset, phase):
    def law(time, x):
        force = np.sin(1.3 * time + phase) + 0.5 * np.cos(3.1 * time)
        return [x[1], offset - stiffness * x[0] - 0.5 * x[1] + 3.0 * force]

    return law


def driven(kind, x0, t, phase):
    """A driven mass, soft on the left (mode 0) and stiff on the right."""
    band, factor = (0.3, 1.0) if kind == "guard_hysteresis" else (0.0, 0.6)
    transitions = [
        (0, 1, lambda time, x, entered: x[0] - band, lambda x: x * (1.0, factor)),
        (1, 0, lambda time, x, entered: -band - x[0], unchanged),
    ]
    laws = [stiffness_law(4.0, 0.0, phase), stiffness_law(9.0, 1.0, phase)]
    states, modes = integrated(laws, transitions, 0, x0, t)
    force = 3.0 * (np.sin(1.3 * t + phase) + 0.5 * np.cos(3.1 * t))
    return states, modes, force


@pytest.mark.parametrize(
    "declared",
    [SwitchingSystemRegressor, pytest.param(TrajectoryIdentifier, marks=pytest.mark.nightly)],
)
@pytest.mark.parametrize("kind", ["guard_hysteresis", "reset"])
def test_what_is_found_at_the_switches_becomes_transitions(kind, declared):
    t, rng, listed = np.arange(0.0, 12.0, 0.02), np.random.default_rng(0), []
    for phase in range(8):
        x, _, force = driven(kind, [rng.uniform(-1.0, -0.5), rng.uniform(-1.0, 1.0)], t, phase)
        x += 0.003 * x.std(axis=0) * rng.standard_normal(x.shape)
        listed.append({"t": t, "x": x, "inputs": force[:, None]})
    inner = SwitchingSystemRegressor(2, feature_library=1)
    estimator = inner if declared is SwitchingSystemRegressor else declared(inner)
    library = [Bias(), CoulombFriction(), GuardHysteresis(), Reset()]
    search = EffectSearchCV(estimator, effects=library).fit(listed)
    assert [found.kind for found in search.effects_] == [kind]
    truth, modes, force = driven(kind, [-0.8, 0.3], t[:300], 0.5)
    automaton = search.automaton_
    soft = int(np.argmax(automaton.coef[:, 1, 1]))  # the least stiffness
    rollout = automaton.simulate(
        [-0.8, 0.3], t[:300], force[:, None], mode=soft, input_hold="linear"
    )
    # a guard is known to a sample, in which the state moves by 0.04
    np.testing.assert_allclose(rollout.x[:, 0], truth[:, 0], atol=0.1)
    assert np.mean((rollout.modes == soft) == (modes == 0)) > 0.97
    jumps = [event.kind for event in rollout.events]
    assert ("jump" in jumps) == (kind == "reset")
    same = search.simulate([-0.8, 0.3], t[:300], force[:, None], input_hold="linear")
    np.testing.assert_allclose(same.x[:, 0], truth[:, 0], atol=0.1)


# -- refusals --------------------------------------------------------------------------------------


def _lagged():
    return HybridAutomaton.stated(
        [{"y": "0.5 y + 0.2 y[k-1]"}], states=["y"], discrete_time=True, lags=1
    )


@pytest.mark.parametrize(
    ("estimator", "error", "message"),
    [
        (_lagged(), ValueError, "lags=1"),
        (HybridAutomatonRegressor(lags=1, discrete_time=True), ValueError, "lags=1"),
        (HybridAutomatonRegressor, TypeError, "HybridAutomatonRegressor"),
        (TrajectoryIdentifier(order=2), ValueError, "order 1"),
        (object(), TypeError, "HybridAutomaton"),
    ],
)
def test_what_cannot_be_declared_is_refused_in_a_sentence(estimator, error, message):
    x = np.sin(np.arange(100.0))[:, None]
    with pytest.raises(error, match=message):
        EffectSearchCV(estimator, effects=[Bias()]).fit(x, t=np.arange(100.0))


def test_an_automaton_needs_times():
    X = np.random.default_rng(0).uniform(-1.0, 1.0, (200, 2))
    with pytest.raises(ValueError, match="give t"):
        EffectSearchCV(HybridAutomatonRegressor(2), effects=[Bias()]).fit(X, X)
