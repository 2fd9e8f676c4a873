"""Numbers in plain text: formulas, standard errors, tables, counts.

Linear combinations of named features are text or LaTeX; a number has as many digits as its standard
error leaves.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from swsysid._checks.parameters import one_of, whole

_MOST_DECIMALS = 50
# Functions in the terms of effects stand upright in LaTeX; the feature names of a library stay as
# the library gives them.
_FUNCTIONS = ("sign", "clip", "max", "play", "lag")
# A name with its primes and power, a blank, and the name after it.
_SIDE_BY_SIDE = re.compile(r"\b([^\W\d_]\w*)('*(?:\^\d+)?\)*) (?=([^\W\d_]\w*))")
_MOST_KNOWN = 9  # digits; a number that is known to more of them counts as exact
_MOST_DIGITS = 6  # that are shown of it then
_SHOWN = 5  # rows that are named one by one


def check_format(style: str, precision: int = 0) -> None:
    """Refuse anything but ``"text"`` and ``"latex"``, and decimals that no number has."""
    one_of("format", style, ("text", "latex"))
    whole("precision", precision, least=0, most=_MOST_DECIMALS)


def linear_combination(
    coef: Sequence[float],
    names: Iterable[str],
    *,
    precision: int = 3,
    style: str = "text",
    sizes: Sequence[float] | None = None,
    brief: bool = False,
) -> str:
    """The sum of `coef` times `names`, without the terms that round to zero.

    `precision` counts the decimals of coefficients of order one; small ones keep as many
    significant digits, so that nothing but an exact or negligible zero disappears. Negligible
    is a term 1e-10 times smaller than the largest one, where every feature is as large as
    `sizes` says, 1 by default; one of unknown, infinite size is not. With `brief` all have
    `precision` significant digits, trailing zeros and factors of one left out.

    Examples
    --------
    >>> linear_combination([1.0, -2.5, 0.0], ["1", "x", "x^2"])
    '1.000 - 2.500 x'
    >>> linear_combination([0.5], ["x0^2 x1"], style="latex")
    '0.500 x_{0}^{2} x_{1}'
    >>> linear_combination([1.0, -2.0, -1.0], ["1", "x", "v"], brief=True)
    '1 - 2 x - v'
    >>> linear_combination([6e4, -8e-7], ["v", "force^5"], sizes=[0.2, np.inf], brief=True)
    '6e4 v - 8e-7 force^5'
    """
    check_format(style, precision)
    amounts = [
        abs(value * size) if value != 0.0 else 0.0
        for value, size in zip(coef, [1.0] * len(coef) if sizes is None else sizes, strict=True)
    ]
    largest = max(filter(np.isfinite, amounts), default=0.0)
    terms = [
        (value, name)
        for value, name, amount in zip(coef, names, amounts, strict=True)
        if amount > 1e-10 * largest and value != 0.0
    ]
    text = ""
    for value, name in terms:
        sign = ("-" if value < 0 else "") if not text else (" - " if value < 0 else " + ")
        number = _number(abs(value), precision, style, brief)
        factors = [number] if name == "1" else [number, symbol(name, style)]
        text += sign + " ".join(factors[1:] if brief and factors[0] == "1" != name else factors)
    return text or "0"


def merged(terms: Iterable[tuple[float, str, float]]) -> tuple[list[float], list[str], list[float]]:
    """Coefficients, names and sizes of terms, those of the same name added up.

    A name that begins with a minus sign gives it to its coefficient.

    Examples
    --------
    >>> merged([(2.0, "v", 1.0), (0.3, "-sign(v)", 1.0), (1.0, "v", 1.0)])
    ([3.0, -0.3], ['v', 'sign(v)'], [1.0, 1.0])
    """
    coef: dict[str, float] = {}
    sizes: dict[str, float] = {}
    for value, name, size in terms:
        positive = name.removeprefix("-")
        coef[positive] = coef.get(positive, 0.0) + (value if name == positive else -value)
        sizes[positive] = size
    return list(coef.values()), list(coef), list(sizes.values())


def symbol(name: str, style: str) -> str:
    """A feature name in the requested style.

    Examples
    --------
    >>> symbol("x12 v_a^3", "latex")
    'x_{12} v_{a}^{3}'
    >>> symbol("speed_m_per_s", "latex")
    'speed_{m/s}'
    """
    if style == "text":
        return name
    name = re.sub(r"[#$%&{}]", r"\\\g<0>", name)
    name = _SIDE_BY_SIDE.sub(_apart, name)
    name = re.sub(r"\^(\d+)", r"^{\1}", name)
    name = re.sub(rf"\b({'|'.join(_FUNCTIONS)})\(", r"\\operatorname{\1}(", name)
    return re.sub(r"(?<!\\)\b\w+", _subscripted, name)


def rate(name: str, style: str) -> str:
    r"""The rate of a state; in LaTeX a dot where it fits over the name.

    Examples
    --------
    >>> [rate(name, "latex") for name in ("x0", "q'", "speed_m_per_s")]
    ['\\dot{x}_{0}', "q''", '\\frac{d}{dt} speed_{m/s}']
    """
    if style == "text" or name.endswith("'"):
        return symbol(f"{name}'", style)
    whole = symbol(name, style)
    letter = re.fullmatch(r"([^\W\d])(_.*)?", whole)
    if letter is None:
        return rf"\frac{{d}}{{dt}} {whole}"
    return rf"\dot{{{letter[1]}}}{letter[2] or ''}"


def _apart(match: re.Match) -> str:
    """Two factors, with a thin space where one is a word whose letters would run together."""
    left, ending, right = match.groups()
    has_words = any(len(re.split(r"[\d_]", name)[0]) > 1 for name in (left, right))
    return f"{left}{ending} " + (r"\, " if has_words else "")


def _subscripted(match: re.Match) -> str:
    """A name with all that follows its letters as one subscript, units as a fraction."""
    head, *parts = [part for part in match[0].split("_") if part] or [r"\_"]
    number = re.fullmatch(r"([^\W\d]+)(\d+)", head)
    if number:
        head, parts = number[1], [number[2], *parts]
    inner = re.sub(r"/([^\W\d]+)(\d)\b", r"/\1^{\2}", ",".join(parts).replace(",per,", "/"))
    return f"{head}_{{{inner}}}" if inner else head


def _number(value: float, precision: int, style: str, brief: bool) -> str:
    smallest = 10.0 ** -max(precision - 1, 1)  # below it a fixed point would cost digits
    if brief:
        text = f"{value:.{max(precision, 1)}g}"
    elif smallest <= round(value, precision) < 1e5:
        text = f"{value:.{precision}f}"
    else:
        text = f"{value:.{precision}e}"
    mantissa, _, exponent = text.partition("e")
    if not exponent:
        return text
    if style == "latex":
        return rf"{mantissa} \cdot 10^{{{int(exponent)}}}"
    return f"{mantissa}e{int(exponent)}"


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


def determined(
    coef: NDArray[np.float64], errors: NDArray[np.float64], sizes: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Standard errors of laws, infinite for terms that the data do not determine.

    Coefficients and errors have the shape (n_modes, n_states, n_features); features reach the
    `sizes`. A term that may be as large as the largest of its state in any mode, and none, is not
    determined: that of an input that hardly changes in a mode, and of the constant beside it.
    """
    largest = np.abs(coef * sizes).max(axis=(0, 2))[:, None]
    possible = errors * np.maximum(sizes, np.finfo(float).tiny)
    unknown = (errors >= np.abs(coef)) & (possible >= largest) & (errors > 0.0)
    return np.where(unknown, np.inf, errors)


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


def text_table(columns: Iterable[tuple[str, str, Sequence[str]]], gap: str = " ") -> list[str]:
    """Lines of a table: its head, then one line for each entry of the columns.

    A column is its title, its side and least width, and its entries; without a width it is not
    filled up, as the last one.

    Examples
    --------
    >>> text_table([("state", "<6", ["x", "v"]), ("error", ">7", ["0.1", "2"])])
    ['state    error', 'x          0.1', 'v            2']
    """
    filled = []
    for title, style, entries in columns:
        cells = [title, *entries]
        width = max(int(style[1:]), *map(len, cells)) if style else 0
        filled.append([f"{cell:{style[:1]}{width or ''}}" for cell in cells])
    return [gap.join(line) for line in zip(*filled, strict=True)]


def number(value: float | None, style: str) -> str:
    """A number in a format, or a dash where there is none."""
    return "-" if value is None else format(value, style)


def counted(number: int, noun: str) -> str:
    """A number with its noun.

    Examples
    --------
    >>> counted(1, "row"), counted(12000, "row"), counted(2, "switch")
    ('1 row', '12,000 rows', '2 switches')
    """
    plural = "es" if noun.endswith("ch") else "s"
    return f"{number:,} {noun}{'' if number == 1 else plural}"


def ordinal(number: int) -> str:
    """A place in an order.

    Examples
    --------
    >>> ordinal(2), ordinal(11), ordinal(23)
    ('2nd', '11th', '23rd')
    """
    suffix = {1: "st", 2: "nd", 3: "rd"}.get(number % 10 if number % 100 not in (11, 12, 13) else 0)
    return f"{number}{suffix or 'th'}"


def rows_listed(rows: Iterable[int | str]) -> str:
    """The first few of some rows of a file, or of several.

    Examples
    --------
    >>> rows_listed([7]), rows_listed([3, 5]), rows_listed(range(2, 40))
    ('row 7', 'rows 3, 5', 'rows 2, 3, 4, 5, 6 and 33 more')
    """
    numbers = list(rows)
    named = ", ".join(map(str, numbers[:_SHOWN]))
    rest = f" and {len(numbers) - _SHOWN:,} more" if len(numbers) > _SHOWN else ""
    return f"row{'' if len(numbers) == 1 else 's'} {named}{rest}"
