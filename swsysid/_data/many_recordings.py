"""Recordings that are read where they are worked on: of a Dask bag, delayed, or of functions."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, TypeGuard, TypeVar

import numpy as np
from joblib import Parallel
from joblib import delayed as later

from swsysid._journal import resumable, step
from swsysid._results import Trajectory

Answer = TypeVar("Answer")


@dataclass(frozen=True)
class ManyRecordings:
    """Parts of one or more recordings each, and the map over all recordings."""

    parts: Sequence[object]  # what Dask has delayed, or functions that read
    of_dask: bool
    n_jobs: int | None = None

    @step
    def map(self, function: Callable[[int, object], Answer]) -> list[Answer]:
        """`function` of the number of each recording and itself, in their order.

        An answer must not depend on another recording: it may be computed anywhere, and again if
        a machine is lost.
        """
        return self._mapped(function, [0, *np.cumsum(self.counts)[:-1].tolist()])

    @cached_property
    def counts(self) -> list[int]:
        """Recordings of each part."""
        return [len(one) for one in self._by_part(_nothing, [0] * len(self.parts))]

    def some(self, most: int, length: Callable[[int, object], int]) -> list[object]:
        """Recordings spread evenly over all, of about so many samples, one at least.

        `length` is asked of every one.
        """
        lengths = self.map(length)
        if not lengths:
            raise ValueError("x holds no recording; give one at least.")
        every = max(1, round(sum(lengths) / most))
        return [one for one in self.map(_Every(every)) if one is not None]

    def _mapped(self, function: Callable[[int, object], Answer], firsts: list[int]) -> list[Answer]:
        return [answer for part in self._by_part(function, firsts) for answer in part]

    def _by_part(
        self, function: Callable[[int, object], Answer], firsts: list[int]
    ) -> list[list[Answer]]:
        pairs = zip(firsts, self.parts, strict=True)
        if not self.of_dask:
            calls = [later(resumable(_on_part))(function, first, part) for first, part in pairs]
            return list(Parallel(n_jobs=self.n_jobs)(calls))
        from dask import compute, delayed

        # the function is one node of the graph: every worker gets it once
        function = delayed(function, pure=False)
        steps = [delayed(resumable(_on_part), pure=False) for _ in self.parts]
        tasks = [one(function, *pair) for one, pair in zip(steps, pairs, strict=True)]
        return list(compute(*tasks))


def many_recordings(x: object, n_jobs: int | None = None) -> ManyRecordings | None:
    """A Dask bag of recordings, or a list of delayed ones or of functions that read; else None."""
    if _is_bag(x):
        return ManyRecordings(x.to_delayed(), of_dask=True)
    if not isinstance(x, (list, tuple)) or not x:
        return None
    delayed = _of_dask("dask.delayed", "Delayed")
    if all(isinstance(one, delayed) for one in x):
        return ManyRecordings(x, of_dask=True)
    return ManyRecordings(x, False, n_jobs) if all(map(callable, x)) else None


class _Bag(Protocol):
    def to_delayed(self) -> list: ...


def _is_bag(x: object) -> TypeGuard[_Bag]:
    return isinstance(x, _of_dask("dask.bag", "Bag"))


def _of_dask(module: str, name: str) -> type | tuple[()]:
    """A class of Dask; none where nobody has imported it, who then has nothing of it."""
    return vars(sys.modules[module])[name] if module in sys.modules else ()


def _on_part(function: Callable[[int, object], Answer], first: int, part: object) -> list[Answer]:
    listed = part() if callable(part) else part
    if isinstance(listed, (Mapping, Trajectory)) or not isinstance(listed, Iterable):
        listed = [listed]
    answers = []
    for number, recording in enumerate(listed, first):
        try:
            answers.append(function(number, recording))
        except ValueError as error:
            # where it is read by itself it is number 0
            told, name = str(error), f"recording {number}"
            told = told.replace("recording 0", name) if "recording 0" in told else f"{name}: {told}"
            raise ValueError(told) from error
    return answers


def _nothing(number: int, recording: object) -> None:
    return None


@dataclass(frozen=True)
class _Every:
    """Every so many recordings, and nothing of the others."""

    every: int

    def __call__(self, number: int, recording: Answer) -> Answer | None:
        return recording if number % self.every == 0 else None
