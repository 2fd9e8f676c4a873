"""What is done wholly or not at all: every `fit`, which also fails in words, and every file."""

from __future__ import annotations

import errno
import os
import secrets
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor
from contextlib import AbstractContextManager, contextmanager, nullcontext
from copy import copy
from functools import wraps
from pathlib import Path
from typing import ParamSpec, TypeVar

import numpy as np

from swsysid._results import SolverError

Estimator = TypeVar("Estimator")
Arguments = ParamSpec("Arguments")
Answer = TypeVar("Answer")


def whole_or_nothing(
    fit: Callable[..., Estimator],
    within: Callable[..., AbstractContextManager[None]] = lambda *data, **options: nullcontext(),
) -> Callable[..., Estimator]:
    """A `fit` that works on a copy, whose attributes the estimator takes over in one step.

    Interrupted or failed, it leaves the estimator as it was: not fitted, or fitted as before. It
    works `within` what is opened for the copy and the arguments.
    """

    @wraps(fit)
    def fitted(self: Estimator, *data: object, **options: object) -> Estimator:
        draft = copy(self)
        with failures_in_words(), within(draft, *data, **options):
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


@contextmanager
def written_beside(path: str | Path) -> Iterator[Path]:
    """A place beside `path` to write to; what is written moves to `path` at the end, in one step.

    After a full disk or an interruption the file that was at `path` is there as it was, and nothing
    else. A link is followed, permissions of a file that is replaced are kept, one that may not be
    written to stays, and what is no ordinary file, such as a pipe, is written to directly.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "notes.txt"
    >>> with written_beside(path) as draft:
    ...     _ = draft.write_text("all of it")
    >>> path.read_text(), len(list(path.parent.iterdir()))
    ('all of it', 1)
    """
    place = Path(os.path.realpath(path))
    if place.exists() and not place.is_file():
        yield place
        return
    if place.exists() and not os.access(place, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
    draft = place.with_name(f".swsysid-{secrets.token_hex(8)}{place.suffix}")
    try:
        yield draft
        _settle(draft, place)
    except OSError as error:
        if error.filename in (None, str(draft)):
            error.filename = str(path)
        raise
    finally:
        draft.unlink(missing_ok=True)


def write_text(path: str | Path, text: str) -> None:
    """Write a text in UTF-8, whole or not at all."""
    with written_beside(path) as draft:
        draft.write_text(text, encoding="utf-8")


def _settle(draft: Path, place: Path) -> None:
    """Move a file to its place when the disk has all of it."""
    with draft.open("r+b") as written:
        os.fsync(written.fileno())
    if place.exists():
        draft.chmod(place.stat().st_mode & 0o7777)
    os.replace(draft, place)
