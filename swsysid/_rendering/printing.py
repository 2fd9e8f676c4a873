"""Linear combinations of named features as text and LaTeX."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from swsysid._checks.parameters import one_of, whole

_MOST_DECIMALS = 50
# Functions in the terms of effects stand upright in LaTeX; the feature names of a library stay as
# the library gives them.
_FUNCTIONS = ("sign", "clip", "max", "play", "lag")
# A name with its primes and power, a blank, and the name after it.
_SIDE_BY_SIDE = re.compile(r"\b([^\W\d_]\w*)('*(?:\^\d+)?\)*) (?=([^\W\d_]\w*))")


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
    `sizes` says, 1 by default. With `brief` all have `precision` significant digits, trailing zeros
    and factors of one left out.

    Examples
    --------
    >>> linear_combination([1.0, -2.5, 0.0], ["1", "x", "x^2"])
    '1.000 - 2.500 x'
    >>> linear_combination([0.5], ["x0^2 x1"], style="latex")
    '0.500 x_{0}^{2} x_{1}'
    >>> linear_combination([1.0, -2.0, -1.0], ["1", "x", "v"], brief=True)
    '1 - 2 x - v'
    """
    check_format(style, precision)
    amounts = [
        abs(value * size)
        for value, size in zip(coef, [1.0] * len(coef) if sizes is None else sizes, strict=True)
    ]
    largest = max(amounts, default=0.0)
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
