"""What a scan says each candidate explains is what the equations with its column say."""

import numpy as np
import pytest

from swsysid._data.records import make_records
from swsysid._output_error.estimate import fitted
from swsysid._output_error.law import Law
from swsysid._output_error.scan import RolloutScore
from swsysid._output_error.stretches import Stretches
from swsysid._stays.lifted import Estimate, Objective
from swsysid.effects import Bias, PlacedEffect, Polynomial, QuadraticDrag

TIE = 0.02


@pytest.fixture(scope="module")
def score():
    rng, t = np.random.default_rng(1), 0.05 * np.arange(400)
    X = np.column_stack([np.sin(t), np.cos(t)]) + 0.02 * rng.standard_normal((400, 2))
    records = make_records(X, 2, t=t, names=["x", "v"])
    stretches = Stretches.of(records, records, np.arange(400))
    law = Law.of(lambda X: X[:, :2], np.ones((2, 2), dtype=bool), np.zeros((2, 2)))
    fit = fitted(law, stretches)
    return stretches, fit, RolloutScore.of(fit, TIE)


def by_equations(term, stretches, fit, score):
    """Of one coefficient more, with all others and all states eliminated by a dense inverse."""
    law = fit.law.beside([term])
    spread = stretches.records.X.std(axis=0)
    laws = law.laws(stretches, spread, law.further(stretches.seen))
    nodes = score.followed.nodes
    equations = Objective(fit.noise, TIE).normal_equations(
        Estimate(laws, nodes, score.followed.states)
    )
    arrow, right = equations.reduced()
    n_band = len(arrow.border)
    band = np.zeros((n_band, n_band))
    for below, row in enumerate(arrow.band):
        at = np.arange(n_band - below)
        band[at + below, at] = band[at, at + below] = row[: n_band - below]
    matrix = np.block([[band, arrow.border], [arrow.border.T, arrow.corner]])
    _, state, feature = laws.places
    own = n_band + int(np.flatnonzero((state == term.target) & (feature == 2))[0])
    rest = np.delete(np.arange(len(matrix)), own)
    reached = np.linalg.solve(matrix[np.ix_(rest, rest)], matrix[rest, own])
    left = right[own] - reached @ right[rest]
    return left**2 / (matrix[own, own] - reached @ matrix[rest, own])


def test_gains_of_candidates_in_either_equation(score):
    stretches, fit, score = score
    terms = [
        PlacedEffect(QuadraticDrag(), 1, 1),
        PlacedEffect(Bias(), "constant", 0),
        PlacedEffect(Polynomial(), (0, 0, 1), 1),
        PlacedEffect(QuadraticDrag(), 1, 0),
        PlacedEffect(Bias(), "constant", 1),
    ]
    columns = [one.effect.columns(stretches.seen, one.place)[stretches.rows] for one in terms]
    gains = score.gains(terms, [score.response(one) for one in columns])
    expected = [by_equations(one, stretches, fit, score) for one in terms]
    # a column lies on lines between samples there, and is what the law makes of states here
    np.testing.assert_allclose(gains, expected, rtol=0.1, atol=0.05)
    assert np.argmax(gains) == np.argmax(expected)


def test_what_a_candidate_explains_does_not_ask_which_stand_beside_it(score):
    stretches, _, score = score
    terms = [PlacedEffect(Bias(), "constant", k % 2) for k in range(7)]
    columns = np.random.default_rng(0).standard_normal((7, len(stretches.rows), 1))
    responses = [score.response(one) for one in columns]
    alone = [score.gains([one], [own])[0] for one, own in zip(terms, responses, strict=True)]
    np.testing.assert_allclose(score.gains(terms, responses), alone, rtol=1e-9)
