"""Laws of one mode that are modes, written as one: where an input has few values, and tells these.

With an input u of the values 0 and 1 the law :math:`(1 - u) f_0(x) + u f_1(x)` is that of two modes
told by u, and products of u with the terms of f have room for it: no recording of such an input
tells the two apart, and neither is better or worse.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array
from swsysid._verdict.terms import LawTerms, Terms

# Rows that are asked, evenly among all; part of a column that its fit may leave, as rounding.
_MOST_ROWS, _ROUNDING = 5000, 1e-7


def is_same(law: Terms, terms: Terms, X: Array, modes: NDArray[np.intp]) -> bool:
    """Whether a law of one mode has room for whatever laws of some `terms` the modes have at X.

    Of a library of the user's, which may ask for names of columns, that is not known.

    Examples
    --------
    >>> gate = np.repeat([0.0, 5.0], 20)
    >>> X = np.column_stack([np.random.default_rng(0).standard_normal(40), gate])
    >>> affine, quadratic = Terms((0, 1), 1), Terms((0, 1), 2)
    >>> is_same(quadratic, affine, X, gate > 2.5), is_same(quadratic, affine, X, X[:, 0] > 0.0)
    (True, False)
    """
    some = np.unique(np.linspace(0, len(X) - 1, _MOST_ROWS).astype(np.intp))
    X, modes = X[some], modes[some]
    if law == terms or terms.own is not None or (modes == modes[0]).all():
        return False
    room, own = (_values(one, X) for one in (law, terms))
    if room.shape[1] >= len(X):  # which has room for anything
        return False
    apart = np.hstack([own * (modes == mode)[:, None] for mode in np.unique(modes)])
    left = apart - room @ np.linalg.lstsq(room, apart, rcond=None)[0]
    sizes = np.linalg.norm(apart, axis=0)
    return bool((np.linalg.norm(left, axis=0) <= _ROUNDING * sizes).all())


def _values(terms: Terms, X: Array) -> Array:
    """Terms of a law at rows, in units of their size."""
    turning = terms.turning if terms.waves else ()
    values = LawTerms(terms.columns, terms.degree, turning, terms.degrees).fit_transform(X)
    sizes = np.linalg.norm(values, axis=0)
    return values / np.where(sizes > 0.0, sizes, 1.0)
