"""What a data set of this benchmark returns: rows of its tables, and the errors in them."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

# Published scores differ in how many samples at the begin of a test record they leave out.
LEFT_OUT = (0, 5, 50)


@dataclass(frozen=True)
class Run:
    """A free run of one model on one test record.

    Attributes
    ----------
    simulated, measured : ndarray
        In the unit of the table; a simulation that ended early is shorter.
    """

    simulated: np.ndarray
    measured: np.ndarray

    def error(self, left_out: int = 0) -> float:
        """Root mean square error without the first samples; infinite where the run ended early."""
        simulated, measured = np.ravel(self.simulated), np.ravel(self.measured)
        if len(simulated) < len(measured):
            return np.inf
        return float(np.sqrt(np.mean((simulated - measured)[left_out:] ** 2)))


@dataclass(frozen=True)
class FreeRun:
    """Errors of free runs of two models on the test records of a data set.

    Attributes
    ----------
    data : str
        Name of the data set and what is measured, with the unit.
    change : str
        What the second model has and the first one lacks.
    before, after : tuple of float
        Errors of the two models, one for each test record, as the data set's own split scores them.
    after_leaving_out : tuple of tuple of float
        Errors of the second model, one row for each of `LEFT_OUT`.
    linear, readable, best : tuple of float
        Published errors on the same records: of a linear model, the smallest of a model that one
        can read, and that of any method. Empty where there are none that are comparable.
    chosen : str
        What was chosen on the training record, and the errors there that decided; empty where
        nothing was.
    """

    data: str
    change: str
    before: tuple[float, ...]
    after: tuple[float, ...]
    after_leaving_out: tuple[tuple[float, ...], ...] = ()
    linear: tuple[float, ...] = ()
    readable: tuple[float, ...] = ()
    best: tuple[float, ...] = ()
    chosen: str = ""

    @classmethod
    def of_runs(
        cls,
        data: str,
        change: str,
        before: Sequence[Run],
        after: Sequence[Run],
        left_out: int = 0,
        **others,
    ) -> FreeRun:
        """The row of two models, scored without the first `left_out` samples."""
        return cls(
            data,
            change,
            tuple(run.error(left_out) for run in before),
            tuple(run.error(left_out) for run in after),
            tuple(tuple(run.error(n) for run in after) for n in LEFT_OUT),
            **others,
        )


@dataclass(frozen=True)
class Found:
    """What a search found, and the errors before and after it.

    Attributes
    ----------
    data : str
        Name of the data set and the target of the regression.
    found : str
        Kinds and places of the effects.
    before, after : float
        Errors on held-out rows, relative to the target's standard deviation.
    fits : float
        Time of the search in fits of the declared model.
    rungs : list of float
        Errors of the declared model and after each effect on the quarter that the search holds out.
    left : str
        What the report names of the structure that is left over there.
    """

    data: str
    found: str
    before: float
    after: float
    fits: float
    rungs: list[float] = field(default_factory=list)
    left: str = ""


@dataclass(frozen=True)
class ByDefault:
    """What a search by default settings says of a recording.

    Attributes
    ----------
    data, lacks, estimator : str
        Name of the set, what its README says that the declared law lacks, and what was called.
    found, verdict : str
        Kinds and places of the effects, or the modes; "right" where what has a name lacks,
        "partly" where the first one is, "wrong" where it is not, or "nothing"; "unsure" where the
        first line of the report gives no name.
    before, after : float
        Errors of the declared law and of that with the effects on what was held out.
    hand : str
        The same of the README's hand fits, on its own split.
    cpu_seconds : float
    """

    data: str
    lacks: str
    estimator: str
    found: str
    verdict: str
    before: float
    after: float
    hand: str
    cpu_seconds: float


def read(path: str) -> pd.DataFrame:
    """A file of the measured sets."""
    return pd.read_csv(Path(os.environ["SWSYSID_DATA"]) / path)


def published_errors(published, unit: str) -> dict[str, tuple[float, ...]]:
    """Published errors, as `FreeRun` takes them, from a data set's own."""
    errors, kinds = published[f"test_rmse_{unit}"], ("linear", "readable", "best")
    return {name: tuple(np.atleast_1d(errors[name]).tolist()) for name in kinds}
