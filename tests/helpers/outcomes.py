"""How a wrong call ends, and what is wrong with that."""

import re
import signal
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from pathlib import Path

import numpy as np
from bad_values import BAD, TEMPLATES
from public_calls import CALLS
from scipy.sparse import issparse
from sklearn.base import BaseEstimator
from sklearn.exceptions import ConvergenceWarning, NotFittedError

import swsysid
from swsysid import IdentificationWarning, SolverError

__all__ = ["TooLongError", "WORDS", "ending", "fault", "unusable", "usual_warnings", "within"]

PACKAGE = Path(swsysid.__file__).parent
DOCUMENTED = (ValueError, TypeError, SolverError, NotFittedError)
SECONDS = 30  # nothing here has work for more than one
# Quantities that are NaN or infinite where there is nothing to say.
UNKNOWN = {
    "guard_score_", "claimed", "observed", "data", "spectrum", "covariance", "r2",
    "coef_standard_errors", "in_space", "in_time", "value", "coef_errors_", "guard_errors_",
    "reset_errors_", "covariance_",
    "left", "left_of_each", "leaves",  # by rollouts that diverge
}  # fmt: skip
# No surface where all samples are the same.
INFINITE = {("surface_distance", "zeros"), ("surface_distance", "transposed")}
WORDS = re.compile(
    r"\b(give|must|choose|use|drop|leave|call|fill|name|sort|install|reduce|remove|needs?|fit|"
    r"at least|at most|between|cannot|expecting|reshape|pass|increase|declare)\b",
    re.IGNORECASE,
)


def fault(name: str, argument: str, number: int) -> str | None:
    """What is wrong with the way a wrong call ends, None if nothing is."""
    call, kind = CALLS[name], CALLS[name].kinds[argument]
    bad = BAD[kind.rstrip("?")][number]
    arguments = call.right()
    right = arguments.get(argument)
    value = bad.make(TEMPLATES.get(kind.rstrip("?")) if right is None else right)
    may_be_none = value is None and kind.endswith("?")
    return ending(
        lambda: call.run(**(arguments | {argument: value})),
        to_be_refused=bad.refused and not may_be_none,
        may_be_infinite=(name, bad.name) in INFINITE,
    )


def ending(run: Callable, *, to_be_refused=False, may_be_infinite=False) -> str | None:
    """What is wrong with the way a call without arguments ends, None if nothing is."""
    try:
        with within(SECONDS), usual_warnings():
            result = run()
    except TooLongError:
        return f"did not end within {SECONDS} s"
    except DOCUMENTED as error:
        return _fault_of(error)
    except BaseException as error:
        return f"{type(error).__name__} from below: {error}"
    if to_be_refused:
        return f"was answered: {str(result)[:80]!r}"
    part = None if may_be_infinite else next(unusable(result), None)
    return None if part is None else f"answered {part} not finite"


@contextmanager
def usual_warnings():
    """What is said of data that determine little may be said; other warnings are errors."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for spoken in (IdentificationWarning, ConvergenceWarning):
            warnings.simplefilter("ignore", spoken)
        yield


class TooLongError(BaseException):
    """A call took too long; nothing that the package catches."""


@contextmanager
def within(seconds: int):
    """Stop after some seconds of work."""

    def stop(*_):
        raise TooLongError

    # of this process where it works, ten times as many where it waits or others do
    timers = {signal.SIGPROF: signal.ITIMER_PROF, signal.SIGALRM: signal.ITIMER_REAL}
    before = {number: signal.signal(number, stop) for number in timers}
    signal.setitimer(signal.ITIMER_PROF, seconds)
    signal.setitimer(signal.ITIMER_REAL, 10.0 * seconds)
    try:
        yield
    finally:
        for number, timer in timers.items():
            signal.setitimer(timer, 0)
            signal.signal(number, before[number])


def _fault_of(error: Exception) -> str | None:
    text = str(error)
    raised = traceback.extract_tb(error.__traceback__)[-1].filename
    if not Path(raised).is_relative_to(PACKAGE):
        return f"{type(error).__name__} from below ({raised}): {text}"
    if not text.endswith(".") or not WORDS.search(text):
        return f"does not say what to do: {text}"
    return None


def unusable(result, name="the result") -> Iterator[str]:
    """Names of the parts of a result with numbers that are not finite."""
    if name in UNKNOWN or isinstance(result, type) or issparse(result):
        return
    if isinstance(result, (float, np.floating, np.ndarray)):
        array = np.asarray(result)
        if array.dtype.kind in "fc" and not np.isfinite(array).all():
            yield name
    elif isinstance(result, BaseEstimator):
        for part, value in vars(result).items():
            if part.endswith("_") and not part.startswith("_"):
                yield from unusable(value, part)
    elif is_dataclass(result):
        for part in fields(result):
            yield from unusable(getattr(result, part.name), part.name)
    elif isinstance(result, dict):
        for part, value in result.items():
            yield from unusable(value, str(part))
    elif isinstance(result, (list, tuple)):
        for value in result:
            yield from unusable(value, name)
