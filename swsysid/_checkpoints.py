"""`checkpoint=` of an estimator: what its fit is a fit of, and the journal that it keeps.

Steps of other data, of other parameters or of another version are none of this fit. How many jobs
do it, and what is said meanwhile, does not matter.
"""

from __future__ import annotations

import hashlib
import os
import platform
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Protocol, TypeVar

import joblib
import numpy as np
import scipy
import sklearn
from sklearn.base import BaseEstimator

from swsysid._checks.parameters import shown
from swsysid._data.recordings import many_recordings
from swsysid._data.sources import Rows, holds_blocks, row_blocks
from swsysid._journal import handing_over, is_open, journal, offer
from swsysid._whole_or_nothing import whole_or_nothing

_WITHOUT_MEANING = {"n_jobs", "verbose", "checkpoint"}


class _Resumable(Protocol):
    checkpoint: str | os.PathLike[str] | None

    def get_params(self, deep: bool = True) -> dict[str, object]: ...


Fitted = TypeVar("Fitted", bound=_Resumable)


def checkpointed(fit: Callable[..., Fitted]) -> Callable[..., Fitted]:
    """A `fit` that goes on where one with the same checkpoint, data and parameters was stopped.

    It is done wholly or not at all. A fit within a fit has no checkpoint of its own: its steps are
    that one's.
    """
    return whole_or_nothing(fit, _kept)


@contextmanager
def _kept(self: _Resumable, *data: object, **options: object) -> Iterator[None]:
    """The journal of a fit, which holds the fitted estimator in the end."""
    folder = self.checkpoint
    if folder is None or is_open():
        yield
        return
    if not isinstance(folder, (str, os.PathLike)):
        raise TypeError(f"checkpoint={shown(folder)} must be None or the name of a folder.")
    work = {"estimator": type(self).__qualname__, **versions()}
    work |= {
        name: _of_value(value)
        for name, value in sorted(self.get_params().items())
        if name.split("__")[-1] not in _WITHOUT_MEANING
    }
    with journal(folder, work | {"data": _of_data(*data, **options)}):
        yield
        with handing_over(lambda found: found):
            offer(self)


def versions() -> Mapping[str, str]:
    """Of what answers depend on; of the package, its very text."""
    of_others = {"numpy": np.__version__, "scipy": scipy.__version__}
    of_others |= {"scikit-learn": sklearn.__version__, "Python": platform.python_version()}
    return {"swsysid": _own_text()} | of_others


@cache
def _own_text() -> str:
    package = Path(__file__).parent
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        digest.update(path.relative_to(package).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()


def digest(value: object) -> str:
    """What tells a value from others, in any process."""
    try:
        return str(joblib.hash(value))
    except Exception:  # of a lambda, or of what only cloudpickle can write
        import cloudpickle

        return hashlib.sha256(cloudpickle.dumps(value)).hexdigest()


def _of_value(value: object) -> str:
    # parameters of an estimator among them are there by themselves
    return type(value).__qualname__ if isinstance(value, BaseEstimator) else digest(value)


def _of_data(x: object, y: object = None, sample_weight: object = None, *more: object,
             **options: object) -> str:  # fmt: skip
    """Blocks of rows and recordings that are read where they are, there and one by one."""
    many = many_recordings(x)
    if many is not None:
        return digest(many.map(_of_recording))
    if not holds_blocks(x):
        return digest((x, y, sample_weight, more, options))
    y, sample_weight = options.get("y", y), options.get("sample_weight", sample_weight)
    blocks = row_blocks(x, y, sample_weight, options.get("groups"))
    return digest(list(blocks.map(_of_rows)))


def _of_recording(number: int, recording: object) -> str:
    return digest(recording)


def _of_rows(rows: Rows) -> str:
    return digest((rows.X, rows.targets, rows.weight, rows.groups))
