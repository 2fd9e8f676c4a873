"""Named signals over time: as a data frame, as a picture, in a few words."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swsysid._rendering.canvas import PALETTE, canvas

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import DataFrame

Array = NDArray[np.float64]


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
    pieces: Iterable[tuple[Array, Array]],
    names: Sequence[str],
    changes: Iterable[float],
) -> Axes:
    """Draw signals over time on one axes (of a new figure if None), and return it.

    `pieces` (t, values), of shapes (n_times,) and (n_times, n_signals), are not joined by a line;
    times of `changes` are marked by a thin one.
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
        axes.set_xlabel("t")
        if len(names) == 1:
            axes.set_ylabel(names[0])
        else:
            axes.legend()
    return axes
