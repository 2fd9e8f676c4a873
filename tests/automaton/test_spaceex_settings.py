"""The .cfg beside a SpaceEx model, and models in the ways of HyST's examples, made here."""

import numpy as np
import pytest

from swsysid import HybridAutomaton
from swsysid._automaton.spaceex import read_settings

HEAD = '<sspaceex xmlns="http://www-verimag.imag.fr/xml-namespaces/sspaceex" version="0.2">'


def _param(name, dynamics="any"):
    return (
        f'<param name="{name}" type="real" local="false" d1="1" d2="1" dynamics="{dynamics}" '
        'controlled="true"/>'
    )


def _escaped(text):
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def _location(number, name, flow, invariant=""):
    return (
        f'<location id="{number}" name="{name}"><invariant>{_escaped(invariant)}</invariant>'
        f"<flow>{_escaped(flow)}</flow></location>"
    )


def _edge(source, target, guard, assignment=""):
    return (
        f'<transition source="{source}" target="{target}"><guard>{_escaped(guard)}</guard>'
        f"<assignment>{_escaped(assignment)}</assignment></transition>"
    )


def _write(folder, body, settings=None, component="tank"):
    path = folder / "model.xml"
    path.write_text(f'{HEAD}<component id="{component}">{body}</component></sspaceex>')
    if settings is not None:
        path.with_suffix(".cfg").write_text(settings)
    return path


TANK = (
    _param("h") + _param("top", "const") + _param("inflow", "const")
    + _location(1, "filling", "h' == inflow - 0.1*h", "h <= top")
    + _location(2, "draining", "h' == -0.3*h", "h >= 1")
    + _edge(1, 2, "h >= top") + _edge(2, 1, "h <= 1")
)  # fmt: skip
RUN = """# how it is run
system = tank
initially = "1 <= h & h <= 2 & top == 2*2 & inflow==1 & loc(tank_1)==filling"
scenario = "stc"
"""


def test_constants_and_the_start_are_those_of_the_settings(tmp_path):
    tank = HybridAutomaton.from_spaceex(_write(tmp_path, TANK, RUN.replace("tank_1", "")))
    assert tank.first_modes.states.tolist() == [[1.5]]  # the middle
    told = HybridAutomaton.from_spaceex(
        _write(tmp_path, TANK), parameters={"top": 4.0, "inflow": 1.0}
    )
    runs = [one.simulate([1.5], np.linspace(0.0, 40.0, 81), mode=0) for one in (tank, told)]
    assert np.array_equal(runs[0].x, runs[1].x) and len(runs[0].events) > 4
    # by hand: h = 10 - 8.5 exp(-t / 10) reaches 4; to the tolerance of the integrator
    assert runs[0].events[0].time == pytest.approx(10.0 * np.log(8.5 / 6.0), abs=1e-7)
    assert tank.simulate([1.5], [0.0, 1.0]).modes.tolist() == [0, 0]


def test_what_the_user_gives_counts_and_settings_may_lie_elsewhere(tmp_path):
    path = _write(tmp_path, TANK)
    (tmp_path / "other.cfg").write_text(RUN)
    tank = HybridAutomaton.from_spaceex(
        path, parameters={"top": 3.0}, settings=tmp_path / "other.cfg"
    )
    assert any("h >= 3.000" in line for line in tank.equations())


@pytest.mark.parametrize(
    ("initially", "why"),
    [
        ("0 <= top & top <= 4 & inflow == 1", "leave the constant 'top' between 0 and 4"),
        ("inflow == 1", "the model has the constant 'top' without a value"),
        ("top >= 2 & inflow == 1", "leave the constant 'top' between 2 and inf"),
        ("top + h == 2", "its settings say 'top + h == 2' of the start"),
        ("top == sin(2)", "has the unknown name 'sin'"),
    ],
)
def test_settings_that_do_not_tell_are_refused_in_a_sentence(initially, why, tmp_path):
    with pytest.raises(ValueError) as refused:
        HybridAutomaton.from_spaceex(_write(tmp_path, TANK, f'initially = "{initially}"'))
    message = str(refused.value)
    assert why in message and message.endswith(".") and "\n" not in message


def test_a_file_that_is_named_must_be_there(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"There is no file .*none\.cfg; check its name"):
        HybridAutomaton.from_spaceex(_write(tmp_path, TANK), settings=tmp_path / "none.cfg")
    with pytest.raises(FileNotFoundError, match=r"There is no file .*none\.xml; check its name"):
        HybridAutomaton.from_spaceex(tmp_path / "none.xml")
    with pytest.raises(IsADirectoryError, match="is a folder; name a file in it"):
        HybridAutomaton.from_spaceex(tmp_path)


@pytest.mark.parametrize(
    ("text", "ranges"),
    [
        ("x == 1 && 2 >= y >= -1", {"x": (1.0, 1.0), "y": (-1.0, 2.0)}),
        ("x >= 0 & x <= 3.14/2", {"x": (0.0, 1.57)}),
        ("c.clock = 0", {"c.clock": (0.0, 0.0)}),
        ("", {}),
    ],
)
def test_ranges(text, ranges):
    assert read_settings(f'initially = "{text}"').ranges == ranges


# -- models of other tools ---------------------------------------------------------------------


def test_an_output_is_what_defines_it(tmp_path):
    body = (
        _param("x") + _param("v") + _param("height")
        + _location(1, "on", "x' == v & v' == -x - height", "height == 2*x & x >= -9")
        + _edge(1, 1, "height <= -18", "v := -v")
    )  # fmt: skip
    read = HybridAutomaton.from_spaceex(_write(tmp_path, body), urgent=True)
    assert read.state_names == ["x", "v"]
    assert "mode 0: v' = -3.000 x" in read.equations()


def test_what_nothing_moves_is_an_input(tmp_path):
    body = (
        _param("x") + _param("u") + _location(1, "on", "x' == u - x", "-1 <= u & u <= 1")
    )  # fmt: skip
    read = HybridAutomaton.from_spaceex(_write(tmp_path, body), urgent=True)
    assert (read.state_names, read.input_names) == (["x"], ["u"])


TWO_WAYS = (
    _param("x") + _param("y") + _location(1, "on", "x' == 1 & y' == -y", "x <= 1")
    + _location(2, "left", "x' == 0 & y' == 0") + _location(3, "right", "x' == 0 & y' == 0")
    + _edge(1, 2, "x >= 1 & y <= 0") + _edge(1, 3, "x >= 1 & y >= 0")
)  # fmt: skip


@pytest.mark.parametrize(("y", "target"), [(-1.0, 1), (1.0, 2)])
def test_an_invariant_may_end_where_one_of_two_guards_begins(y, target, tmp_path):
    read = HybridAutomaton.from_spaceex(_write(tmp_path, TWO_WAYS))
    [event] = read.simulate([0.0, y], [0.0, 2.0], mode=0).events
    assert (event.time, event.after) == (pytest.approx(1.0, abs=1e-12), target)


def test_a_gap_between_two_guards_is_refused(tmp_path):
    body = TWO_WAYS.replace("y &gt;= 0", "y &gt;= 0.5")
    with pytest.raises(ValueError, match="ends where no guard of its location begins"):
        HybridAutomaton.from_spaceex(_write(tmp_path, body))
    assert len(HybridAutomaton.from_spaceex(_write(tmp_path, body), urgent=True).transitions) == 2


def test_an_equation_without_a_side_is_refused(tmp_path):
    body = TWO_WAYS.replace("y &gt;= 0", "y == 0")
    with pytest.raises(ValueError, match="'y == 0' is an equation, and no invariant tells from"):
        HybridAutomaton.from_spaceex(_write(tmp_path, body), urgent=True)


def test_an_assignment_may_have_one_sign_of_equality(tmp_path):
    body = TANK.replace("<assignment></assignment>", "<assignment>h = 0.9*h</assignment>", 1)
    tank = HybridAutomaton.from_spaceex(
        _write(tmp_path, body), parameters={"top": 4.0, "inflow": 1.0}
    )
    assert "mode 0 -> 1 where h >= 4.000: h := 0.900 h" in tank.equations()
