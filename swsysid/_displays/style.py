"""What all displays share: a palette safe for colour-blind readers, axes, labels, frames."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from swsysid._checks.arrays import Array, labels, table
from swsysid._checks.estimators import check_fitted, column_names, in_fitted_form
from swsysid._checks.parameters import shown
from swsysid._rendering.series import PALETTE, canvas
from swsysid._tables.units import rate_unit
from swsysid.metrics import match_modes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MARKERS = ("o", "^", "s", "D", "v", "P")


class Display:
    """A picture: a class method computes it, ``plot`` draws it again on other axes."""

    _panel_size: ClassVar = (5.6, 4.4)
    _n_columns: ClassVar[int | None] = None  # of a new figure; all panels in one row if None
    _one_panel: ClassVar = False  # then `ax_` is one axes instead of an array

    def plot(self, ax=None, **kwargs) -> Self:
        """Draw.

        Parameters
        ----------
        ax : matplotlib Axes or array of them, default=None
            One for each panel; a new figure if None.
        **kwargs
            Passed to what draws the data, as the class method that computes says.

        Returns
        -------
        Display
            Itself, with ``ax_`` and ``figure_``.
        """
        panels = self._panels(**kwargs)
        with canvas(ax, len(panels), self._panel_size, self._n_columns) as axes:
            self.ax_ = axes[0] if self._one_panel else axes
            self.figure_ = axes[0].figure
            for draw, one in zip(panels, axes, strict=True):
                draw(one)
        return self

    def _panels(self, **kwargs) -> list[Callable[[Axes], None]]:
        """Functions that draw one panel each, on its axes."""
        return [partial(self._draw, **kwargs)]

    def _draw(self, ax, **kwargs) -> None:
        """Draw the only panel."""
        raise NotImplementedError

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


def unit_of(name: str, units=None) -> str | None:
    """The unit of a channel, or of the velocity ``"d/dt name"`` of one; None if it is not known.

    Examples
    --------
    >>> units = {"x": "m", "v": "m/s", "a": "m/s^2"}
    >>> [unit_of(name, units) for name in ("x", "d/dt x", "d/dt v", "d/dt a", "y")]
    ['m', 'm/s', 'm/s^2', 'm/s^3', None]
    """
    known = units or {}
    state = known.get(name.removeprefix("d/dt "))
    if name in known or state is None:
        return known.get(name)
    return rate_unit(state, known.get("time", "s"))


def axis_label(name: str, units=None) -> str:
    """``"name (unit)"`` where `units`, a mapping from names to units, knows the name."""
    unit = unit_of(name, units)
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


def predicted_modes(estimator, X):
    """Modes of the rows of X, or the classes of a classifier."""
    predict = getattr(estimator, "predict_modes", None) or estimator.predict
    return np.asarray(predict(in_fitted_form(estimator, X)))


def read(estimator, X, names=None) -> tuple[Array, list[str]]:
    """X as an array and the names of its columns, for an estimator that has been fitted."""
    check_fitted(estimator)
    values = table("X", X)
    return values, column_names(estimator, X, values.shape[1], names)


def thinned(n_points: int, most: int) -> slice:
    """At most so many points, evenly spaced in their order."""
    return slice(None, None, max(1, -(-n_points // most)))


def bins_along(coordinate, fewest: int = 1, most: int = 30, rows_a_bin: int = 40):
    """Rows of bins of equally many samples along the coordinate."""
    n_bins = int(np.clip(len(coordinate) // rows_a_bin, fewest, most))
    return np.array_split(np.argsort(coordinate, kind="stable"), n_bins)


def frame_most(ax, values, room: float, whole=None) -> None:
    """Limits that a few outliers of the values cannot stretch; `whole` is shown in full."""
    low, high = np.quantile(values, [0.002, 0.998])
    if whole is not None:
        low, high = min(low, np.min(whole)), max(high, np.max(whole))
    if high > low:
        ax.set_ylim(low - room * (high - low), high + room * (high - low))


def legend_above(ax, n_columns: int, **options):
    """A legend without a frame above the axes."""
    place = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0)}
    return ax.legend(ncols=n_columns, frameon=False, **place, **options)
