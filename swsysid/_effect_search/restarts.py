"""Modes that were wrong because an effect was missing: they are sought anew with it inside.

Beside wrong modes a right effect explains little, and one that imitates what the modes get wrong
explains more. So not only the best candidate is fitted together with the modes, but every kind.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from joblib import Parallel, delayed
from tqdm import tqdm

from swsysid._effect_search.candidates import CandidateContext, Trial
from swsysid._effect_search.structures import SearchContext, Structure
from swsysid.effects import PlacedEffect


def is_large(beside: CandidateContext, best: Trial) -> bool:
    """Whether a candidate gains more than an effect must, be it significant or not."""
    # Beside wrong modes a right effect gains where they are right, in a few blocks of rows; beneath
    # a slow force a regression is in doubt of everything.
    least = beside.data.settings.gain_a_row * len(beside.data.rows)
    return float(beside.gains([best]).sum()) > least


def with_modes(
    context: SearchContext,
    current: Structure,
    candidates: Sequence[PlacedEffect],
    n_jobs: int | None = None,
    verbose: int = 0,
) -> list[Structure]:
    """The first candidate with the present modes, and all of them with modes sought anew."""
    terms, settings, first = current.terms, context.settings, candidates[0]
    warm = context.structure((*terms, first), current.fit.modes)
    told = context.data.told
    unchanged = np.mean(warm.fit.modes == current.fit.modes)
    # Modes that are told may be wrong together with those of the declared model: few rows are left
    # in the stays, and one that is wrong decides between two kinds.
    if current.fit.n_modes == 1 or (told is None and unchanged >= settings.same_modes):
        return [warm]  # the modes were right without the effect
    restarts = [
        replace(candidate, mode=None, replaced=None)
        for candidate in candidates[: settings.n_restarts]
    ]
    anew = Parallel(n_jobs=n_jobs)(
        delayed(context.structure)((*terms, candidate), told, 1)
        for candidate in tqdm(restarts, desc="modes anew", leave=False, disable=not verbose)
    )
    return [warm, *anew]
