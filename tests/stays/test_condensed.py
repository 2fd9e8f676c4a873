"""What many recordings say of shared coefficients is the sum of what each says."""

import numpy as np
import pytest

from swsysid._stays.condensed import Condensed, Shared, Total
from swsysid._stays.laws import Laws


def part(seed, n_switches):
    """What one recording might say: three coefficients, the last of which it does not know."""
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((5, 3)) * [1.0, 2.0, 0.0]
    return Condensed(
        value=rng.uniform(), matrix=root.T @ root, vector=root.T @ rng.standard_normal(5),
        squares=np.array([4.0, 9.0, 0.0]), counts=np.array([50, 40, 0]),
        modes=np.zeros(50, dtype=np.intp), switch_times=np.zeros(n_switches),
    )  # fmt: skip


LAWS = Laws(np.zeros((1, 3, 1)), lambda X: X[:, :1], np.ones(3), np.ones((1, 3, 1), dtype=bool))
TOTAL = Total(
    Shared(LAWS, None, np.array([7.0, 8.0, 9.0]), None, (), 1, None), [part(0, 4), part(1, 2)]
)


@pytest.mark.parametrize("damping", [0.0, 0.5])
def test_a_step_and_what_it_promises_are_those_of_the_sum(damping):
    matrix, vector = (
        sum(getattr(one, name) for one in TOTAL.parts) for name in ("matrix", "vector")
    )
    step, promised = TOTAL.step(damping)
    known = np.linalg.solve(
        matrix[:2, :2] + damping * np.diag(np.diag(matrix)[:2]), vector[:2]
    )  # what nobody tells stays where it is
    np.testing.assert_allclose(step, [*known, 0.0], rtol=1e-12, atol=1e-14)
    assert promised == pytest.approx(vector @ step - 0.5 * step @ matrix @ step, rel=1e-12)
    assert TOTAL.value == TOTAL.parts[0].value + TOTAL.parts[1].value


def test_noise_is_what_is_left_for_each_number_that_is_not_used_up():
    # 180 values, less six switches, three states where each of two begins, three coefficients
    freedom = 1.0 - 15.0 / 180.0
    expected = [np.sqrt(8.0 / 100.0 / freedom), np.sqrt(18.0 / 80.0 / freedom), 9.0]
    np.testing.assert_allclose(TOTAL.noise, expected)


def test_coefficients_move_by_a_step_and_nothing_else_does():
    moved = TOTAL.shared.moved(np.array([1.0, 2.0, 3.0]))
    assert moved.laws.coef.ravel().tolist() == [1.0, 2.0, 3.0] and not LAWS.coef.any()
