"""The last answers to questions that come back, about objects that never change."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

Answer = TypeVar("Answer")


class Remembered(Generic[Answer]):
    """So many answers at most, each with the object that it is about; the oldest are forgotten."""

    def __init__(self, most: int):
        self._most = most
        # An object that is kept keeps its identity, unless it comes from another process.
        self._answers: dict[tuple[Hashable, ...], tuple[object, Answer]] = {}

    def of(
        self, about: object, question: tuple[Hashable, ...], answer: Callable[[], Answer]
    ) -> Answer:
        """The answer to a question about this very object, worked out if it is not known."""
        key = (id(about), *question)
        if key not in self._answers or self._answers[key][0] is not about:
            self._answers[key] = about, answer()
            while len(self._answers) > self._most:
                del self._answers[next(iter(self._answers))]
        return self._answers[key][1]
