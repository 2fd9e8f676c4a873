"""Reliability of mode probabilities: hand cases, planted truth, invariances."""

import numpy as np
import pytest

from swsysid.metrics import mode_reliability


def test_two_bins_by_hand():
    probability = np.array([[0.6, 0.4], [0.4, 0.6], [0.9, 0.1], [0.1, 0.9]])
    found = mode_reliability(["a", "a", "a", "b"], probability, n_bins=2)
    assert np.allclose(found.edges, [0.5, 0.75, 1.0], atol=1e-15)
    assert np.allclose(found.claimed, [0.6, 0.9], atol=1e-15)
    assert found.observed.tolist() == [0.5, 1.0] and found.count.tolist() == [2, 2]
    assert found.error == pytest.approx(0.5 * 0.1 + 0.5 * 0.1, abs=1e-15)


@pytest.mark.parametrize(("modes", "error"), [([0, 0, 1, 1], 0.0), ([0, 1, 0, 1], 0.5)])
def test_a_claim_may_be_certain(modes, error):
    """Sure of each row: right everywhere, and right in two of four."""
    found = mode_reliability(modes, np.eye(2)[[0, 0, 1, 1]], n_bins=2)
    assert found.count.tolist() == [0, 4] and found.claimed[1] == 1.0
    assert found.error == pytest.approx(error, abs=1e-15)


def test_honest_probabilities_have_a_small_error_and_boastful_ones_not():
    rng = np.random.default_rng(0)
    honest = rng.dirichlet([1, 1, 1], 20_000)
    modes = (rng.random((20_000, 1)) > honest.cumsum(axis=1)).sum(axis=1)
    # ten bins of about 2000: each share is known to .011, the mean of |normal| is 0.8 of that
    assert mode_reliability(modes, honest).error < 0.02
    boastful = honest**3 / (honest**3).sum(axis=1, keepdims=True)
    assert mode_reliability(modes, boastful).error > 0.1


def test_names_of_modes_do_not_matter_and_weights_are_repetitions():
    rng = np.random.default_rng(1)
    probability = rng.dirichlet([3, 1], 200)
    modes = (rng.random(200) > probability[:, 0]).astype(int)
    weight = rng.integers(0, 3, 200)
    rows = np.repeat(np.arange(200), weight)
    expected = mode_reliability(modes[rows], probability[rows], n_bins=5)
    found = mode_reliability(1 - modes, probability, n_bins=5, sample_weight=weight)
    for one, other in zip(vars(expected).values(), vars(found).values(), strict=True):
        assert np.allclose(one, other, rtol=1e-12, equal_nan=True)


@pytest.mark.parametrize(
    "probability, options, message",
    [
        ([[0.5, 0.4]], {}, "sum to one"),
        ([[1.5, -0.5]], {}, "sum to one"),
        ([[0.5, 0.5]], {"n_bins": 0}, "n_bins=0 must be a positive integer"),
    ],
)
def test_refusals(probability, options, message):
    with pytest.raises(ValueError, match=message):
        mode_reliability([0], probability, **options)
