"""Automata as dicts, and back."""

import copy
import json

import numpy as np
import pytest
from sklearn.compose import ColumnTransformer
from sklearn.pipeline import FeatureUnion, Pipeline
from sklearn.preprocessing import PolynomialFeatures
from test_continuous import CASES
from test_discrete import ARX
from test_stating import AUTOMATON

from swsysid import FunctionLibrary, HybridAutomaton
from swsysid._saving.values import read_objects, write_objects
from swsysid.results import FirstModes


def _through_json(automaton):
    return HybridAutomaton.from_dict(json.loads(json.dumps(automaton.to_dict(), allow_nan=False)))


def _equal(one, other):
    """The same coefficients to the last bit."""
    np.testing.assert_array_equal(one.coef, other.coef)
    assert len(one.transitions) == len(other.transitions)
    for ours, theirs in zip(one.transitions, other.transitions, strict=True):
        assert (ours.source, ours.target) == (theirs.source, theirs.target)
        np.testing.assert_array_equal(ours.guard.coef, theirs.guard.coef)
        np.testing.assert_array_equal(ours.guard.powers, theirs.guard.powers)
        assert (ours.reset is None) == (theirs.reset is None)
        if ours.reset is not None:
            np.testing.assert_array_equal(ours.reset.matrix, theirs.reset.matrix)
            np.testing.assert_array_equal(ours.reset.offset, theirs.reset.offset)


def _same_rollouts(one, other, x0, mode, end, inputs=None):
    t = np.linspace(0.0, end, 101)
    runs = [automaton.simulate(x0, t, inputs, mode=mode) for automaton in (one, other)]
    np.testing.assert_array_equal(runs[0].x, runs[1].x)
    np.testing.assert_array_equal(runs[0].modes, runs[1].modes)
    assert [event.time for event in runs[0].events] == [event.time for event in runs[1].events]
    assert runs[0].status is runs[1].status


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_a_dict_gives_the_same_automaton(case):
    again = _through_json(case.automaton)
    _equal(again, case.automaton)
    assert again.equations(6) == case.automaton.equations(6)
    _same_rollouts(again, case.automaton, case.x0, case.mode, case.end)


def test_a_dict_holds_inputs_lags_libraries_and_the_modes_at_the_start():
    u = np.random.default_rng(0).uniform(-1.5, 1.5, 101)
    _same_rollouts(_through_json(ARX), ARX, [[0.1], [0.4]], 0, 100.0, u)
    library = FunctionLibrary([np.sin, np.cos], names=["sin({})", "cos({})"])
    sine = HybridAutomaton.stated(
        [[[-1.0, 0.5]], [[1.0, 0.0]]],
        [(0, 1, "x <= 0.5"), (1, 0, "x >= 1")],
        states=["x"],
        feature_library=library,
    )
    sine = HybridAutomaton(
        sine.coef,
        sine.feature_map,
        sine.transitions,
        first_modes=FirstModes(np.array([[0.6], [0.9]]), np.array([1, 0])),
    )
    again = _through_json(sine)
    assert again.equations() == sine.equations()
    _same_rollouts(again, sine, [0.7], None, 5.0)


def test_an_automaton_is_part_of_a_model_file():
    again = read_objects(json.loads(json.dumps(write_objects(AUTOMATON))))
    _equal(again, AUTOMATON)


def test_what_has_code_is_refused():
    library = FunctionLibrary([lambda x: x])
    own = HybridAutomaton.stated([[[-1.0]]], states=["x"], feature_library=library)
    with pytest.raises(TypeError, match="the features of FunctionLibrary cannot be written"):
        own.to_dict()
    with pytest.raises(TypeError, match="are no polynomials, and SpaceEx models are made of"):
        own.to_spaceex("unwritten.xml")


def _without(key):
    return lambda told: told.pop(key)


def _with(*path_and_value):
    *path, last, value = path_and_value

    def change(told):
        for key in path:
            told = told[key]
        told[last] = value

    return change


@pytest.mark.parametrize(
    "damage",
    [
        *map(_without, ("columns", "features", "laws", "transitions", "lags", "first_modes")),
        _with("format", "another"),
        _with("format_version", 99),
        _with("format_version", True),
        _with("columns", "xvu"),
        _with("columns", ["x", 3]),
        _with("features", {"degree": -1, "constant": True}),
        _with("features", {"degree": 10**9, "constant": True}),
        _with("features", {"functions": ["system"], "names": None}),
        _with("features", {"functions": ["sin"], "names": 3}),
        _with("feature_sizes", [1.0]),
        _with("discrete_time", 1),
        _with("lags", 2),
        _with("laws", [[[1.0]]]),
        _with("laws", [[["x"]]]),
        _with("laws", [[[1.0], [2.0, 3.0]]]),
        _with("laws", None),
        _with("transitions", {"0": 1}),
        _with("transitions", [3]),
        _with("transitions", 0, "source", 7),
        _with("transitions", 0, "guard", "coef", [1.0]),
        _with("transitions", 0, "guard", "powers", [[0.5] * 5] * 3),
        _with("transitions", 0, "guard", None),
        _with("transitions", 0, "reset", {"matrix": [[1.0]], "offset": [0.0]}),
        _with("transitions", 0, "reset", 4),
        _with("transitions", 0, "support", -1),
        _with("first_modes", {"states": [[1.0, 2.0]], "modes": [0, 1]}),
        _with("first_modes", [1]),
    ],
)
def test_a_damaged_dict_is_one_sentence(damage):
    told = copy.deepcopy(AUTOMATON.to_dict())
    damage(told)
    with pytest.raises(ValueError) as refused:
        HybridAutomaton.from_dict(told)
    message = str(refused.value)
    assert message.endswith(".") and "\n" not in message and len(message) < 300


@pytest.mark.parametrize("told", [None, 3, [], "swsysid automaton", {}])
def test_what_is_no_dict_of_an_automaton_is_refused(told):
    with pytest.raises(ValueError, match="this is no automaton of swsysid"):
        HybridAutomaton.from_dict(told)


def test_features_of_columns_in_turn_are_kept():
    """Sines of an angle in degrees, as the command line has them for units of degrees."""
    radians = FunctionLibrary([np.deg2rad], names=["{}"])
    angle = ColumnTransformer([("angle", radians, [0])], verbose_feature_names_out=False)
    waves = Pipeline([("angle", angle), ("waves", FunctionLibrary([np.sin, np.cos]))])
    parts = [("products", PolynomialFeatures(1)), ("waves", waves)]
    library = FeatureUnion(parts, verbose_feature_names_out=False)
    laws = [[[0.0, 0.0, 1.0, 0.0, 0.0], [0.0, 0.0, -0.1, -500.0, 0.0]]]
    plant = HybridAutomaton.stated(
        laws, [(0, 0, "q <= -5", {"v": "-0.8 v"})], states=["q", "v"], feature_library=library
    )
    again = _through_json(plant)
    assert again.equations() == plant.equations()
    _same_rollouts(again, plant, [30.0, 0.0], 0, 3.0)
