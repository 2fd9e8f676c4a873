"""What every picture is drawn on: a palette safe for colour-blind readers, sizes, axes."""

from __future__ import annotations

from contextlib import contextmanager

import numpy as np

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
