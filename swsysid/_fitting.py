"""What every `fit` promises: it changes its estimator wholly or not at all, and fails in words."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager
from copy import copy
from functools import wraps
from typing import ParamSpec, TypeVar

import numpy as np

from swsysid._results import SolverError

Estimator = TypeVar("Estimator")
Arguments = ParamSpec("Arguments")
Answer = TypeVar("Answer")


def whole_or_nothing(fit: Callable[..., Estimator]) -> Callable[..., Estimator]:
    """A `fit` that works on a copy, whose attributes the estimator takes over in one step.

    Interrupted or failed, it leaves the estimator as it was: not fitted, or fitted as before.
    """

    @wraps(fit)
    def fitted(self: Estimator, *data: object, **options: object) -> Estimator:
        draft = copy(self)
        with failures_in_words():
            fit(draft, *data, **options)
        self.__dict__ = vars(draft)
        return self

    return fitted


def failing_in_words(function: Callable[Arguments, Answer]) -> Callable[Arguments, Answer]:
    """A function whose failures from below are told in one sentence."""

    @wraps(function)
    def called(*args: Arguments.args, **options: Arguments.kwargs) -> Answer:
        with failures_in_words():
            return function(*args, **options)

    return called


@contextmanager
def failures_in_words() -> Iterator[None]:
    """Linear algebra that fails and workers that are killed, as a `SolverError` that advises."""
    try:
        yield
    except np.linalg.LinAlgError as error:
        raise SolverError(
            f"linear algebra failed on these data ({str(error).rstrip('.')}); give columns in "
            "units in which they are of order one, and leave out columns that others determine."
        ) from error
    except BrokenExecutor as error:
        raise SolverError(
            "a worker process ended before its work was done, most often for want of memory; give "
            "a smaller n_jobs (1 uses no workers), or fewer rows."
        ) from error
