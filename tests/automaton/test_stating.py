"""Automata from text: what is read, what is printed, what is refused."""

import numpy as np
import pytest

from swsysid import FunctionLibrary, HybridAutomaton
from swsysid._automaton.polynomial_text import read_inequality, read_polynomial
from swsysid.results import AffineReset, PolynomialGuard, Transition


@pytest.mark.parametrize(
    ("text", "polynomial"),
    [
        ("2 x^2 v - v/4", {(2, 1): 2.0, (0, 1): -0.25}),
        ("-x^2", {(2, 0): -1.0}),
        ("-(x - v) * 3", {(1, 0): -3.0, (0, 1): 3.0}),
        ("(x + v)**2", {(2, 0): 1.0, (1, 1): 2.0, (0, 2): 1.0}),
        ("1e-3 x + .5 + 2.", {(1, 0): 1e-3, (0, 0): 2.5}),
        ("g x - - 1", {(1, 0): 9.81, (0, 0): 1.0}),
        ("x v 2", {(1, 1): 2.0}),
        ("2 -x", {(0, 0): 2.0, (1, 0): -1.0}),
        ("x - x", {}),
        ("x^0", {(0, 0): 1.0}),
        (7, {(0, 0): 7.0}),
    ],
)
def test_polynomials_are_read(text, polynomial):
    assert read_polynomial(text, ["x", "v"], {"g": 9.81}) == pytest.approx(polynomial)


def test_inequalities_rise_where_they_become_true():
    assert read_inequality("x >= 2", ["x"], {}) == read_inequality("2 <= x", ["x"], {})
    assert read_inequality("x < 2", ["x"], {}) == {(1,): -1.0, (0,): 2.0}


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("x +", "ends too early"),
        ("(x", "has a bracket that is not closed"),
        ("x)", "ends in ')'"),
        ("2 / x", "divides by something that is no number other than zero"),
        ("x / 0", "divides by something that is no number other than zero"),
        ("x^0.5", "has a power that is no whole number"),
        ("x^v", "has a power that is no whole number"),
        ("sin(x)", "has the unknown name 'sin'"),
        ("__import__('os')", "has"),
        ("x $ 2", "has '$', which cannot be read"),
        ("* x", "lacks a value before '*'"),
        ("(1 + x + v)^200", "has too many terms"),
        ("(" * 100000, "has too many brackets in each other"),
    ],
)
def test_what_is_no_polynomial_is_refused(text, why):
    with pytest.raises(ValueError) as refused:
        read_polynomial(text, ["x", "v"], {})
    assert why in str(refused.value) and "give one in x, v." in str(refused.value)


LAWS = [{"x": "v", "v": "-x"}, {"x": "v", "v": "-x - v"}]


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"laws": [{"x": "v"}]}, "the law of mode 0 is one of x; give one polynomial for each of"),
        ({"laws": np.zeros((2, 3, 4))}, "coef has shape (2, 3, 4); give (n_modes, n_states, 2)"),
        ({"feature_library": 2}, "laws given as text are polynomials and take no feature_library"),
        ({"transitions": [(0, 1)]}, "transitions[0]=(0, 1) must be a Transition or a tuple"),
        ({"transitions": [(0, 2, "x >= 1")]}, "transitions[0] leads from mode 0 to mode 2; the"),
        ({"transitions": [(0, 1, "x = 1")]}, "'x = 1' is no condition; give inequalities"),
        ({"transitions": [(0, 1, "x >= 1", {"y": "0"})]}, "transitions[0] resets 'y', which is no"),
        ({"transitions": [(0, 1, "x >= 1", {"x": "x v"})]}, "the reset of x in transitions[0] is"),
        ({"states": ["x", "time"]}, "'time' names a state or an input and something else too"),
        ({"lags": 1}, "lags=1 is out of reach; it must be at most 0."),
        ({"parameters": {"x": 1.0}}, "'x' names a state or an input and something else too"),
    ],
)
def test_wrong_statements_are_refused(changed, message):
    right = {"laws": LAWS, "transitions": [(0, 1, "x >= 1")], "states": ["x", "v"]}
    with pytest.raises((ValueError, TypeError)) as refused:
        HybridAutomaton.stated(**(right | changed))
    assert message in str(refused.value)


def test_transitions_of_another_shape_are_refused():
    guard = PolynomialGuard(np.ones(1), np.array([[1, 0, 0]]))
    with pytest.raises(ValueError, match=r"has 1 coefficients and powers of shape \(1, 3\)"):
        HybridAutomaton.stated(LAWS, [Transition(0, 1, guard)], states=["x", "v"])
    guard = PolynomialGuard(np.array([np.nan]), np.array([[1, 0, 0, 0]]))
    with pytest.raises(ValueError, match="holds NaN or infinity; give finite numbers"):
        HybridAutomaton.stated(LAWS, [Transition(0, 1, guard)], states=["x", "v"])
    reset = AffineReset(np.eye(3), np.zeros(3))
    guard = PolynomialGuard(np.ones(1), np.array([[1, 0, 0, 0]]))
    with pytest.raises(ValueError, match=r"has a matrix of shape \(3, 3\)"):
        HybridAutomaton.stated(LAWS, [Transition(0, 1, guard, reset)], states=["x", "v"])


def test_laws_may_be_coefficients_of_any_library():
    library = FunctionLibrary([np.sin, lambda x: x], names=["sin({})", "{}"])
    automaton = HybridAutomaton.stated(
        [[[-1.0, 0.0]], [[0.0, -0.5]]],
        [(0, 1, "x <= 0.5")],
        states=["x"],
        feature_library=library,
    )
    assert automaton.equations(precision=1) == [
        "mode 0: x' = -1.0 sin(x)",
        "mode 1: x' = -0.5 x",
        "mode 0 -> 1 where x <= 0.5",
    ]
    # x' = -sin x: tan(x / 2) falls like exp(-t)
    (event,) = automaton.simulate([1.0], [0.0, 2.0], mode=0).events
    assert event.time == pytest.approx(np.log(np.tan(0.5) / np.tan(0.25)), abs=1e-8)


AUTOMATON = HybridAutomaton.stated(
    [{"x": "2 v", "v": "u - x^2"}, {"x": "0", "v": "1e-4"}],
    [
        (0, 1, "x^2 + v^2 >= 4", {"x": "0.5 x - 1", "v": 0}),
        (1, 0, "dwell >= 0.25"),
        (1, 1, "time x > u"),
    ],
    states=["x", "v"],
    inputs=["u"],
)


def test_equations_as_text_and_latex():
    assert AUTOMATON.equations(precision=2) == [
        "mode 0: x' = 2.00 v",
        "mode 0: v' = 1.00 u - 1.00 x^2",
        "mode 1: x' = 0",
        "mode 1: v' = 1.00e-4",
        "mode 0 -> 1 where 1.00 x^2 + 1.00 v^2 - 4.00 >= 0: x := -1.00 + 0.50 x, v := 0",
        "mode 1 -> 0 where dwell >= 0.25",
        "mode 1 -> 1 where 1.00 x time - 1.00 u >= 0",
    ]
    latex = AUTOMATON.equations(precision=1, format="latex")
    assert latex[0] == r"\text{mode } 0: \; \dot{x} = 2.0 v"
    assert latex[4] == (
        r"\text{mode } 0 \to 1: \; 1.0 x^{2} + 1.0 v^{2} - 4.0 \geq 0, "
        r"\; x \leftarrow -1.0 + 0.5 x, \; v \leftarrow 0"
    )
    with pytest.raises(ValueError, match="format='html' is unknown"):
        AUTOMATON.equations(format="html")


def test_printed_guards_can_be_read_again():
    lines = AUTOMATON.equations(precision=12)[4:]
    for line, transition in zip(lines, AUTOMATON.transitions, strict=True):
        condition = line.partition(" where ")[2].partition(":")[0]
        told = read_inequality(condition, AUTOMATON.guard_columns, {})
        guard = transition.guard
        known = dict(zip(map(tuple, guard.powers.tolist()), guard.coef.tolist(), strict=True))
        assert told == pytest.approx(known, abs=1e-12)


def test_names_and_sizes():
    assert (AUTOMATON.n_modes, AUTOMATON.n_states, AUTOMATON.n_inputs) == (2, 2, 1)
    assert AUTOMATON.state_names == ["x", "v"] and AUTOMATON.input_names == ["u"]
    assert repr(AUTOMATON) == "HybridAutomaton(x, v; 2 modes, 3 transitions, continuous time)"
