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
    for known, message, options in (
        ("T' has no T", r"the terms are 1, T\[k\]", {}),
        ("energy T^2 never rises", "known of velocities", {}),
        ("T' has no 1", "needs the number of lags.* give lags=1", {"lags": "auto"}),
    ):
        with pytest.raises(ValueError, match=message):
            identified(known, discrete_time=True, **options)


def sampled(known, noise=0.02, inputs=None):
    """A heater and its wall, three recordings of maps; seconds make no difference."""
    rng, given = np.random.default_rng(0), []
    for _ in range(3):
        x, heats, rows = np.array([rng.uniform(17, 21), rng.uniform(15, 18)]), True, []
        for _ in range(120):
            rows.append(x)
            heats = x[0] < 22.0 if heats else x[0] < 18.0
            x = MAP @ x + [1.0 if heats else 0.1, -0.1]
        noisy = np.array(rows) + noise * rng.standard_normal((120, 2))
        given.append(pd.DataFrame(noisy, columns=["T", "W"]))
    regressor = HybridAutomatonRegressor(2, discrete_time=True, random_state=0, known=known)
    return regressor.fit(given, [np.arange(120)] * 3, inputs=inputs)


MAP = np.array([[0.9, 0.08], [0.05, 0.95]])
TRUTH = np.array([[[1.0, 0.9, 0.08], [-0.1, 0.05, 0.95]], [[0.1, 0.9, 0.08], [-0.1, 0.05, 0.95]]])
TIES = ["W' same in all modes", "T'[T[k]] same in all modes", "T'[W[k]] = 0.08"]


def test_maps_are_held_to_it_and_closer_to_the_truth():
    free, found = sampled(None), sampled(TIES)
    coef = found.coef_
    np.testing.assert_allclose(coef[0, 1], coef[1, 1], atol=1e-9)
    assert coef[0, 0, 1] == pytest.approx(coef[1, 0, 1], abs=1e-9)
    np.testing.assert_allclose(coef[:, 0, 2], 0.08, atol=1e-12)
    off = [np.abs(one.coef_ - TRUTH) for one in (found, free)]
    assert (off[0] <= 4.0 * found.coef_errors_ + 1e-9).all()  # four standard errors
    assert (found.coef_errors_ <= 1.01 * free.coef_errors_).all()
    np.testing.assert_allclose(found.coef_errors_[:, 0, 2], 0.0, atol=1e-12)
    assert off[0].max() < off[1].max() / 2.0  # 2.1e-2 without


@pytest.mark.nightly
def test_maps_are_asked_and_say_what_an_identification_without_would():
    assert not any(check.questioned for check in sampled(TIES).known_)
    found, free = sampled([*TIES[:1], "T'[W[k]] = 0.09"]), sampled(TIES[:1])
    tied, wrong = found.known_
    assert not tied.questioned and wrong.questioned and wrong.p_value < 1e-20
    mode = int(wrong.name.removeprefix("T'[W[k]] in mode "))
    value, error = free.coef_[mode, 0, 2], free.coef_errors_[mode, 0, 2]
    assert abs(wrong.value - value) < 0.5 * error  # a step of Gauss and Newton from elsewhere
    assert wrong.error == pytest.approx(error, rel=0.3)
    assert "leave out or correct" in found.report_.advice


def test_what_is_known_beside_it_makes_an_error_smaller():
    """That of what is asked is the error of an identification with all else that is known."""
    known = "T'[T[k]] = 0.9"
    wrong = sampled([known, "T'[W[k]] = 0.09"]).known_[1]
    errors = [sampled(one).coef_errors_[0, 0, 2] for one in (known, None)]
    assert wrong.name == "T'[W[k]] in mode 0"
    assert wrong.error == pytest.approx(errors[0], rel=1e-2) and errors[0] < 0.97 * errors[1]


@pytest.mark.nightly
def test_a_bound_of_maps_holds_and_what_was_found_changes_nothing():
    free = sampled(None)
    value = float(free.coef_[0, 0, 1])
    same = sampled([f"T'[T[k]] <= {value + 1.0}", "W'[T[k]] >= -1"])
    np.testing.assert_allclose(same.coef_, free.coef_, atol=1e-6)  # to which a descent goes
    bounded = sampled("T'[1] >= 0.2")
    assert bounded.coef_[:, 0, 0].min() == pytest.approx(0.2, abs=1e-9)


def test_what_is_known_may_stand_beside_what_nothing_tells():
    """An input that never changes is a constant: of the two only the sum is told."""
    steady = pd.DataFrame({"u": np.full(120, 2.0)})
    found = sampled(["W'[T[k]] = 0.05"], inputs=[steady] * 3)
    [check] = found.known_
    assert not check.questioned
    constant, of_heater, of_wall, of_input = np.moveaxis(found.coef_errors_, 2, 0)
    assert np.isinf([constant, of_input]).all()
    assert np.isfinite([of_heater, of_wall]).all() and (of_heater[:, 1] == 0.0).all()


@pytest.mark.filterwarnings("ignore::swsysid.MisfitWarning")
@pytest.mark.parametrize("wrong", ["W' = 2 T[k]", "W' = 0"])
def test_a_whole_law_that_is_wrong_is_questioned_without_noise(wrong):
    [check] = sampled([wrong], noise=0.0).known_
    assert check.questioned and check.p_value < 1e-20


def test_maps_without_noise():
    found = sampled(["W' same in all modes", "T'[1] >= 0.2"], noise=0.0)
    assert found.coef_[:, 0, 0].min() == pytest.approx(0.2, abs=1e-9)
    np.testing.assert_allclose(found.coef_[:, 1], TRUTH[:, 1], atol=1e-6)
    same, bound = found.known_
    assert not same.questioned and bound.questioned
    assert bound.value == pytest.approx(0.1, abs=1e-6)


@pytest.mark.parametrize(("level", "questioned"), [(0.2, False), (0.3, True)])
def test_maps_without_noise_contradict_what_is_false_and_nothing_else(level, questioned):
    """Rounding is all that is left."""
    x = np.array([np.linalg.matrix_power([[0.9, 0.2], [-0.2, 0.8]], k)[:, 0] for k in range(60)])
    known = f"x0[k+1][x1[k]] = {level}"
    found = HybridAutomatonRegressor(1, discrete_time=True, known=known, random_state=0)
    (check,) = found.fit([{"t": np.arange(60.0), "x": x}]).report_.known
    assert check.questioned == questioned and check.value == pytest.approx(0.2, rel=1e-9)
