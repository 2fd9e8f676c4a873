"""Laws whose columns are monomials are stepped as such, and lead where any others do."""

import numpy as np
import pytest

from swsysid._data.records import make_records
from swsysid._output_error.law import Law
from swsysid._output_error.stretches import Stretches
from swsysid._stays.polynomial_laws import AffineLaws, PolynomialLaws
from swsysid.effects import Bias, CoulombFriction, DeadZone, Delay, Drift, PlacedEffect, Polynomial

POWERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])  # 1, x, v, u


@pytest.fixture(scope="module")
def stretches():
    rng, t = np.random.default_rng(3), 0.1 * np.arange(200)
    X = np.column_stack([np.sin(t), np.cos(t), rng.standard_normal(200)])
    records = make_records(X, 2, t=t, names=["x", "v", "u"])
    return Stretches.of(records, records, np.arange(200))


def laws_of(terms, stretches, powers):
    declared = np.array([[False] * 4, [True] * 4])
    known = np.array([[0.0, 0.0, 1.0, 0.0], [0.0] * 4])
    law = Law.of(lambda X: np.column_stack([np.ones(len(X)), X]), declared, known, powers)
    law = law.beside(terms)
    law.coef[1] = np.linspace(-1.0, 0.7, law.coef.shape[1])
    further = law.further(stretches.seen)
    nodes = stretches.nodes(further, law.keeps_steps(stretches.seen))
    return law.laws(stretches, np.ones(2), further), nodes


@pytest.mark.parametrize(
    ("term", "kind"),
    [
        (PlacedEffect(Bias(), "constant", 1), AffineLaws),
        (PlacedEffect(Delay(), 2, 1, theta=(0.25,)), AffineLaws),
        (PlacedEffect(Polynomial(), (0, 0, 1), 1), PolynomialLaws),
        (PlacedEffect(Polynomial(), (2,), 1), AffineLaws),
        (PlacedEffect(Drift(), 0, 1), PolynomialLaws),  # of a coefficient of a state
    ],
)
def test_they_lead_where_laws_of_any_features_lead(term, kind, stretches):
    terms = [PlacedEffect(Delay(), 2, 1, theta=(0.1,)), term]
    own, nodes = laws_of(terms, stretches, POWERS)
    any_laws, _ = laws_of(terms, stretches, None)
    assert type(own) is kind and not isinstance(any_laws, PolynomialLaws)
    first = nodes.begins
    rows = nodes.y[first], nodes.u[first], nodes.after[first], nodes.steps
    ends, by_state, by_law = own.flow(0, *rows)
    expected = any_laws.flow(0, *rows)
    np.testing.assert_allclose(ends, expected[0], rtol=1e-12, atol=1e-12)
    # the others are differences to one side over a millionth of a spread
    np.testing.assert_allclose(by_state + 0.0 * expected[1], expected[1], atol=1e-5)
    np.testing.assert_allclose(by_law, expected[2], atol=1e-5)


@pytest.mark.parametrize(
    "term", [PlacedEffect(DeadZone(), 2, 1, theta=(0.5,)), PlacedEffect(CoulombFriction(), 1, 1)]
)
def test_what_is_no_monomial_makes_others_of_them(term, stretches):
    assert not isinstance(laws_of([term], stretches, POWERS)[0], PolynomialLaws)
