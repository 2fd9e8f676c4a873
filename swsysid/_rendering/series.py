"""Named signals over time, as a data frame and as a picture, and what every picture is drawn on.

The palette is safe for colour-blind readers.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import DataFrame


Array = NDArray[np.float64]
#: Okabe and Ito's colours, the dark ones first; markers repeat the message without colour.
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
#: Sizes that survive a projector and a two-column page, and the colours of `PALETTE`. Displays use
#: them without being asked; a picture of one's own takes them with ``plt.style.use(STYLE)``.
STYLE: dict[str, object] = {
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


def names_or_numbers(names: Sequence[str], n_columns: int) -> list[str]:
    """The names, or x0, x1, ... where there are none."""
    return list(names) if names else [f"x{column}" for column in range(n_columns)]


def span(t: Array) -> str:
    """How many times there are, and from where to where: 401 times from 0 to 4."""
    counted = f"{len(t)} time{'' if len(t) == 1 else 's'}"
    return f"{counted} from {t.min():g} to {t.max():g}" if len(t) else counted


def frame_of(t: Array, columns: Mapping[str, Array], further: Mapping[str, NDArray]) -> DataFrame:
    """A pandas data frame with one row for each time, which is its index.

    A signal that bears the name of a further column is kept beside it.
    """
    import pandas as pd

    frame = pd.DataFrame(dict(columns), index=pd.Index(t, name="t"))
    for name, values in further.items():
        frame.insert(len(frame.columns), name, values, allow_duplicates=True)
    return frame


def draw_series(
    ax: Axes | None,
    pieces: Sequence[tuple[Array, Array]],
    names: Sequence[str],
    changes: Iterable[float],
    bands: Iterable[tuple[Array, Array]] = (),
) -> Axes:
    """Draw signals over time on one axes (of a new figure if None), and return it.

    `pieces` (t, values), of shapes (n_times,) and (n_times, n_signals), are not joined by a line;
    times of `changes` are marked by a thin one. `bands` (lower, upper) of pieces are shaded.
    """
    with canvas(ax, panel_size=(8.0, 4.0)) as (axes,):
        for time in changes:
            axes.axvline(time, color="0.75", linewidth=0.6, zorder=0)
        for number, (t, values) in enumerate(pieces):
            for column, name in enumerate(names):
                label = f"_{name}" if number else name  # one entry in the legend for all pieces
                colour = PALETTE[column % len(PALETTE)]
                dashes = ("-", "--", ":", "-.")[column // len(PALETTE) % 4]
                axes.plot(t, values[:, column], dashes, color=colour, label=label)
        for (t, _), (lower, upper) in zip(pieces, bands, strict=False):
            for column in range(len(names)):
                ends, colour = (lower[:, column], upper[:, column]), PALETTE[column % len(PALETTE)]
                axes.fill_between(t, *ends, color=colour, alpha=0.2, linewidth=0)
        axes.set_xlabel("t")
        if len(names) == 1:
            axes.set_ylabel(names[0])
        else:
            axes.legend()
    return axes


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
