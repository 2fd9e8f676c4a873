"""Names of the columns of laws and guards."""

from __future__ import annotations

from collections.abc import Sequence

#: Columns of guards after those of the laws: time since the mode was entered, and time itself.
CLOCKS = ("dwell", "time")


def lagged_names(names: Sequence[str], lags: int) -> list[str]:
    """Names of channels, the newest row first; with lags each tells its row.

    Examples
    --------
    >>> lagged_names(["x", "v"], 0), lagged_names(["x", "v"], 1)
    (['x', 'v'], ['x[k]', 'v[k]', 'x[k-1]', 'v[k-1]'])
    """
    if not lags:
        return list(names)
    rows = ["[k]", *(f"[k-{lag}]" for lag in range(1, lags + 1))]
    return [f"{name}{row}" for row in rows for name in names]


def other_names(name: str) -> tuple[str, str, str]:
    """A name and those under which the same column may be known: x[k] is also called x.

    Examples
    --------
    >>> other_names("x"), other_names("x[k]")[2]
    (('x', 'x[k]', 'x'), 'x')
    """
    return name, f"{name}[k]", name.removesuffix("[k]")
