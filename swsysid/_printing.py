"""Linear combinations of named features as text and LaTeX."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from swsysid._validation.parameters import one_of, whole

__all__ = ["check_format", "linear_combination", "merged", "symbol"]

_MOST_DECIMALS = 50
# Functions in the terms of effects stand upright in LaTeX; the feature names of a library stay as
# the library gives them.
_FUNCTIONS = ("sign", "clip", "max", "play", "lag")


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
) -> str:
    """The sum of `coef` times `names`, without the terms that round to zero.

    `precision` counts the decimals of coefficients of order one; small ones keep as many
    significant digits, so that nothing but an exact or negligible zero disappears. Negligible
    is a term 1e-10 times smaller than the largest one, where every feature is as large as
    `sizes` says, 1 by default.

    Examples
    --------
    >>> linear_combination([1.0, -2.5, 0.0], ["1", "x", "x^2"])
    '1.000 - 2.500 x'
    >>> linear_combination([0.5], ["x0^2 x1"], style="latex")
    '0.500 x_{0}^{2} x_{1}'
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
        factor = "" if name == "1" else " " + symbol(name, style)
        text += f"{sign}{_number(abs(value), precision, style)}{factor}"
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
    """
    if style == "text":
        return name
    name = re.sub(r"\^(\d+)", r"^{\1}", name)
    name = re.sub(rf"\b({'|'.join(_FUNCTIONS)})\(", r"\\operatorname{\1}(", name)
    name = re.sub(r"\b([A-Za-z]+)(\d+)\b", r"\1_{\2}", name)
    return re.sub(r"\b([A-Za-z]+)_([A-Za-z0-9_]+)", _subscript, name)


def _subscript(match: re.Match) -> str:
    inner = match.group(2).replace("_", ",")
    return f"{match.group(1)}_{{{inner}}}"


def _number(value: float, precision: int, style: str) -> str:
    smallest = 10.0 ** -max(precision - 1, 1)  # below it a fixed point would cost digits
    if smallest <= round(value, precision) < 1e5:
        return f"{value:.{precision}f}"
    mantissa, exponent = f"{value:.{precision}e}".split("e")
    if style == "latex":
        return rf"{mantissa} \cdot 10^{{{int(exponent)}}}"
    return f"{mantissa}e{int(exponent)}"
