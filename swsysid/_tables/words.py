"""Columns of two words, such as ON and OFF, as the numbers 0 and 1."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from swsysid._tables.cells import is_missing

# Pairs of which everybody knows which is 0 and which is 1. What closes a circuit closes a valve as
# well, so that "closed" is 0 as a valve has it, which is printed.
_PAIRS = (
    ("off", "on"),
    ("closed", "open"),
    ("close", "open"),
    ("no", "yes"),
    ("n", "y"),
    ("false", "true"),
    ("f", "t"),
    ("low", "high"),
    ("lo", "hi"),
    ("disabled", "enabled"),
    ("inactive", "active"),
    ("stopped", "running"),
    ("released", "pressed"),
    ("aus", "ein"),
    ("aus", "an"),
    ("zu", "auf"),
    ("nein", "ja"),
)
_BYTES = re.compile(r"b?(['\"])(.*)\1", re.S)  # as Python prints bytes and quoted text
MOST = 5  # words that are listed


def bare(cell: object) -> str:
    """A word without its quotes and blanks, b'ON' included.

    Examples
    --------
    >>> bare(b"ON"), bare(" b'ON' "), bare("ON")
    ('ON', 'ON', 'ON')
    """
    text = str(cell).strip()
    quoted = _BYTES.fullmatch(text)
    return quoted.group(2).strip() if quoted else text


def two_words(cells: NDArray) -> tuple[NDArray[np.float64], str] | None:
    """Zeros, ones, and NaN for empty cells, and which word is which; None for other words.

    Examples
    --------
    >>> two_words(np.array(["ON", "", "OFF"], dtype=object))
    (array([ 1., nan,  0.]), 'OFF is 0, ON is 1')
    """
    words = [word if not is_missing(word) else "" for word in map(bare, cells)]
    shown = {word.lower(): word for word in words[::-1] if word}
    for pair in _PAIRS:
        if shown and set(shown) <= set(pair):
            level = {shown[word]: float(k) for k, word in enumerate(pair) if word in shown}
            values = [float(pair.index(word.lower())) if word else np.nan for word in words]
            return np.array(values), ", ".join(f"{word} is {k:g}" for word, k in level.items())
    return None


def listed(cells: NDArray) -> str:
    """The different words of a column, the first few of them.

    Examples
    --------
    >>> listed(np.array(["up", "down", "up"], dtype=object))
    "'up', 'down'"
    """
    words = list(dict.fromkeys(word for word in map(bare, cells) if not is_missing(word)))
    more = f" and {len(words) - MOST:,} more" if len(words) > MOST else ""
    return ", ".join(map(repr, words[:MOST])) + more
