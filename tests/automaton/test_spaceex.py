"""Automata as SpaceEx models, and back."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest
from test_continuous import CASES
from test_discrete import ARX
from test_documents import _equal, _same_rollouts
from test_stating import AUTOMATON

from swsysid import HybridAutomaton
from swsysid._automaton.polynomial_text import read_inequality
from swsysid._automaton.spaceex_reading import _covered
from swsysid.results import FirstModes


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


BOUNCING = [
    "mode 0: x' = 1.00 v",
    "mode 0: v' = -9.81",
    "mode 0 -> 0 where x <= 0: v := -0.75 v",
]


@pytest.mark.parametrize(
    "guard",
    [
        "x &lt;= 0",
        "x &lt;= 0 &amp; v &lt; 0",
        "v &lt;= 0 &amp; x &lt;= 0",
        "x &lt;= 0 &amp;&amp; v &lt;= 3",  # of a falling ball that is true
        "x == 0 &amp; v &lt;= 0",  # below zero the invariant forbids
        "-9 &lt;= 3*x &lt;= 0",
        "x &lt;= 0 &amp; x &gt;= -3",
    ],
)
def test_a_model_by_another_hand(guard, tmp_path):
    text = BALL.replace("x &lt;= 0<", f"{guard}<")
    ball = _read(text, tmp_path, parameters={"g": 9.81})
    scaled = [line.replace("3.00 x", "x") for line in ball.equations(2)]
    assert scaled == BOUNCING
    first = ball.simulate([10.0, 0.0], [0.0, 2.0]).events[0]
    assert first.time == pytest.approx(np.sqrt(20 / 9.81), abs=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("</sspaceex>", "", "it is no XML"),
        ("<sspaceex", "<!DOCTYPE a [<!ENTITY b 'c'>]><sspaceex", "it has a document type"),
        ("iso-8859-1", "utf-9", "it is no XML: unknown encoding"),
        ("-0.75*v", "1e999*v", "has coefficients that are not finite"),
        # it would stay on the ground with v > -1, where no time passes
        ("x &lt;= 0<", "x &lt;= 0 &amp; v &lt; -1<", "ends where no guard of its location begins"),
        ("<guard>x &lt;= 0</guard>", "", "out of location always may be taken at any time"),
        ("x &gt;= 0", "x &gt;= 0 &amp; v &gt;= -5", "ends where no guard of its location begins"),
        ("x &gt;= 0", "x &gt;= 0 &amp; v &lt;= 5", "need not hold where the transition with the"),
        ("<invariant>x &gt;= 0<", "<invariant>true<", "may be taken or not, as no invariant ends"),
        ("x &gt;= 0", "x &gt;= -1", "may be taken or not, as no invariant ends"),
        ("x' == v", "x' == v &amp; x' == 2*v", "has two equations for x"),
        ("x' == v", "x' == v &amp; x == 2", "'x == 2', of the flow, is no equation"),
        ("v := -0.75*v", "v == -0.75*v", "of the assignment, is no equation for one variable"),
        ("v := -0.75*v", "v := 0 &amp; v := 1", "one assignment has two equations for v"),
        (
            "v := -0.75*v",
            "0 &lt;= v' &lt;= 1",
            "of the assignment, is no equation for one variable",
        ),
        ("x' == v &amp; v' == -g", "false", "no time passes in location always"),
        ('name="x" type="real" local="false" d1="1"', 'name="x" type="real" d1="3"', "a vector"),
        ('name="v" type="real"', 'name="v" type="int"', "v is of the type 'int'"),
        ('dynamics="const"', 'dynamics="explicit"', "with dynamics 'explicit'"),
        ("x' == v", "x' &lt;= v", "is no equation for one variable"),
        ("x' == v &amp; ", "", "location always does not say how x moves"),
        ("-0.75*v", "sin(v)", "has the unknown name 'sin'"),
        ("<guard>x &lt;= 0", "<guard>x &lt;= 0 | v &lt; 0", "is of two cases; write a transition"),
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


def test_a_value_for_what_is_not_open_is_refused(tmp_path):
    with pytest.raises(ValueError, match="'m' a value, which the model does not leave open"):
        _read(BALL, tmp_path, parameters={"g": 9.81, "m": 1.0})


def test_discrete_time_is_refused(tmp_path):
    with pytest.raises(ValueError, match="SpaceEx models have continuous time; use to_dict"):
        ARX.to_spaceex(tmp_path / "model.xml")


# -- transitions that may, and that must, be taken ---------------------------------------------


def _param(name, dynamics="any", controlled="true", local="false", kind="real"):
    return (
        f'<param name="{name}" type="{kind}" local="{local}" d1="1" d2="1" dynamics="{dynamics}" '
        f'controlled="{controlled}"/>'
    )


def _escaped(text):
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def _location(number, flow, invariant=""):
    return (
        f'<location id="{number}" name="l{number}"><invariant>{_escaped(invariant)}</invariant>'
        f"<flow>{_escaped(flow)}</flow></location>"
    )


def _edge(source, target, guard, assignment="", label="", more=""):
    named = f"<label>{label}</label>" if label else ""
    return (
        f'<transition source="{source}" target="{target}" {more}>{named}'
        f"<guard>{_escaped(guard)}</guard><assignment>{_escaped(assignment)}</assignment>"
        "</transition>"
    )


def _component(name, *parts):
    return f'<component id="{name}">{"".join(parts)}</component>'


def _bind(component, instance, **maps):
    told = "".join(f'<map key="{key}">{value}</map>' for key, value in maps.items())
    return f'<bind component="{component}" as="{instance}">{told}</bind>'


def _model(tmp_path, *components, **arguments):
    return _read(f"<sspaceex>{''.join(components)}</sspaceex>", tmp_path, **arguments)


def _heater(invariant_on="x <= 22", invariant_off="x >= 20", up="x >= 22", more=""):
    on, off = _location(1, "x' == 2 - 0.1*x", invariant_on), _location(2, "x' == -1", invariant_off)
    edges = _edge(1, 2, up, more=more), _edge(2, 1, "x <= 20")
    return _component("heater", _param("x"), on, off, *edges)


SWITCHED = ["mode 0 -> 1 where x >= 22.00", "mode 1 -> 0 where x <= 20.00"]


def test_an_invariant_that_never_ends_or_ends_behind_a_guard_is_harmless(tmp_path):
    for on in ("x <= 22 & x <= 25", "x <= 22 & x >= 0", "x <= 22 & 0 <= 2*x"):
        # x >= 0 holds on the way up, since x' is 2 there
        assert _model(tmp_path, _heater(on)).equations(2)[2:] == SWITCHED


@pytest.mark.parametrize("on", ["x <= 23", "true", "x <= 100"])
def test_a_transition_that_may_be_taken_is_refused_or_taken_at_once(on, tmp_path):
    with pytest.raises(ValueError, match="ends where no guard|may be taken or not"):
        _model(tmp_path, _heater(on + " & x <= 30 - x" if on == "x <= 100" else on))
    assert _model(tmp_path, _heater(on), urgent=True).equations(2)[2:] == SWITCHED


def test_a_transition_that_is_said_to_be_taken_at_once_is_read(tmp_path):
    heater = _heater("true", more='asap="true"')
    assert _model(tmp_path, heater).equations(2)[2:] == SWITCHED


def test_a_target_that_cannot_be_entered_is_refused(tmp_path):
    three = _component(
        "a",
        _param("x"),
        _location(1, "x' == 1", "x <= 2"),
        _location(2, "x' == 1", "x <= 1"),
        _location(3, "x' == 0"),
        _edge(1, 2, "x >= 2"),
        _edge(2, 3, "x >= 1"),
    )
    with pytest.raises(ValueError, match="the invariant of location l2 need not hold where"):
        _model(tmp_path, three)
    reset = three.replace("<assignment>", "<assignment>x := 0.5*x - 0.2", 1)
    assert _model(tmp_path, reset).n_modes == 3


def test_two_transitions_at_one_place_are_refused(tmp_path):
    heater = _heater().replace("</component>", _edge(1, 1, "2*x >= 44", "x := 0") + "</component>")
    with pytest.raises(ValueError, match="begin at one place, and nothing tells which is taken"):
        _model(tmp_path, heater)


def test_powers_that_other_tools_print_are_read(tmp_path):
    cubic = _component("a", _param("x"), _location(1, "x' == -x^2.0 + 2e0*x^3"))
    assert _model(tmp_path, cubic).equations(1) == ["mode 0: x' = -1.0 x^2 + 2.0 x^3"]


def test_a_state_of_the_name_of_a_clock_keeps_its_own_start(tmp_path):
    timed = _component(
        "a",
        _param("x"),
        _param("time"),
        _location(1, "x' == 1 & time' == 1", "time <= 3"),
        _location(2, "x' == -1 & time' == 1"),
        _edge(1, 2, "time >= 3"),
    )
    found = _model(tmp_path, timed)
    assert found.state_names == ["x", "time_2"]
    run = found.simulate([0.0, 1.0], [10.0, 14.0], mode=0)
    assert run.events[0].time == pytest.approx(12.0, abs=1e-12)


# -- networks ----------------------------------------------------------------------------------

TANK = _component(
    "tank",
    _param("x"),
    _param("top", "const"),
    _param("rate", "const"),
    _location(1, "x' == rate", "x <= top"),
    _location(2, "x' == -rate", "x >= 0"),
    _edge(1, 2, "x >= top"),
    _edge(2, 1, "x <= 0"),
)


def test_two_instances_of_one_template_run_side_by_side(tmp_path):
    net = _component(
        "net",
        _param("a"),
        _param("b"),
        _bind("tank", "one", x="a", top=2, rate=1),
        _bind("tank", "two", x="b", top="1.5", rate="0.7"),
    )
    found = _model(tmp_path, TANK, net)
    assert (found.state_names, found.n_modes, len(found.transitions)) == (["a", "b"], 4, 8)
    t = np.linspace(0.0, 20.0, 201)
    run = found.simulate([0.5, 0.2], t, mode=0)

    def triangle(start, rate, top):
        along = (start + rate * t) % (2 * top)
        return np.minimum(along, 2 * top - along)

    expected = np.column_stack([triangle(0.5, 1.0, 2.0), triangle(0.2, 0.7, 1.5)])
    np.testing.assert_allclose(run.x, expected, atol=1e-9)


def test_constants_of_networks_may_be_left_open(tmp_path):
    net = _component(
        "net",
        _param("h"),
        _param("full", "const"),
        _bind("tank", "only", x="h", top="full", rate=1),
    )
    found = _model(tmp_path, TANK, net, parameters={"full": 3.0})
    assert found.equations(1)[2] == "mode 0 -> 1 where h >= 3.0"
    # what a bind gives holds, and no other value
    with pytest.raises(ValueError, match="'rate' a value, which the model does not leave open"):
        _model(tmp_path, TANK, net, parameters={"full": 3.0, "rate": 2.0})


def test_names_are_exchanged_and_fed_back_as_binds_say(tmp_path):
    pair = _component("p", _param("x"), _param("y"), _location(1, "x' == 1 & y' == 2e0*x"))
    net = _component("net", _param("x"), _param("y"), _bind("p", "p1", x="y", y="x"))
    assert _model(tmp_path, pair, net).equations(1) == [
        "mode 0: x' = 2.0 y",
        "mode 0: y' = 1.0",
    ]
    fed = _component("f", _param("x"), _param("u", controlled="false"), _location(1, "x' == -u"))
    net = _component("net", _param("z"), _bind("f", "f1", x="z", u="z"))
    assert _model(tmp_path, fed, net).equations(1) == ["mode 0: z' = -1.0 z"]


def test_locals_of_instances_stay_apart_and_networks_nest(tmp_path):
    part = _component(
        "part", _param("x"), _param("own", local="true"), _location(1, "x' == own & own' == -x")
    )
    inner = _component("inner", _param("x"), _bind("part", "p", x="x"))
    outer = _component(
        "outer", _param("a"), _param("b"), _bind("inner", "i", x="a"), _bind("inner", "j", x="b")
    )
    found = _model(tmp_path, part, inner, outer)
    assert sorted(found.state_names) == ["a", "b", "i_p_own", "j_p_own"]
    assert "mode 0: a' = 1.0 i_p_own" in found.equations(1)


def test_transitions_with_a_common_label_are_taken_together(tmp_path):
    # the plant only flows, the controller only switches: the plant's transitions have no guard
    plant = _component(
        "plant",
        _param("x"),
        _param("up", kind="label"),
        _location(1, "x' == -1"),
        _location(2, "x' == 2"),
        _edge(1, 2, "", "x' == x", "up"),
        _edge(2, 1, "", label="down"),
    )
    controller = _component(
        "controller",
        _param("x", controlled="false"),
        _param("up", kind="label"),
        _param("down", kind="label"),
        _location(1, "", "x >= 18"),
        _location(2, "", "x <= 21"),
        _edge(1, 2, "x <= 18", label="up"),
        _edge(2, 1, "x >= 21", label="down"),
    )
    names = {"x": "t", "up": "on", "down": "off"}
    net = _component(
        "net",
        _param("t"),
        _param("on", kind="label"),
        _param("off", kind="label"),
        _bind("plant", "p", **names),
        _bind("controller", "c", **names),
    )
    found = _model(tmp_path, plant, controller, net)
    taken = [line for line in found.equations(0) if "->" in line]
    assert taken == ["mode 0 -> 3 where t <= 18", "mode 3 -> 0 where t >= 21"]
    run = found.simulate([20.0], [0.0, 7.9], mode=0)
    assert [event.time for event in run.events] == pytest.approx([2.0, 3.5, 6.5], abs=1e-12)


@pytest.mark.parametrize(
    ("net", "why"),
    [
        (_bind("tank", "a", x="a", top=1), "the bind a leaves rate open"),
        (_bind("tank", "a", x=3, top=1, rate=1), "the bind a gives x the value '3'"),
        (_bind("tank", "a", x="c", top=1, rate=1), "the bind a gives x the value 'c'"),
        (_bind("tank", "a", x="a", top="b", rate=1), "the bind a gives top the value 'b'"),
        (_bind("tank", "a", x="a", top="2*3", rate=1), "gives top the value '2*3'"),
        (_bind("tank", "a", x="q", top=1, rate=1), "gives x the value 'q'"),
        (_bind("tank", "a", x="a", top=1, rate=1, y="b"), "maps 'y', which its component lacks"),
        (_bind("tonk", "a", x="a"), "a network binds 'tonk', which there is not"),
        (_bind("tank", "a", x="a", top=1, rate=1) * 2, "two binds of its network 'net' have one"),
        (
            _bind("tank", "a", x="a", top=1, rate=1) + _bind("tank", "b", x="a", top=1, rate=1),
            "one flow has two equations for a",
        ),
    ],
)
def test_binds_that_make_no_sense_are_refused(net, why, tmp_path):
    whole = _component("net", _param("a"), _param("b"), _param("c", "const"), net)
    with pytest.raises(ValueError) as refused:
        _model(tmp_path, TANK, whole, component="net")
    assert why in str(refused.value)


def test_the_component_is_asked_for_where_several_could_be_meant(tmp_path):
    other = _component("other", _param("y"), _location(1, "y' == 1"))
    with pytest.raises(ValueError, match="2 components .*, heater, other; give component="):
        _model(tmp_path, _heater(), other)
    assert _model(tmp_path, _heater(), other, component="other").state_names == ["y"]
    with pytest.raises(ValueError, match="no component 'third', but heater, other"):
        _model(tmp_path, _heater(), other, component="third")


# -- what is written ---------------------------------------------------------------------------


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_what_is_written_holds_where_a_transition_is_taken_and_not_after_it(case, tmp_path):
    automaton, path = case.automaton, tmp_path / "model.xml"
    automaton.to_spaceex(path)
    guards = re.findall("<guard>(.*)</guard>", path.read_text())
    columns = automaton.guard_columns
    conditions = [
        [
            read_inequality(one.replace("&lt;", "<").replace("&gt;", ">"), columns, {})
            for one in told
        ]
        for told in (guard.split(" &amp; ") for guard in guards)
    ]

    def margins(number, x, dwell, time):
        values = np.concatenate([x, (dwell, time)])
        sums = [
            sum(coef * np.prod(values ** np.array(powers)) for powers, coef in one.items())
            for one in conditions[number]
        ]
        return np.array(sums)

    run = automaton.simulate(case.x0, [0.0, case.end], mode=case.mode)
    entered = np.concatenate([[0.0], [event.time for event in run.events]])
    assert len(run.events) == case.n_events
    for event, since in zip(run.events, entered[:-1], strict=True):
        taken = [
            number
            for number, one in enumerate(automaton.transitions)
            if (one.source, one.target) == (event.before, event.after)
            and margins(number, event.state, event.time - since, event.time).min() > -1e-6
        ]
        assert taken
        landed = automaton.transitions[taken[0]].landing(event.state)
        for number, one in enumerate(automaton.transitions):
            if one.source == event.after:
                assert margins(number, landed, 0.0, event.time).min() < -1e-3


def test_settings_are_written_beside_the_model(tmp_path):
    ball = CASES["ball with restitution"].automaton
    t = np.linspace(0.0, 6.0, 601)
    ball.to_spaceex(tmp_path / "ball.xml", "ball", x0=[5.0, 1.0], t=t)
    lines = (tmp_path / "ball.cfg").read_text().splitlines()
    told = dict(line.split(" = ") for line in lines)
    assert told["system"] == '"ball"'
    assert told["initially"] == '"loc()==mode0 & h==5.0 & v==1.0"'
    assert told["output-variables"] == '"h, v"'
    assert told["time-horizon"] == '"6.0"'
    assert float(told["sampling-time"].strip('"')) == pytest.approx(0.01)


def test_settings_begin_where_the_first_recording_does_and_say_what_is_not_known(tmp_path):
    stated = HybridAutomaton.stated(
        [{"T": "1"}, {"T": "-1"}],
        [(0, 1, "dwell >= 2"), (1, 0, "T <= 0 + 0 time")],
        states=["T"],
    )
    stated.to_spaceex(tmp_path / "a.xml")
    text = (tmp_path / "a.cfg").read_text()
    assert [line for line in text.splitlines() if line.startswith("#")] == [
        f"# {what} is not known to the automaton: put yours here, or give {argument} to to_spaceex"
        for what, argument in (
            ("the state at the start", "x0"),
            ("the mode at the start", "mode"),
            ("the horizon", "t"),
        )
    ]
    first = FirstModes(np.array([[0.25], [1.0]]), np.array([1, 0]))
    parts = stated.coef, stated.feature_map, stated.transitions
    HybridAutomaton(*parts, first_modes=first).to_spaceex(tmp_path / "a.xml", t=[2.0, 2.5, 4.0])
    text = (tmp_path / "a.cfg").read_text()
    assert 'initially = "loc()==mode1 & T==0.25 & dwell==0.0"' in text
    assert "#" not in text


ONE, X = (0,), (1,)  # powers of x


@pytest.mark.parametrize(("guards", "zero", "known", "covered"), [
    ([], [], [], False), ([], [], [{ONE: -1.0}], True), ([], [{ONE: 2.0}], [], True),
    ([], [{X: 1.0}], [], False), ([[{X: 1.0}]], [{X: 1.0}], [], True),
    ([[{X: 1.0}], [{X: -1.0}]], [], [{X: 1.0, ONE: 1.0}], True),
    ([[{X: 1.0}]], [], [{X: 1.0, ONE: 1.0}], False),
], ids=["nothing known", "-1 >= 0 is nowhere", "2 = 0 is nowhere", "x = 0 is somewhere",
        "x >= 0 where x = 0", "x >= 0 or -x >= 0", "x >= 0 alone"])  # fmt: skip
def test_guards_that_cover_what_is_there(guards, zero, known, covered):
    assert _covered(guards, zero, known) is covered
