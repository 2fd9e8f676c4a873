"""What all displays share: a palette safe for colour-blind readers, axes, labels, frames."""

from __future__ import annotations

from contextlib import contextmanager
from typing import Any

import numpy as np

from swsysid._validation.arrays import column, labels, table
from swsysid._validation.parameters import names_of_columns, shown
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

#: Okabe and Ito's colours, the dark ones first; markers repeat the message without colour.
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
_MARKERS = ("o", "^", "s", "D", "v", "P")

#: Sizes that survive a projector and a two-column page, and the colours of `PALETTE`. Displays use
#: them without being asked; a picture of one's own takes them with ``plt.style.use(STYLE)``.
STYLE: Any = {
    "font.size": 13,
    "axes.labelsize": 14,
    "axes.titlesize": 14,
    "legend.fontsize": 11,
    "legend.frameon": True,
    "legend.framealpha": 0.9,
    "lines.linewidth": 2.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.formatter.useoffset": False,
    "axes.prop_cycle": f"cycler('color', {list(PALETTE)})",
}


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


@contextmanager
def canvas(ax=None, n_panels: int = 1, panel_size=(5.6, 4.4), n_columns: int | None = None):
    """Axes to draw on, an array of `n_panels`: the user's, or those of a new figure.

    A new figure has all panels in one row, or rows of `n_columns`.

    The style holds inside the ``with`` block only: no setting of matplotlib is changed.
    """
    import matplotlib.pyplot as plt

    with plt.style.context(STYLE):
        if ax is None:
            width, height = panel_size
            across = min(n_columns or n_panels, n_panels)
            down = -(-n_panels // across)
            figure, ax = plt.subplots(
                down, across, figsize=(width * across, height * down), layout="constrained"
            )
            for unused in np.ravel(ax)[n_panels:]:
                figure.delaxes(unused)
            ax = np.ravel(ax)[:n_panels]
        axes = np.atleast_1d(np.asarray(ax, dtype=object)).ravel()
        if len(axes) != n_panels:
            raise ValueError(
                f"ax holds {len(axes)} axes, but this display draws {n_panels} panels; "
                f"pass an array of {n_panels} axes, or None for a new figure."
            )
        yield axes


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
