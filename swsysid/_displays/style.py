"""What all displays share: a palette safe for colour-blind readers, axes, labels, frames."""

from __future__ import annotations

import numpy as np

from swsysid._checks.arrays import column, labels, table
from swsysid._checks.parameters import names_of_columns, shown
from swsysid._rendering.canvas import PALETTE, STYLE, canvas
from swsysid.metrics import match_modes

__all__ = [
    "PALETTE",
    "STYLE",
    "Display",
    "axis_label",
    "canvas",
    "column_names",
    "in_fitted_form",
    "mode_colour",
    "mode_marker",
    "mode_names",
    "named_as_predicted",
    "resolve_column",
    "times_of",
    "trajectories",
]

_MARKERS = ("o", "^", "s", "D", "v", "P")


class Display:
    """A picture: a class method computes it, ``plot`` draws it again on other axes."""

    def __repr__(self) -> str:
        return f"{type(self).__name__}()"


def mode_colour(position: int) -> str:
    """Colour of the mode at a position of the sorted labels."""
    return PALETTE[position % len(PALETTE)]


def mode_marker(position: int) -> str:
    """Marker of the mode at a position of the sorted labels."""
    return _MARKERS[position % len(_MARKERS)]


def named_as_predicted(modes, predicted):
    """Given modes under the names of the predicted ones; the predicted ones if None is given.

    Which mode is called 0 is arbitrary, so the names are matched for the most agreement; a given
    mode without a partner keeps its name, marked.
    """
    if modes is None:
        return predicted
    given = labels("modes", modes, len(predicted))
    partners = match_modes(predicted, given)
    names = [partners.get(label, f"{label} (true)") for label in given.tolist()]
    return np.array(names, dtype=object)


def mode_names(predicted, named) -> list:
    """Names of all modes: the predicted ones in order, then what only `named` has."""
    return list(dict.fromkeys(np.unique(predicted).tolist() + np.asarray(named).tolist()))


def column_names(estimator, n_columns: int, names=None) -> list[str]:
    """Names of the columns of X: as given, or as the estimator saw them, or x0, x1, ..."""
    if names is None:
        names = getattr(estimator, "feature_names_in_", None)
    if names is None:
        names = [f"x{i}" for i in range(n_columns)]
    return names_of_columns("names", names, n_columns)


def axis_label(name: str, units=None) -> str:
    """``"name (unit)"`` where `units`, a mapping from names to units, knows the name."""
    unit = (units or {}).get(name)
    return f"{name} ({unit})" if unit else name


def resolve_column(given, names) -> int:
    """Index of a column given by index or by name."""
    if isinstance(given, str):
        if given not in names:
            raise ValueError(
                f"{shown(given)} is none of the columns; choose among {', '.join(names)}."
            )
        return names.index(given)
    a_number = isinstance(given, (int, np.integer)) and not isinstance(given, bool)
    if not a_number or not -len(names) <= given < len(names):
        raise ValueError(
            f"there is no column {shown(given)}; choose among {', '.join(names)}, or their numbers."
        )
    return int(given) % len(names)


def in_fitted_form(estimator, X):
    """`X` as a data frame where the estimator was fitted on one, else as an array."""
    names = getattr(estimator, "feature_names_in_", None)
    X = table("X", X)
    if names is None:
        return X
    import pandas as pd

    if X.shape[1] != len(names):
        raise ValueError(f"X has {X.shape[1]} columns; give {len(names)}: {', '.join(names)}.")
    return pd.DataFrame(X, columns=names)


def times_of(t, groups, n_samples: int):
    """Times as numbers that increase along every trajectory."""
    t = column("t", t, n_samples)
    for _, rows in trajectories(groups, n_samples, n_samples):
        if (np.diff(t[rows]) <= 0).any():
            raise ValueError(
                "t must increase along every trajectory; sort the rows of each by time, and name "
                "separate trajectories by groups."
            )
    return t


def trajectories(groups, n_samples: int, limit: int):
    """Pairs (name, rows) of at most `limit` trajectories, in order of appearance."""
    groups = np.zeros(n_samples, int) if groups is None else labels("groups", groups, n_samples)
    _, first = np.unique(groups, return_index=True)
    return [(groups[i], np.flatnonzero(groups == groups[i])) for i in np.sort(first)[:limit]]
