"""Automata as dicts and as SpaceEx models, and back."""

import copy
import json
from xml.etree import ElementTree

import numpy as np
import pytest
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


# -- SpaceEx ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_a_spaceex_model_gives_the_same_automaton(case, tmp_path):
    case.automaton.to_spaceex(tmp_path / "model.xml")
    again = HybridAutomaton.from_spaceex(tmp_path / "model.xml")
    # all digits are written: the coefficients are the same bits, and so are the rollouts
    _equal(again, case.automaton)
    _same_rollouts(again, case.automaton, case.x0, case.mode, case.end)


def test_a_spaceex_model_with_inputs_and_clocks(tmp_path):
    AUTOMATON.to_spaceex(tmp_path / "model.xml")
    again = HybridAutomaton.from_spaceex(tmp_path / "model.xml")
    _equal(again, AUTOMATON)
    u = np.sin(np.arange(101.0))
    _same_rollouts(again, AUTOMATON, [0.5, 0.0], 0, 10.0, u)


def test_what_a_spaceex_model_looks_like(tmp_path):
    thermostat = HybridAutomaton.stated(
        [{"T": "3 - 0.1 T"}, {"T": "1 - 0.1 T"}],
        [(0, 1, "T >= 22"), (1, 0, "T <= 20", {"T": "T + 0.5"})],
        states=["T"],
    )
    thermostat.to_spaceex(tmp_path / "model.xml", component="thermostat")
    space = {"": "http://www-verimag.imag.fr/xml-namespaces/sspaceex"}
    root = ElementTree.parse(tmp_path / "model.xml").getroot()
    (component,) = root.findall("component", space)
    assert component.get("id") == "thermostat"
    (parameter,) = component.findall("param", space)
    assert (parameter.get("name"), parameter.get("dynamics")) == ("T", "any")
    told = [
        [element.findtext(tag, namespaces=space) for tag in ("invariant", "flow")]
        for element in component.findall("location", space)
    ]
    assert told == [
        ["1.0*T - 22.0 <= 0", "T' == 3.0 - 0.1*T"],
        ["20.0 - 1.0*T <= 0", "T' == 1.0 - 0.1*T"],
    ]
    taken = component.findall("transition", space)
    assert [(one.get("source"), one.get("target")) for one in taken] == [("1", "2"), ("2", "1")]
    assert taken[0].find("assignment", space) is None
    assert taken[1].findtext("assignment", namespaces=space) == "T := 0.5 + 1.0*T"


BALL = """<?xml version="1.0" encoding="iso-8859-1"?>
<sspaceex xmlns="http://www-verimag.imag.fr/xml-namespaces/sspaceex" version="0.2" math="SpaceEx">
  <component id="ball">
    <param name="x" type="real" local="false" d1="1" d2="1" dynamics="any" />
    <param name="v" type="real" local="false" d1="1" d2="1" dynamics="any" />
    <param name="g" type="real" local="false" d1="1" d2="1" dynamics="const" />
    <param name="hop" type="label" local="false" />
    <location id="7" name="always">
      <invariant>x &gt;= 0</invariant>
      <flow>x' == v &amp; v' == -g</flow>
    </location>
    <transition source="7" target="7">
      <label>hop</label>
      <guard>x &lt;= 0</guard>
      <assignment>v := -0.75*v</assignment>
    </transition>
  </component>
</sspaceex>
"""


def _read(text, tmp_path, **arguments):
    path = tmp_path / "ball.xml"
    path.write_text(text, encoding="utf-8")
    return HybridAutomaton.from_spaceex(path, **arguments)


def test_a_model_by_another_hand(tmp_path):
    free = BALL.replace("<invariant>x &gt;= 0<", "<invariant>true<")
    assert _read(free, tmp_path, parameters={"g": 9.81}).n_modes == 1
    ball = _read(BALL, tmp_path, parameters={"g": 9.81})
    assert ball.equations(2) == [
        "mode 0: x' = 1.00 v",
        "mode 0: v' = -9.81",
        "mode 0 -> 0 where x <= 0: v := -0.75 v",
    ]
    first = ball.simulate([10.0, 0.0], [0.0, 2.0]).events[0]
    assert first.time == pytest.approx(np.sqrt(20 / 9.81), abs=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("</sspaceex>", "", "it is no XML"),
        ("<sspaceex", "<!DOCTYPE a [<!ENTITY b 'c'>]><sspaceex", "it has a document type"),
        ("iso-8859-1", "utf-9", "it is no XML: unknown encoding"),
        ("-0.75*v", "1e999*v", "has coefficients that are not finite"),
        ("x &lt;= 0<", "x &lt;= 0 &amp; v &lt; 0<", "is not a single condition"),
        ("<guard>x &lt;= 0</guard>", "", "is not a single condition"),
        ("x &gt;= 0", "x &gt;= 0 &amp; v &lt;= 5", "ends where no guard of its location begins"),
        ("x' == v", "x' &lt;= v", "is no equation for one variable"),
        ("x' == v &amp; ", "", "the law of mode 0 is one of v; give one polynomial for each"),
        ("-0.75*v", "sin(v)", "has the unknown name 'sin'"),
        ("-0.75*v", "v*v", "is not affine in the states"),
        ('source="7"', 'source="8"', "from or to a location that there is not"),
        ("location", "place", "it has 0 components with locations instead of one"),
        ('name="g"', 'name="c"', "the model has the constant 'c' without a value"),
    ],
)
def test_what_cannot_be_read_is_one_sentence(old, new, why, tmp_path):
    with pytest.raises(ValueError) as refused:
        _read(BALL.replace(old, new), tmp_path, parameters={"g": 9.81})
    message = str(refused.value)
    assert why in message and message.endswith(".") and "\n" not in message


def test_discrete_time_is_refused(tmp_path):
    with pytest.raises(ValueError, match="SpaceEx models have continuous time; use to_dict"):
        ARX.to_spaceex(tmp_path / "model.xml")
