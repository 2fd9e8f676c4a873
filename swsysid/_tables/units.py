"""Units of columns: read from their names or from a row of units, and of time derivatives."""

from __future__ import annotations

import re

# Symbols recognised at the end of a column name such as v_m_per_s; single letters that are
# commoner as labels than as units (T, C, F, d, g, h) are left out and can be given by the user.
_IN_NAMES = frozenset(
    "m cm mm um km s ms us min Hz kHz rad deg rpm V mV kV A mA N kN Nm Pa kPa MPa bar W kW mW "
    "J kJ K degC kg mol Ohm".split()
)
# Before a time these are a speed: nobody logs metre seconds.
_WAYS = frozenset("m cm mm um km rad deg".split())
# In a row of their own the single letters, signs and words are units as well.
_IN_ROWS = _IN_NAMES | frozenset(
    "- 1 % C F T g d h H L l nm mN uV uA MN Mbar mbar hPa hr deg/s ° °C °F Ω µm µs µV µA".split()
)
_WORDS = frozenset(
    "sec secs second seconds minute minutes hour hours meter meters metre metres volt volts "
    "ampere amperes amp amps newton newtons degree degrees radian radians celsius kelvin".split()
)
# Seconds in each unit of time, by its name in small letters.
SECONDS = {
    name: seconds
    for seconds, names in {
        1.0: "s sec secs second seconds",
        1e-3: "ms msec msecs millis millisecond milliseconds",
        1e-6: "us µs μs usec usecs micros microsecond microseconds",
        1e-9: "ns nsec nsecs nanos nanosecond nanoseconds",
        60.0: "min mins minute minutes",
        3600.0: "h hr hrs hour hours",
        86400.0: "d day days",
    }.items()
    for name in names.split()
}
# der(x) is no x in units of der: tools of Modelica name the derivative of a state so. Nor is the
# 0 of q[0] a unit, or the 5 of "pos (5)".
PURE = ("-", "1")  # written where a number has no unit
_BRACKET = re.compile(
    r"(?<!\bder)(?:\s+(?!\(\d+\)|\[(?!1\])\d+\])|(?![\[(]\d))[\[(]([^\])]*)[\])]\s*$"
)


def without_unit(name: str) -> str:
    """A name without the unit in brackets at its end."""
    return _BRACKET.sub("", name)


def is_unit(cell: str) -> bool:
    """True for a cell of a row of units.

    Examples
    --------
    >>> [is_unit(cell) for cell in ("[m/s]", "rad/s^2", "Volt", "kg m^2", "speed")]
    [True, True, True, True, False]
    """
    text = cell.strip()
    if _BRACKET.fullmatch(text) or text in _IN_ROWS or text.lower() in _WORDS:
        return True
    parts = re.split(r"[\s/*·.()]+", re.sub(r"[\^]?[-+]?\d|[²³⁻¹]", "", text))
    return bool(text) and all(part in _IN_ROWS for part in parts if part)


def unit_of(name: str) -> str:
    """The unit that a column name carries, "" if none.

    Examples
    --------
    >>> [unit_of(name) for name in ("v_m_per_s", "a_m_per_s2", "force [N]", "T_box", "v_in_per_s")]
    ['m/s', 'm/s^2', 'N', '', '']
    >>> [unit_of(name) for name in ("v_m_s", "w_deg_s", "a_m_s2", "work_N_m", "pulse_N_s")]
    ['m/s', 'deg/s', 'm/s^2', 'N m', 'N s']
    >>> [unit_of(name) for name in ("h(m)", "der(h)", "der(h) [m/s]")]
    ['m', '', 'm/s']
    >>> [unit_of(name) for name in ("gate [-]", "gate [1]", "pos (5)", "pos (5) [rad]")]
    ['', '', '', 'rad']
    """
    bracket = _BRACKET.search(name)
    if bracket:
        return "" if bracket.group(1) in PURE else bracket.group(1)
    parts = name.split("_")
    for start in (k for k in range(1, len(parts)) if parts[k - 1] != "per"):
        groups = [group.split("_") for group in "_".join(parts[start:]).split("_per_")]
        symbols = [[_symbol(part) for part in group] for group in groups]
        if all(all(group) for group in symbols):
            return "/".join(_product(group) for group in symbols)
    return ""


def rate_unit(unit: str, time_unit: str) -> str:
    """The unit of a time derivative, "" if either is unknown.

    Examples
    --------
    >>> rate_unit("m", "s"), rate_unit("m/s", "s"), rate_unit("degC", "min")
    ('m/s', 'm/s^2', 'degC/min')
    """
    if not unit or not time_unit:
        return ""
    head, slash, tail = unit.rpartition("/")
    base, _, power = tail.partition("^")
    if slash and base == time_unit:
        return f"{head}/{base}^{int(power or 1) + 1}"
    return f"{unit}/{time_unit}"


def _product(symbols: list[str]) -> str:
    """A product of units; a length or an angle and a time are a speed."""
    if len(symbols) == 2 and symbols[0] in _WAYS and symbols[1].partition("^")[0] in SECONDS:
        return "/".join(symbols)
    return " ".join(symbols)


def _symbol(part: str) -> str:
    match = re.fullmatch(r"([A-Za-z]+?)(\d?)", part)
    if not match or match.group(1) not in _IN_NAMES:
        return ""
    return match.group(1) + (f"^{match.group(2)}" if match.group(2) else "")
