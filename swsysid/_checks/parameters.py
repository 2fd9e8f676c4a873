"""Parameters that make no sense, refused in one sentence that says what to give instead."""

from __future__ import annotations

import operator
import os
from collections.abc import Callable, Iterable, Sequence
from numbers import Integral, Real
from pathlib import Path
from typing import TypeGuard, TypeVar

import numpy as np

T = TypeVar("T")
# Days of work: a number beyond is a slip of the hand.
MOST_MODES, MOST_STARTS, MOST_RESAMPLES = 32, 10_000, 1_000_000
# Beyond it a square overflows, or nearly so.
_LARGEST = 1e150


def whole(
    name: str, value: object, least: int = 1, most: int | None = None, also: Sequence[T] = ()
) -> int | T:
    """A whole number within its limits, or one of the values allowed `also`.

    Examples
    --------
    >>> whole("n_init", 3)
    3
    >>> whole("n_init", 0, also=("auto",))
    Traceback (most recent call last):
        ...
    ValueError: n_init=0 must be a positive integer or 'auto'.
    """
    if _is_among(value, also):
        return value
    if not _is_whole(value) or value < least:
        wanted = "a positive integer" if least == 1 else f"an integer, at least {least}"
        raise ValueError(f"{name}={shown(value)} must be {wanted}{_or(also)}.")
    if most is not None and value > most:
        raise ValueError(f"{name}={shown(value)} is out of reach; it must be at most {most}.")
    return int(value)


_LIMITS: dict[str, tuple[Callable[[float, float], bool], str]] = {
    "above": (operator.gt, "above"),
    "least": (operator.ge, "at least"),
    "below": (operator.lt, "below"),
    "most": (operator.le, "at most"),
}


def real(name: str, value: object, also: Sequence[T] = (), **limits: float) -> float | T:
    """A finite number within its limits, or one of the values allowed `also`.

    `limits` are ``above``, ``least``, ``below`` and ``most``.

    Examples
    --------
    >>> real("significance", 0.05, above=0, below=1)
    0.05
    >>> real("significance", 2, above=0, below=1)
    Traceback (most recent call last):
        ...
    ValueError: significance=2 must be a number above 0 and below 1.
    """
    if _is_among(value, also):
        return value
    tests = [(_LIMITS[limit], bound) for limit, bound in limits.items()]
    if _is_real(value) and -_LARGEST <= value <= _LARGEST:
        if all(holds(value, bound) for (holds, _), bound in tests):
            return float(value)
    raise ValueError(f"{name}={shown(value)} must be {_described(limits)}{_or(also)}.")


def one_of(name: str, value: object, choices: Iterable[str]) -> str:
    """One of some names."""
    known = list(choices)
    if not isinstance(value, str) or value not in known:
        raise ValueError(f"{name}={shown(value)} is unknown; choose {_listed(known)}.")
    return value


def flag(name: str, value: object) -> bool:
    """True or False."""
    if not isinstance(value, (bool, np.bool_)):
        raise ValueError(f"{name}={shown(value)} must be True or False.")
    return bool(value)


def function(
    name: str, value: object, of: str, also: Sequence[T] = ()
) -> Callable[..., object] | T:
    """Something that can be called."""
    if callable(value) or _is_among(value, also):
        return value
    raise TypeError(f"{name}={shown(value)} must be a function of {of}{_or(also)}.")


def jobs(value: object) -> int | None:
    """Number of jobs as joblib counts them: None, or a whole number that is not zero."""
    if value is not None and (not _is_whole(value) or value == 0):
        raise ValueError(
            f"n_jobs={shown(value)} must be None or a whole number, -1 for all processors."
        )
    return None if value is None else int(value)


def verbosity(value: object) -> int:
    """How much is said: True, False, or a whole number from 0."""
    return int(value) if isinstance(value, (bool, np.bool_)) else whole("verbose", value, least=0)


def solver_name(value: object) -> str:
    """The name of a solver; whether it is installed is known where it is called."""
    if not isinstance(value, str) or not value:
        raise ValueError(
            f"solver={shown(value)} must be 'auto' or the name of a solver, such as 'clarabel'."
        )
    return value


def names_of_columns(name: str, value: object, n_columns: int | None = None) -> list[str]:
    """A list of texts, one for each column."""
    is_list = isinstance(value, Iterable) and not isinstance(value, (str, bytes))
    names = list(value) if isinstance(value, Iterable) else []
    if not is_list or not all(isinstance(one, str) for one in names):
        raise TypeError(f"{name}={shown(value)} must be a list of names, one for each column.")
    if n_columns is not None and len(names) != n_columns:
        raise ValueError(
            f"{name} has {len(names)} entries for {n_columns} columns of X; give one for each."
        )
    return names


def random_numbers(value: object) -> np.random.RandomState:
    """The source of random numbers that `random_state` stands for."""
    usable = value is None or isinstance(value, np.random.RandomState)
    if not usable and not (_is_whole(value) and 0 <= value < 2**32):
        raise ValueError(
            f"random_state={shown(value)} must be None, a whole number from 0 to 2^32 - 1, or a "
            "numpy.random.RandomState."
        )
    # a refusal of the command line checks words and numbers, and need not wait for this library
    from sklearn.utils import check_random_state

    return check_random_state(value)


def bytes_of(path: str | os.PathLike[str]) -> bytes:
    """What a file holds; where there is none, the usual exception with a sentence.

    Examples
    --------
    >>> bytes_of("nowhere.xml")
    Traceback (most recent call last):
        ...
    FileNotFoundError: There is no file nowhere.xml; check its name.
    """
    try:
        return Path(path).read_bytes()
    except FileNotFoundError as error:
        raise type(error)(f"There is no file {path}; check its name.") from None
    except IsADirectoryError as error:
        raise type(error)(f"{path} is a folder; name a file in it.") from None


def shown(value: object) -> str:
    """A value on one short line."""
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else f"{text[:57]}..."


def _is_whole(value: object) -> TypeGuard[int]:
    return isinstance(value, Integral) and not isinstance(value, (bool, np.bool_))


def _is_real(value: object) -> TypeGuard[float]:
    return isinstance(value, Real) and not isinstance(value, (bool, np.bool_))


def _is_among(value: object, also: Sequence[T]) -> TypeGuard[T]:
    """Told by identity or as text: an array compared with text is no truth value."""
    return any(
        value is other or (isinstance(value, str) and isinstance(other, str) and value == other)
        for other in also
    )


def _described(limits: dict[str, float]) -> str:
    if limits == {"above": 0}:
        return "a positive number"
    if limits == {"least": 0}:
        return "a non-negative number"
    words = " and ".join(f"{_LIMITS[limit][1]} {bound:g}" for limit, bound in limits.items())
    return f"a number {words or 'that is finite'}"


def _or(also: Sequence[object]) -> str:
    return "".join(f" or {other!r}" for other in also)


def _listed(known: Sequence[str]) -> str:
    names = [repr(name) for name in known]
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} or {names[-1]}"
