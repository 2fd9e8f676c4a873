"""The rows of a fit, under one name from the first step to the last."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swsysid._checks.arrays import labels
from swsysid._data.rows import CanonicalRows, canonical_rows
from swsysid._data.sampling import Sample, draw_sample
from swsysid._data.sources import RowBlocks, Rows
from swsysid._identification.settings import IdentificationSettings

__all__ = ["TrainingRows", "trajectory_codes"]


@dataclass(frozen=True)
class TrainingRows:
    """All rows of a fit, and those of them that are in memory.

    Attributes
    ----------
    blocks : RowBlocks
        All rows, as they were given.
    sample : Sample
        All of them if they are not too many, else some.
    """

    blocks: RowBlocks
    sample: Sample

    @classmethod
    def of(cls, blocks: RowBlocks, settings: IdentificationSettings) -> TrainingRows:
        """The rows of blocks."""
        return cls(blocks, draw_sample(blocks, settings.sampled, settings.whole))

    @property
    def all_in_memory(self) -> bool:
        """True if the rows in memory are all rows."""
        return self.sample.is_everything

    @property
    def in_memory(self) -> Rows:
        """The rows in memory, in their own order."""
        return self.sample.rows

    @cached_property
    def distinct(self) -> CanonicalRows:
        """X, velocities and trajectory of the rows in memory, sorted, repetitions merged."""
        rows = self.in_memory
        codes = trajectory_codes(rows.groups, len(rows))
        return canonical_rows(rows.X, rows.targets, codes, sample_weight=rows.weight)


def trajectory_codes(groups: ArrayLike | None, n_samples: int) -> NDArray[np.intp]:
    """Trajectories numbered from 0; one trajectory if there are no groups."""
    if groups is None:
        return np.zeros(n_samples, dtype=np.intp)
    return np.unique(labels("groups", groups, n_samples), return_inverse=True)[1]
