"""Evidence is no larger by chance than it says, and grows with what is taken away."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from swsysid._output_error.criterion import Left, fall
from swsysid._output_error.engines import Model, as_likely, loss


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


def test_of_two_that_predict_alike_all_samples_may_surely_tell():
    """Errors of 1 and e ** -0.5 are 10 nats apart in 20 samples, one parameter 1.5 of them."""

    def model(error, n_parameters):
        law = SimpleNamespace(n_states=1, n_parameters=n_parameters)
        return Model(SimpleNamespace(law=law, errors=np.array([error])), Left(np.ones((4, 1)), ()))

    count = 20.0
    limit, lag, nearly = model(1.0, 1), model(np.exp(-0.5), 2), model(np.exp(-0.4), 1)
    lost = [loss(one.fit, count) - loss(lag.fit, count) for one in (limit, nearly)]
    assert lost == pytest.approx([10.0 - 0.5 * np.log(20.0), 2.0 - 0.5 * np.log(20.0)])
    # log(100) is 4.6: the simpler law with the larger error is surely less likely
    assert as_likely([limit, lag, nearly], count, 0.01) == [lag, nearly]
    assert as_likely([limit, lag, nearly], count, 1e-4) == [limit, lag, nearly]
    # and in few samples it is not
    assert as_likely([limit, lag, nearly], 4.0, 0.01) == [limit, lag, nearly]
