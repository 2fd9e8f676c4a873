"""What is known of laws holds in an automaton, and its recordings are asked about it."""

import numpy as np
import pandas as pd
import pytest

from swsysid import HybridAutomaton, HybridAutomatonRegressor

T = np.arange(0.0, 30.0, 0.1)


def identified(known, **options):
    """A heater, three recordings with noise."""
    plant = HybridAutomaton.stated(
        [{"T": "-0.1 (T - 30)"}, {"T": "-0.1 (T - 10)"}],
        [(0, 1, "T >= 22"), (1, 0, "T <= 18")],
        states=["T"],
    )
    generator = np.random.default_rng(0)
    given = [
        pd.DataFrame(
            plant.simulate([start], T, mode=0).x + 0.05 * generator.standard_normal((len(T), 1)),
            columns=["T"],
        )
        for start in (15, 17, 19)
    ]
    regressor = HybridAutomatonRegressor(2, random_state=0, known=known, **options)
    return regressor.fit(given, [T] * 3)


def test_a_tie_holds_and_its_laws_are_closer_to_the_truth():
    free, found = identified(None), identified(["T'[T] same in all modes"])
    rates = found.coef_[:, 0, 1]
    assert rates[0] == pytest.approx(rates[1], abs=1e-12)
    truth = np.array([[3.0, -0.1], [1.0, -0.1]])
    errors = [np.abs(one.coef_[:, 0] - truth).max() for one in (found, free)]
    assert errors[0] < errors[1] / 2.0
    assert (found.coef_errors_ < free.coef_errors_ * 1.01).all()  # noise is estimated anew
    [check] = found.known_
    assert not check.questioned and not free.known_
    assert "Known: T'[T] same in all modes" in str(found.report_)


def test_what_is_wrong_is_found_in_the_mode_of_its_number_and_blamed():
    found = identified(["T'[1] = 3"])
    np.testing.assert_array_equal(found.coef_[:, 0, 0], 3.0)
    [check] = found.known_
    assert check.questioned and check.value == pytest.approx(1.0, abs=5.0 * check.error)
    cooling = int(found.coef_[:, 0, 1].argmin())  # pulled most by a constant that is too large
    assert check.name == f"T'[1] in mode {cooling}"
    assert found.report_.advice == (
        'What is known contradicts the recordings: leave out or correct "T\'[1] = 3".'
    )


def test_it_is_refused_before_anything_is_fitted():
    with pytest.raises(ValueError, match="the terms are 1, T"):
        identified("T' has no u")
    with pytest.raises(ValueError, match="known is held in continuous time"):
        identified("T' has no 1", discrete_time=True)
