"""Sentences about laws: what they say, how they are printed, and what is refused."""

import pickle

import numpy as np
import pytest
from sklearn.base import clone

from swsysid import Known, TrajectoryIdentifier

EQUATIONS, TERMS = ["x", "v"], ["1", "x", "v", "u"]
SENTENCES = [
    "x' = v",
    "x' + v' = 2 x - 9.81",
    "v'[1] = -9.81",
    "v'[v] <= 0",
    "v'[x] >= -0.001",
    "-1 <= v'[u] <= 2",
    "v'[x] - 2 v'[u] = 0",
    "v' has no u, x",
    "v' has no other terms",
    "v' has only x, v",
    "v'[u] same in all modes",
    "v' same in all modes",
    "x'' = -9.81 x - 0.5 x'",
    "x''[x'] <= 0",
    "x'' has no x x'",
    "x' = -v' + 2",
]


def region(*sentences, n_modes=2, terms=TERMS):
    return Known.from_text(sentences).region(EQUATIONS, terms, n_modes)


@pytest.mark.parametrize("sentence", SENTENCES)
def test_what_is_printed_is_read_as_the_same(sentence):
    known = Known.from_text(sentence)
    assert str(known) == sentence
    assert Known.from_text(str(known)) == known


@pytest.mark.parametrize(
    ("written", "printed"),
    [
        ("x'=v.", "x' = v"),
        ("x[k+1] = 1e-1*x", "x' = 0.1 x"),
        ("-2*v'[x] >= 4", "v'[x] <= -2"),
        ("v'[x] = 2 v'[u]", "v'[x] - 2 v'[u] = 0"),
        ("2 >= v'[u] > -1", None),
        ("2 >= v'[u] >= -1", "-1 <= v'[u] <= 2"),
        ("v'[u] is the same in every mode", "v'[u] same in all modes"),
        ("`speed, m/s`' = `c-d`", "`speed, m/s`' = `c-d`"),
        ("v'[sin(x - 1)] = 3", "v'[sin(x - 1)] = 3"),
    ],
)
def test_words_and_signs_may_be_others(written, printed):
    assert str(Known.from_text(written)) == (printed or "-1 <= v'[u] <= 2")


def test_methods_say_what_sentences_say():
    by_methods = (
        Known().equal("x' = v").fix("v'", "1", -9.81).bound("v", "v", upper=0.0)
        .zero("v'", "u", "x").terms("v'", ["1", "v"]).tie("v'", "u").tie("x'")
    )  # fmt: skip
    assert by_methods == Known.from_text([
        "x' = v", "v'[1] = -9.81", "v'[v] <= 0", "v' has no u, x", "v' has only 1, v",
        "v'[u] same in all modes", "x' same in all modes",
    ])  # fmt: skip


def test_a_law_is_all_of_its_terms():
    told, values = region("x' = 2 v - 3").fixed
    np.testing.assert_array_equal(told, np.tile([[[True] * 4, [False] * 4]], (2, 1, 1)))
    np.testing.assert_array_equal(values[:, 0], [[-3.0, 0.0, 2.0, 0.0]] * 2)


def test_speeds_have_names_with_a_prime():
    known = Known.from_text(["x'' = -4 x - 0.5 x'", "x' = x'"])
    told, values = known.region(["x", "x'"], ["1", "x", "x'"], 1).fixed
    assert told.all()
    np.testing.assert_array_equal(values, [[[0.0, 0.0, 1.0], [0.0, -4.0, -0.5]]])


@pytest.mark.parametrize("order", [1, -1])
def test_other_terms_are_those_that_nothing_names(order):
    sentences = ["v'[x] = -9.81", "v' has no other terms", "v'[u] same in all modes"][::order]
    told, values = region(*sentences).fixed
    np.testing.assert_array_equal(told[:, 1], [[True, True, True, False]] * 2)
    np.testing.assert_array_equal(values[:, 1], [[0.0, -9.81, 0.0, 0.0]] * 2)


def test_coefficients_that_others_tell_are_fixed():
    told, values = region("v'[u] = 0.25", "v'[x] + v'[u] = 1").fixed
    assert told[:, 1, [1, 3]].all() and told.sum() == 4
    assert (values[:, 1, 1] == 0.75).all()


@pytest.mark.parametrize(
    ("sentences", "said"),
    [
        (["x'[v] = 2", "v'[x] = 1", "x' = v"], '"x\'[v] = 2" and "x\' = v" cannot hold together'),
        (["v'[x] <= 0", "v'[x] >= 1e-3"], "contradicts itself"),
        (["1 <= v'[x] <= 0"], "excludes every law"),
        (["v'[x] + v'[v] = 1", "v'[v] = 0.5", "v'[x] <= 0.4"], '"v\'[x] <= 0.4"'),
        (
            ["x'[v] = 3", "x'[v] = 4", "v'[1] = 0", "v'[x] = 1", "v'[1] + v'[x] = 5"],
            'itself: "x\'[v] = 3" and "x\'[v] = 4" cannot',
        ),
        (["w' = v"], "names the equation w', which there is not; the equations are x', v'"),
        (["x' = w"], "names the term w, which there is not; the terms are 1, x, v, u"),
    ],
)
def test_what_cannot_hold_is_refused_with_the_smallest_set(sentences, said):
    with pytest.raises(ValueError) as refused:
        region(*sentences)
    assert said in str(refused.value)
    assert "v'[x] = 1" not in str(refused.value)


@pytest.mark.parametrize(
    "text",
    [
        "", "hello", "x' =", "x' = v'[x]", "v'[x] = u", "v' has no", "v' has only others",
        "v'[] <= 1", "same in all modes", "a = b", "1 <= 2", "__import__('os')", "v'[x] == 3",
        "v' in mode 1 has no u", "v'[x] < y", "v'[x] +", "2 v' same in all modes", "x has no v",
        "1 <= v' <= 2", None, 5, "v'[x] >= 1e999", "0 <= v'[x] <= inf",
        "v'[x] >= 1 and v'[x] <= 0",
    ],
)  # fmt: skip
def test_what_is_no_sentence_is_refused_in_one(text):
    with pytest.raises(ValueError, match=r"^known=.*\.$"):
        Known.from_text([text])


@pytest.mark.parametrize(
    "call",
    [
        lambda: Known().fix("v'", "x", np.nan),
        lambda: Known().bound("v'", "x"),
        lambda: Known().bound("v'", "x", lower=1, upper=0),
        lambda: Known().zero("v'"),
        lambda: Known().terms("v'", [1]),
        lambda: Known().tie(3),
    ],
)
def test_calls_that_make_no_sense_are_refused(call):
    with pytest.raises((ValueError, TypeError)):
        call()


def test_it_never_changes_and_is_a_parameter_like_others():
    known = Known().fix("v'", "x", 1)
    known.zero("v'", "u")
    assert known == Known.from_text("v'[x] = 1") and len(known) == 1
    assert hash(known) == hash(pickle.loads(pickle.dumps(known)))
    assert clone(TrajectoryIdentifier(known=known)).known == known
    assert repr(known) == 'Known.from_text(["v\'[x] = 1"])'
    assert eval(repr(known)) == known


@pytest.mark.parametrize(
    ("sentences", "beside"),
    [
        (["x'[v] = 2", "v'[v] <= 0", "x' = 2 v"], (2,)),
        (["x'[x] = 0", "x'[x] same in all modes"], (1,)),
        (["x'[x] same in all modes", "v'[x] = 1", "x'[x] = 0"], (2,)),
        (["v'[x] <= 0", "-1 <= v'[x] <= 0", "v'[x] <= 1"], (1,)),  # of those that are reached
        (["v'[x] + v'[v] = 1", "v'[x] = 0.5", "v'[v] = 0.5", "x'[u] = 0"], (2,)),
        (["v'[x] = 0", "v'[v] = 0"], ()),
    ],
)
def test_sentences_that_say_the_same_in_part_are_as_few_as_can_be(sentences, beside):
    own = region(*sentences)
    coef = own.nearest(np.zeros(own.names.shape), np.ones(own.names.shape, bool), np.eye(16))
    assert own.beside(0, coef, np.ones(coef.shape, bool)) == beside


@pytest.mark.parametrize(
    ("sentences", "one"),
    [
        (["x' same in all modes", "v' same in all modes"], True),
        (["x' = v", "v' same in all modes"], True),
        (["x' = v", "v' = 2 x"], True),
        (["x' = v", "v'[x] same in all modes"], False),
    ],
)
def test_modes_that_cannot_differ_are_seen(sentences, one):
    assert region(*sentences).is_of_one_law == one
    assert not region(*sentences, n_modes=1).is_of_one_law
