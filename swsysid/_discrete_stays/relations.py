r"""Modes that one law of long memory joins: their stays obey different laws of shorter memory.

A law sees :math:`x_k - x_{k - 1}` with its lags. Of a state that goes up by the same amount in one
mode, and down by it in another, :math:`x_{k + 1} = 2 x_k - x_{k - 1}` is the law of both: the lag
remembers the mode. In each of them the lagged columns obey a *relation*,
:math:`x_k - x_{k - 1} = \pm h`, which lets a law of shorter memory tell its rows; rows of both obey
none. So stays are parted by the relations that they obey together. By rows alone the one law is
cheaper; which description is right, free rollouts say.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swsysid._discrete_stays.data import DiscreteData
from swsysid._discrete_stays.rows import DEPENDENT, RowFit, alternate, law_of
from swsysid._results import Array


def parted_by_relations(data: DiscreteData, fit: RowFit, most: int) -> RowFit | None:
    """Modes parted by what relates the rows of their stays; None where that parts none.

    Modes that are left after as few rows as a law looks back are those of rows across a switch.
    What inputs are in some recordings is no relation of a law.
    """
    problem, modes, laws = data.problem, fit.lawful, []
    begins = problem.begins | np.append(True, np.diff(modes) != 0)
    number, length = np.cumsum(begins), np.diff(np.append(np.flatnonzero(begins), len(modes)))
    lasting = (length > data.rows.lags + 1)[number - 1] & (modes >= 0)
    of_states = problem.features[:, ~data.sees_inputs]
    for mode in np.unique(modes[lasting]):
        left = np.flatnonzero((modes == mode) & lasting)
        while len(left) > problem.features.shape[1]:
            some = _related(of_states[left], number[left])
            laws.append(law_of(problem, np.isin(np.arange(len(modes)), left[some])))
            left = left[~some]
    if not len(np.unique(modes[lasting])) < len(laws) <= most:
        return None
    return alternate(problem, np.array(laws))


def _related(features: Array, stays: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Rows of stays that obey all relations of the longest one."""
    kept = np.zeros(len(features), dtype=bool)
    names, lengths = np.unique(stays, return_counts=True)
    triangle, rank = np.zeros((0, features.shape[1])), -1
    for name in names[np.argsort(-lengths, kind="stable")]:
        own = stays == name
        joined = _triangle(np.vstack([triangle, features[own]]))
        if rank < 0 or _rank(joined) == rank:
            triangle, rank, kept = joined, _rank(joined), kept | own
    return kept


def _triangle(rows: Array) -> Array:
    return np.asarray(np.linalg.qr(rows, mode="r"), dtype=float)


def _rank(triangle: Array) -> int:
    sizes = np.linalg.norm(triangle, axis=0)
    scaled = triangle / np.where(sizes > 0.0, sizes, 1.0)
    return int(np.count_nonzero(np.linalg.svd(scaled, compute_uv=False) > DEPENDENT))
