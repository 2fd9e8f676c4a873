"""Calls that once failed somewhere below: each is refused in a sentence, or answered."""

import re

import numpy as np
import pytest

from swsysid import (
    EffectRegressor,
    EffectSearchCV,
    FunctionLibrary,
    HybridAutomaton,
    HybridAutomatonRegressor,
    IdentificationWarning,
    MomentRelaxation,
    PolynomialSurfaceClassifier,
    SwitchingSystemRegressor,
    TrajectoryIdentifier,
)
from swsysid._stays.retold import Visit, _without
from swsysid._stays.stays import Stays
from swsysid._surfaces.probability import SurfaceEvidence, sample_surface
from swsysid.effects import Bias, CoulombFriction, GuardHysteresis, Lag, PlacedEffect

T = np.arange(40) * 0.1
X = np.column_stack([np.sin(T), np.cos(T)])
X += 0.01 * np.random.default_rng(0).standard_normal(X.shape)
RELAY = HybridAutomaton.stated(
    [{"T": "-0.1 (T - 30)"}, {"T": "-0.1 (T - 10)"}],
    [(0, 1, "T >= 22"), (1, 0, "T <= 18")],
    states=["T"],
)
SPRING = HybridAutomaton.stated(
    [{"x": "v", "v": "-x"}, {"x": "v", "v": "-2 x"}],
    [(0, 1, "x >= 0"), (1, 0, "x <= 0")],
    states=["x", "v"],
)


def stated(*transitions, **options):
    return HybridAutomaton.stated([{"T": "1"}] * 2, list(transitions), states=["T"], **options)


def of_degree(degree):
    return SwitchingSystemRegressor(surface=PolynomialSurfaceClassifier(degree=degree))


REFUSED = {
    "an array of one number as observed": (
        lambda folder: TrajectoryIdentifier(observed=np.array(2)).fit(X, T),
        "observed=array(2) names not just the 2 columns",
    ),
    "lists as observed": (
        lambda folder: TrajectoryIdentifier(observed=[["x"], ["v"]]).fit(X, T),
        "names not just the 2 columns",
    ),
    "degree 1e300": (
        lambda folder: TrajectoryIdentifier(of_degree(1e300)).fit(X, T),
        "degree=1e+300 must be an integer",
    ),
    "degree 10^400": (
        lambda folder: of_degree(10**400).fit(X, X),
        "choose a lower degree",
    ),
    "a generator": (
        lambda folder: HybridAutomatonRegressor(discrete_time=True).fit(iter(X)),
        "must be neither a string nor an object but a number",
    ),
    "a text as reset": (
        lambda folder: stated((0, 1, "T>=1", "a")),
        "transitions[0] has the reset 'a'; give a dict",
    ),
    "a number as reset": (
        lambda folder: stated((0, 1, "T>=1", 0.5)),
        "transitions[0] has the reset 0.5; give a dict",
    ),
    "a reset of a number": (
        lambda folder: stated((0, 1, "T>=1", {1: "2"})),
        "transitions[0] resets 1; name the state",
    ),
    "a law of a number": (
        lambda folder: HybridAutomaton.stated([{1: "1"}], states=["T"]),
        "the law of mode 0 is one of 1; give one polynomial",
    ),
    "parameters without names": (
        lambda folder: stated((0, 1, "T>=a"), parameters={1: 2}),
        "parameters={1: 2} has keys that are no text",
    ),
    "constants of a SpaceEx model that are no dict": (
        lambda folder: HybridAutomaton.from_spaceex(written(folder), 5),
        "parameters=5 must be a dict",
    ),
    "a component without a name": (
        lambda folder: RELAY.to_spaceex(folder / "relay.xml", {}),
        "component={} must be the name",
    ),
    "an automaton of other states": (
        lambda folder: EffectSearchCV(SPRING, effects=[GuardHysteresis()]).fit(X[:, :1], t=T),
        "the automaton has 2 states and 0 inputs and the recordings 1 and 0",
    ),
    "no states to assign": (
        lambda folder: MomentRelaxation().assign(np.zeros((1, 3, 0)), np.zeros((3, 0))),
        "a state at least",
    ),
    "a function that hides its arguments": (
        lambda folder: FunctionLibrary([max]).fit(X),
        "does not tell how many columns it takes; wrap it",
    ),
}


def written(folder):
    RELAY.to_spaceex(folder / "relay.xml")
    return folder / "relay.xml"


@pytest.mark.filterwarnings("ignore::swsysid.IdentificationWarning")
@pytest.mark.parametrize("name", REFUSED)
def test_it_is_refused_in_a_sentence(name, tmp_path):
    call, sentence = REFUSED[name]
    with pytest.raises((TypeError, ValueError), match=re.escape(sentence)) as caught:
        call(tmp_path)
    assert str(caught.value).endswith(".") and "\n" not in str(caught.value)


ROWS = {"t": np.tile(T, 2), "groups": np.repeat([0, 1], 40)}
PLACED = {
    "a number that is missing": (PlacedEffect(Lag(), 1, 1), "theta=(); give a number each for"),
    "a number too many": (PlacedEffect(Bias(), (), 1, theta=(1.0,)), "give none, ()"),
    "no number": (PlacedEffect(Lag(), 1, 1, theta=("a",)), "time_constant"),
    "a number that is none": (PlacedEffect(Lag(), 1, 1, theta=(np.nan,)), "time_constant"),
    "a channel that is not there": (PlacedEffect(CoulombFriction(), 9, 1), "from 0 to 1"),
    "a channel from behind": (PlacedEffect(CoulombFriction(), -1, 1), "from 0 to 1"),
    "a name": (PlacedEffect(CoulombFriction(), "v", 1), "channel 'v' is asked for"),
    "two channels": (PlacedEffect(CoulombFriction(), (0, 1), 1), "channel (0, 1) is asked for"),
    "no state": (PlacedEffect(CoulombFriction(), 1, None), "acts in state None"),
    "no feature": (PlacedEffect(Bias(), 1, 1, replaced=40), "replaced=40; give a number from 0 to"),
    "no feature's channel": (PlacedEffect(Bias(), (), 1, replaced=0), "needs one channel"),
    "no mode": (PlacedEffect(Bias(), (), 1, mode=4), "mode=4; give a number from 0 to 0, or None"),
    "a mode by name": (PlacedEffect(Bias(), (), 1, mode=["a"]), "mode=['a']; give a number"),
    "no effect": (PlacedEffect("lag", 1, 1), "must be a list of swsysid.effects.PlacedEffect"),
}


@pytest.mark.parametrize("name", PLACED)
def test_an_effect_that_cannot_act_there_is_refused(name):
    term, sentence = PLACED[name]
    model = EffectRegressor(SwitchingSystemRegressor(1), [term])
    with pytest.raises((TypeError, ValueError), match=re.escape(sentence)) as caught:
        model.fit(np.vstack([X, X]), np.vstack([X, -X]), **ROWS)
    assert str(caught.value).endswith(".")


def test_a_rollout_that_ends_before_its_first_sample_is_no_mode():
    """A state 1e7 deviations from zero, and a law without a constant: it diverges at once."""
    t, rng = np.arange(40) * 0.1, np.random.default_rng(0)
    runs = [np.column_stack([k + np.sin(t), np.cos(t)]) for k in (0.0, 0.5)]
    data = [{"t": t, "x": run + 0.01 * rng.standard_normal(run.shape) + [1e7, 0]} for run in runs]
    with pytest.warns(IdentificationWarning):
        found = TrajectoryIdentifier(SwitchingSystemRegressor(1)).fit(data)
    assert [one.mode for one in found.report_.rollouts.breaks] == [-1, -1]


def test_a_surface_without_evidence_is_drawn_as_it_is():
    coef = np.array([0.5, -1.0])
    none = SurfaceEvidence(np.empty((0, 2)), np.empty(0), np.empty(0), coef, 0.1)
    drawn = sample_surface(none, np.random.RandomState(0))
    np.testing.assert_array_equal(drawn, np.broadcast_to(coef, drawn.shape))


@pytest.mark.filterwarnings("ignore")
def test_rows_that_repeat_the_one_before_are_answered():
    """Cuts between all rows leave no stay: what is said is that no law explains them."""
    t = np.arange(40) * 0.3
    runs = [RELAY.simulate([start], t, mode=0).x for start in (15.0, 16.0, 17.0)]
    recordings = [{"t": t, "x": np.repeat(x, 3, axis=0)[: len(t)]} for x in runs]
    found = HybridAutomatonRegressor(random_state=0).fit(recordings)
    assert "times the noise" in found.report_.advice and "inf" not in str(found.report_)


def test_the_only_stay_of_a_recording_is_not_left_out():
    stays = Stays(np.array([0, 1]), np.array([0.5]))
    for visit in (Visit(0.0, 0, 1, 0.5, np.inf), Visit(0.1, 0, 0, -np.inf, 0.5)):
        stays = _without(stays, visit)
    assert stays.modes.tolist() == [0] and not stays.instants.size
