"""Evidence is no larger by chance than it says, and grows with what is taken away."""

import numpy as np
import pytest
from scipy.signal import lfilter

from swsysid._output_error.criterion import Left, fall


def left(samples):
    """What a model leaves of one stretch."""
    return Left(samples, (np.arange(len(samples)),))


@pytest.mark.parametrize("factor", [0.0, 0.8])
def test_evidence_for_a_model_that_is_no_better_is_rare(factor):
    """The second model adds to the errors of the first what it has made up, a tenth as large."""
    rng, n_sure = np.random.default_rng(0), 0
    for _ in range(400):
        noise = rng.standard_normal((2, 600)) * np.sqrt(1.0 - factor**2)
        errors, made_up = lfilter([1.0], [1.0, -factor], noise)
        before, after = errors[:, None], (errors + 0.1 * made_up)[:, None]
        n_sure += fall(left(before), left(after)).p_value <= 0.05
    assert n_sure <= 0.05 * 400


def test_the_evidence_of_white_errors_is_the_ratio_of_likelihoods():
    """Half of 500 times the log of four, where both have the deviation that they should have."""
    errors = np.random.default_rng(1).standard_normal((500, 1))
    errors /= np.sqrt(np.mean(errors**2))
    judged = fall(left(2.0 * errors), left(errors))
    assert judged.nats == pytest.approx(250.0 * np.log(4.0), rel=0.15)  # of the memory
    assert judged.share == pytest.approx(0.75, abs=1e-12)
    assert judged.p_value < 1e-50


def test_stretches_that_are_harder_are_no_evidence_against_the_better_model():
    """Both err ten times as much as where they were fitted, the second a third of the first."""
    errors = 10.0 * np.random.default_rng(2).standard_normal((300, 1))
    assert fall(left(errors), left(errors / 3.0)).p_value < 1e-50
    assert fall(left(errors / 3.0), left(errors)).p_value == 1.0


def test_what_has_diverged_is_worse_by_a_bound():
    errors = np.ones((100, 2))
    gone = np.full((100, 2), np.inf)
    judged = fall(left(errors), left(gone))
    assert judged.share == pytest.approx(1.0 - 25.0)
    assert judged.p_value == 1.0
