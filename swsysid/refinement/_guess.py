"""Where a refinement starts: the states of every sample as measured, or carried by the model."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array
from swsysid.refinement._rollout import rollout
from swsysid.refinement._segments import Segments
from swsysid.refinement._settings import SETTINGS, Settings
from swsysid.refinement._system import Maps, ParameterSets
from swsysid.refinement._trajectories import Record

__all__ = ["guessed_states"]


def guessed_states(
    maps: Maps,
    sets: ParameterSets,
    records: list[Record],
    starts: Array,
    measured: NDArray[np.intp],
    linear: bool,
    settings: Settings = SETTINGS,
) -> tuple[list[Array], Array]:
    """States of each record, (n_samples, n_states), and the bound of a state that has diverged.

    Parameters
    ----------
    maps, sets
        The given model.
    records : list of Record
    starts : ndarray of shape (n_records, n_states)
        Initial states as given; where they are NaN, measured states start as measured and others
        at 0.
    measured : ndarray of int
        States that the channels of the records are.
    linear : bool
        Inputs are linear between samples, else held.
    """
    given = np.isfinite(starts)
    starts = np.where(given, starts, 0.0)
    largest = np.nanmax(np.abs(np.vstack([record.y for record in records])), axis=0)
    limit = np.maximum(np.abs(starts).max(axis=0), max(1.0, float(largest.max())))
    limit[measured] = np.maximum(largest[: len(measured)], np.abs(starts[:, measured]).max(axis=0))
    bound = settings.diverged * np.where(limit > 0.0, limit, 1.0)
    guess = []
    for record, start, known in zip(records, starts, given, strict=True):
        filled = record.filled[:, : len(measured)]
        start[measured] = np.where(known[measured], start[measured], filled[0])
        guess.append(_carried(maps, sets, record, start, measured, filled, linear, bound))
    return guess, bound


def _carried(maps, sets, record, start, measured, filled, linear, bound) -> Array:
    """Hidden states by the given model, with the measured ones reset at every sample."""
    carried = np.tile(start, (len(record.t), 1))
    if len(measured) == maps.n_states:
        carried[1:, measured] = filled[1:]
        return carried
    length = len(record.t) - 1 if not len(measured) else 1
    pieces = Segments([record], length, linear=linear, substeps=1)
    for k, (first, count) in enumerate(zip(pieces.first, pieces.count, strict=True)):
        run, _ = rollout(maps, sets, pieces.part(k), carried[None, [first]], bound)
        carried[first : first + count + 1] = run[:, 0, 0]
        carried[first + count, measured] = filled[first + count]
    return carried
