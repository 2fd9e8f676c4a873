"""Long work that goes on where it was stopped: a journal of the answers of its steps.

A fit is a function of its data and its parameters, whatever the number of jobs. So nothing of its
state need be kept: it begins anew, and steps that were finished before are read, not done. A step
is a call of a function at one place of the work; its name and how many of that name came before it
say which. Steps within it are its own, and those of a finished one are done with.

A step makes something new of its arguments and changes none of them, but for a source of random
numbers, which is left as the function left it. What it answers is what was written, in the first
run too: arrays lie in memory as a file has them, so that a fit that goes on ends as the one that
never was stopped, to the last bit.
"""

from __future__ import annotations

import hashlib
import json
import os
import secrets
import shutil
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import partial, wraps
from pathlib import Path
from time import time
from types import FunctionType, MethodType
from typing import Generic, ParamSpec, TypeVar

import numpy as np

from swsysid._checks.parameters import random_numbers
from swsysid._whole_or_nothing import write_text

Arguments = ParamSpec("Arguments")
Answer = TypeVar("Answer")
_MANIFEST, _BEST = "checkpoint.json", "best"
_MAGIC = b"swsysid step 1\n"
_SEALED = 32  # bytes of a digest
_OTHERS_WRITE = 0o022


@dataclass(frozen=True)
class _Journal:
    """A folder with the answers of steps, and what they are steps of."""

    folder: Path
    seal: bytes  # of what the work is; every file is sealed by it and its own name

    def read(self, name: str) -> list:
        """What a file holds, in a list; none where there is no such file, or only a part of it."""
        try:
            content = self._path(name).read_bytes()
        except OSError:
            return []
        start = len(_MAGIC) + _SEALED
        if content[:start] != _MAGIC + self._sealed(name, content[start:]):
            _warn(f"{self._path(name)} is torn or another fit's: that step is done anew.")
            return []
        return [_loaded(content[start:])]

    def write(self, name: str, answer: Answer) -> Answer:
        """Keep an answer, whole or not at all; it comes back as it will be read."""
        content = _dumped(answer)
        path = self._path(name)
        # what a machine without power has not written to its disk does not bear the seal
        draft = path.with_name(f".{path.name}-{secrets.token_hex(4)}")
        try:
            # a machine that does not see the folder keeps nothing there
            if (self.folder / _MANIFEST).exists():
                path.parent.mkdir(parents=True, exist_ok=True)
                draft.write_bytes(_MAGIC + self._sealed(name, content) + content)
                os.replace(draft, path)
                shutil.rmtree(self.folder / name, ignore_errors=True)
        except OSError as error:
            draft.unlink(missing_ok=True)
            _warn(
                f"checkpoint {str(self.folder)!r} could not be written to ({error.strerror}): the "
                "fit goes on, and what it finds from here on is lost if it is stopped."
            )
        return _loaded(content)

    @property
    def state(self) -> str:
        """What there is, and how to go on."""
        steps = [one.stat().st_mtime for one in self.folder.rglob("*-*.step")]
        if not steps:
            return f"no step was finished yet; {str(self.folder)!r} holds nothing to go on from"
        best = f"; best_so_far({str(self.folder)!r}) is the best answer until now"
        return (
            f"{len(steps)} finished steps are in {str(self.folder)!r}, the last one "
            f"{max(0.0, time() - max(steps)):.0f} s old: the same call goes on from there"
            f"{best if self._path(_BEST).exists() else ''}"
        )

    def _path(self, name: str) -> Path:
        return self.folder / f"{name}.step"

    def _sealed(self, name: str, content: bytes) -> bytes:
        return hashlib.sha256(self.seal + name.encode() + content).digest()


@dataclass(frozen=True)
class _Place:
    """Where in the work we are: within a step, of which so many others have begun."""

    journal: _Journal
    name: str = ""
    begun: Counter[str] = field(default_factory=Counter)

    def next(self, name: str) -> str:
        """The name of the next step of a name."""
        self.begun[name] += 1
        return f"{self.name}{name}-{self.begun[name]}"


_PLACE: ContextVar[_Place | None] = ContextVar("place", default=None)
_HANDED_OVER: ContextVar[Callable[..., object] | None] = ContextVar("handed over", default=None)


@dataclass(frozen=True)
class _Step(Generic[Arguments, Answer]):
    """A function at its place in the work."""

    function: Callable[Arguments, Answer]
    journal: _Journal
    name: str

    def __call__(self, *args: Arguments.args, **options: Arguments.kwargs) -> Answer:
        given = [random_numbers(None), *args, *options.values()]
        sources = [one for one in given if isinstance(one, np.random.RandomState)]
        kept = self.journal.read(self.name)
        if not kept:
            before = _PLACE.set(_Place(self.journal, f"{self.name}/"))
            try:
                found = self.function(*args, **options)
            finally:
                _PLACE.reset(before)
            states = [one.get_state() for one in sources]
            kept = [self.journal.write(self.name, (found, states))]
        [(answer, states)] = kept
        for source, state in zip(sources, states, strict=True):
            source.set_state(state)
        return answer


def resumable(function: Callable[Arguments, Answer]) -> Callable[Arguments, Answer]:
    """A function that is done once, where a journal is open; the function itself elsewhere.

    It is the next step of its name from now on, also where a worker calls it.

    Examples
    --------
    >>> import tempfile
    >>> def slow(x):
    ...     print("working")
    ...     return x + 1
    >>> folder = tempfile.mkdtemp()
    >>> for _ in range(2):
    ...     with journal(folder, {"x": "2"}):
    ...         print(resumable(slow)(2))
    working
    3
    3
    """
    place = _PLACE.get()
    if place is None:
        return function
    return _Step(function, place.journal, place.next(_name_of(function)))


def step(function: Callable[Arguments, Answer]) -> Callable[Arguments, Answer]:
    """A function each call of which is a step, where a journal is open."""

    @wraps(function)
    def called(*args: Arguments.args, **options: Arguments.kwargs) -> Answer:
        return resumable(function)(*args, **options)

    return called


def is_open() -> bool:
    """Whether steps are kept."""
    return _PLACE.get() is not None


def offer(found: object) -> None:
    """Keep an answer as the best until now, in the way in which the work hands answers over."""
    place, handed_over = _PLACE.get(), _HANDED_OVER.get()
    if place is not None and handed_over is not None:
        answer = handed_over(found)
        if answer is not None:
            place.journal.write(_BEST, answer)


@contextmanager
def handing_over(way: Callable[..., object] | None) -> Iterator[None]:
    """Answers that are offered meanwhile are kept as this function gives them, unless as None.

    Those of a fit within a fit are no answers of that one. No function leaves it to the next fit.
    """
    is_next = way is None or _HANDED_OVER.get() is None
    before = _HANDED_OVER.set(way if is_next else _in_no_way)
    try:
        yield
    finally:
        _HANDED_OVER.reset(before)


@contextmanager
def journal(folder: str | os.PathLike[str], work: Mapping[str, str]) -> Iterator[None]:
    """Keep steps in a folder, which is made; `work` says of what, and another one's is refused."""
    place = Path(folder)
    told = json.dumps(dict(work), indent=1)
    try:
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        _refuse_others(place)
        _refuse_another(place, work)
        write_text(place / _MANIFEST, told)
    except OSError as error:
        raise ValueError(
            f"checkpoint {str(folder)!r} cannot be written ({error.strerror}); name a folder that "
            "can."
        ) from error
    opened = _Journal(place.resolve(), hashlib.sha256(told.encode()).digest())
    before = _PLACE.set(_Place(opened))
    try:
        # numpy's own source, where nobody gave one, is where it was when the work began
        step(_nothing)()
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"stopped: {opened.state}.") from None
    finally:
        _PLACE.reset(before)


def best_so_far(folder: str | os.PathLike[str]) -> object:
    """The best model that a fit with ``checkpoint=folder`` has found until now.

    Parameters
    ----------
    folder : str or path
        What the fit was given as `checkpoint`; it may be running, stopped or done.

    Returns
    -------
    estimator or HybridAutomaton
        Fitted: it predicts and simulates. The fit may still improve its coefficients.

    Raises
    ------
    ValueError
        If the folder is no checkpoint, others may write to it, or nothing was found yet.

    Examples
    --------
    >>> import tempfile
    >>> from swsysid import SwitchingSystemRegressor, best_so_far
    >>> from swsysid.datasets import make_damped_oscillator
    >>> data, folder = make_damped_oscillator(500, random_state=0), tempfile.mkdtemp()
    >>> model = SwitchingSystemRegressor(random_state=0, checkpoint=folder)
    >>> model = model.fit(data.X, data.Xdot)
    >>> bool((best_so_far(folder).coef_ == model.coef_).all())
    True
    """
    place = Path(folder)
    try:
        told = (place / _MANIFEST).read_bytes()
        _refuse_others(place)
    except OSError as error:
        raise ValueError(f"{str(folder)!r} is no checkpoint ({error.strerror}).") from error
    found = _Journal(place, hashlib.sha256(told).digest()).read(_BEST)
    if not found:
        raise ValueError(f"checkpoint {str(folder)!r} has no answer yet; let the fit go on.")
    return found[0]


def _nothing() -> None:
    return None


def _in_no_way(found: object) -> None:
    return None


def _name_of(function: Callable[..., object]) -> str:
    while isinstance(function, partial):
        function = function.func
    named = isinstance(function, (FunctionType, MethodType))
    return (function.__name__ if named else type(function).__name__).lstrip("_")


def _dumped(value: object) -> bytes:
    # functions of a user's own, as feature libraries have them, are written with their code
    import cloudpickle

    return bytes(cloudpickle.dumps(value, protocol=5))


def _loaded(content: bytes):
    import pickle

    return pickle.loads(content)


def _refuse_others(folder: Path) -> None:
    """Refuse a folder into which somebody else may have put what is no answer."""
    found = folder.stat()
    if os.name == "posix" and (found.st_uid != os.getuid() or found.st_mode & _OTHERS_WRITE):
        raise ValueError(
            f"checkpoint {str(folder)!r} may be written to by others, and reading it runs what is "
            "in it; name a folder of your own, or take their rights to write (chmod go-w)."
        )


def _refuse_another(folder: Path, work: Mapping[str, str]) -> None:
    """Refuse a folder with steps of other work, or with other files."""
    if not (folder / _MANIFEST).exists():
        if any(folder.iterdir()):
            raise ValueError(
                f"checkpoint {str(folder)!r} holds other files; name a new or an empty folder."
            )
        return
    try:
        known = json.loads((folder / _MANIFEST).read_text(encoding="utf-8"))
    except ValueError:
        known = {}
    if not isinstance(known, dict):
        known = {}
    others = [name for name in {**known, **work} if known.get(name) != work.get(name)]
    if others:
        raise ValueError(
            f"checkpoint {str(folder)!r} is of another fit ({', '.join(others[:4])} differ"
            f"{'s' if len(others) == 1 else ''}); name another folder, or delete this one to "
            "begin anew."
        )


def _warn(sentence: str) -> None:
    # no UserWarning: fits within fits say none of these
    warnings.warn(sentence, RuntimeWarning, stacklevel=2)
