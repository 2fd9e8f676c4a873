"""What a fit leaves behind: the answer, carried to the rows that the user gave."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from numpy.typing import NDArray
from sklearn.base import clone

from swsysid._data.features import FeatureMap
from swsysid._identification.identify import Identification
from swsysid._identification.rows import TrainingRows
from swsysid._results import Array, IterationRecord
from swsysid._surfaces.surface import fit_weighted

__all__ = ["Answer", "answer_of_all"]


@dataclass(frozen=True)
class Answer:
    """The answer for all rows.

    Attributes
    ----------
    found : Identification
        Its problem, and the modes of its best alternation, are of the rows it was found on.
    surface : fitted classifier
    modes : ndarray of shape (n_samples,), int
    membership : ndarray of shape (n_samples, n_modes), or None
        None if it is one-hot.
    objective : float
        Weighted sum of the losses, in the user's units.
    history : list of IterationRecord
    stalled : bool
        True if passes over all rows could not improve the answer of a sample.
    """

    found: Identification
    surface: Any
    modes: NDArray
    membership: Array | None
    objective: float
    history: list[IterationRecord]
    stalled: bool = False


def answer_of_all(rows: TrainingRows, found: Identification, feature_map: FeatureMap) -> Answer:
    """The answer of rows that were all identified: modes, and the surface fitted to them.

    Rows of weight zero took no part; they get the mode that fits them best.
    """
    best, problem, given, distinct = found.best, found.problem, rows.in_memory, rows.distinct
    modes = distinct.restore(best.modes)
    surface = fit_weighted(clone(problem.surface), given.X, modes, given.weight)
    membership = distinct.restore(best.membership)
    dropped = distinct.inverse < 0
    if dropped.any():
        some = given.take(dropped)
        rest = problem.on_rows(feature_map(some.X), some.targets, some.X)
        penalty = rest.penalty(surface) if rest.coupling else None
        membership[dropped] = rest.assign(best.coef, penalty).membership
    return Answer(
        found,
        surface,
        membership.argmax(axis=1),
        membership,
        problem.hard_loss(best.coef, best.modes),
        [replace(record, modes=distinct.restore(record.modes, -1)) for record in best.history],
    )
