"""Numbers with their standard errors, as many digits as the errors leave."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from swsysid._rendering.printing import linear_combination

_MOST_KNOWN = 9  # digits; a number that is known to more of them counts as exact
_MOST_DIGITS = 6  # that are shown of it then


def with_error(value: float, error: float, *, signed: bool = False, precision: int = 3) -> str:
    """A number with its standard error in brackets, which has one digit.

    The number has a digit more. One that is known to more than nine digits stands alone, one that
    is fixed (an error of zero) has `precision` decimals, and one of infinite error says so.

    Examples
    --------
    >>> with_error(0.02541, 0.0002), with_error(22.0, 1e-9), with_error(1.3, np.inf)
    ('0.02541 (0.0002)', '22', '1.3 (not determined)')
    >>> with_error(123456.7, 30.0), with_error(-3.21e-7, 4e-9, signed=True)
    ('123457 (30)', '-3.210e-7 (4e-9)')
    """
    sign = "+" if signed else ""
    if np.isnan(error) or np.isinf(error):
        return f"{value:{sign}.{precision}g} (not determined)"
    if error == 0.0:
        text = linear_combination([float(value)], ["1"], precision=precision)
        return f"+{text}" if signed and not text.startswith("-") else text
    decimals = int(np.ceil(-np.log10(error))) + 1
    digits = decimals + int(np.floor(np.log10(abs(value)))) + 1 if value else decimals
    if value and digits > _MOST_KNOWN:
        return _plain(f"{value:{sign}.{_MOST_DIGITS}g}")
    shown = f"{value:{sign}.{min(max(decimals, 0), 12)}f}"
    if value and not 1e-4 <= abs(value) < 1e7:
        shown = f"{value:{sign}.{min(max(digits - 1, 0), 12)}e}"
    shown = shown if value else "0"
    rounded = f"{float(f'{error:.1g}'):g}"
    return f"{_plain(shown)} ({_plain(rounded)})"


def _plain(text: str) -> str:
    """A number whose power of ten is written without zeros."""
    mantissa, _, exponent = text.partition("e")
    return f"{mantissa}e{int(exponent)}" if exponent else text


def between(low: float, high: float) -> str:
    """An interval, both ends with two digits of its width; "" if these are beyond the sixth.

    Examples
    --------
    >>> between(1.48352, 1.51017), between(2.0, 2.0 + 1e-9)
    ('1.484 to 1.510', '')
    """
    width, size = high - low, max(abs(low), abs(high))
    if not width > 10.0**-_MOST_DIGITS * size:
        return ""
    decimals = int(np.clip(np.ceil(-np.log10(width)) + 1, 0, 12))
    return f"{low:.{decimals}f} to {high:.{decimals}f}"


def sum_with_errors(
    values: Sequence[float], errors: Sequence[float], names: Sequence[str], precision: int = 3
) -> str:
    """The sum of named terms, each coefficient with its standard error; zeros are left out.

    Examples
    --------
    >>> sum_with_errors([2.0, -0.5, 0.0], [0.1, 0.0, 0.0], ["1", "x", "v"])
    '-0.500 x +2.00 (0.1)'
    """
    every = list(zip(values, errors, names, strict=True))
    exact = [(float(value), name) for value, error, name in every if error == 0.0]
    parts = [
        with_error(value, error, signed=True, precision=precision)
        + (f" {name}" if name != "1" else "")
        for value, error, name in every
        if error != 0.0
    ]
    if any(value for value, _ in exact):
        fixed, of = zip(*exact, strict=True)
        parts.insert(0, linear_combination(fixed, of, precision=precision))
    return " ".join(parts) or "0"
