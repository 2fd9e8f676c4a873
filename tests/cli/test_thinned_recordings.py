"""Rows that several laws are asked of."""

import numpy as np
import pytest

from swsysid._cli.recorded import Recorded
from swsysid._stays.given import FEWEST_SAMPLES


def recorded(n_rows, n_groups=1, noise=0.0, limit=False):
    """Slow waves, n_rows of them in each of some trajectories."""
    t = np.tile(np.linspace(0.0, 20.0, n_rows), n_groups)
    x = np.sin(t) + noise * np.random.default_rng(0).standard_normal(len(t))
    if limit:
        x[5] = np.nan
    groups = np.repeat(np.arange(n_groups), n_rows)
    return Recorded(x[:, None], np.zeros((len(t), 0)), np.zeros((len(t), 0)), t, groups)


@pytest.mark.parametrize(
    ("given", "every"),
    [
        (recorded(8000), 4),  # to 2,000 rows
        (recorded(2000), 1),
        (recorded(8000, noise=0.1), 1),  # lines between rows lose a tenth of the spread
        (recorded(8000, limit=True), 1),
        (recorded(2 * FEWEST_SAMPLES, n_groups=500), 1),
    ],
)
def test_rows_on_lines_between_others_are_left_out(given, every):
    assert given.thinning == every


def test_every_trajectory_keeps_its_first_row():
    some = recorded(7, n_groups=2).every(3)
    assert some.groups.tolist() == [0, 0, 0, 1, 1, 1]
    assert some.t == pytest.approx(np.tile([0.0, 10.0, 20.0], 2))
