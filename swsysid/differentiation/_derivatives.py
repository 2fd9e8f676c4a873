"""States and their time derivatives, as `differentiate` hands them out."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swsysid._rendering.series import draw_series, frame_of, names_or_numbers, span
from swsysid._results import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import DataFrame


class _Parts(NamedTuple):
    X: Array
    Xdot: Array
    t: Array
    groups: NDArray
    noise: Array


class Derivatives(_Parts):
    """States and their time derivatives, ends trimmed.

    Unpacks as ``X, Xdot, t, groups, noise``.

    Attributes
    ----------
    X : ndarray of shape (n_kept, n_states + n_inputs)
        Smoothed states, then the inputs, filtered alike. With ``order=2`` the states are the
        positions followed by the velocities.
    Xdot : ndarray of shape (n_kept, n_states)
    t : ndarray of shape (n_kept,)
    groups : ndarray of shape (n_kept,)
    noise : ndarray of shape (n_columns,)
        Standard deviation of the noise in each measured column, in its unit.
    names : tuple of str
        Names of the columns of `X`; x0, x1, ... where the data had none.
    window : int
        Rows that share measurements with a row, itself included.

    Examples
    --------
    >>> import numpy as np, pandas as pd
    >>> from swsysid.differentiation import differentiate
    >>> t = np.linspace(0.0, 4.0, 401)
    >>> done = differentiate(pd.DataFrame({"q": np.sin(t)}), t, order=2, window=9)
    >>> done
    Derivatives(393 times from 0.04 to 3.96, q, q'; 1 trajectory)
    >>> list(done.to_frame())
    ['q', "q'", "q''", 'group']
    """

    names: tuple[str, ...]
    window: int

    def __new__(
        cls,
        X: Array,
        Xdot: Array,
        t: Array,
        groups: NDArray,
        noise: Array,
        names: Iterable[str] = (),
        window: int = 1,
    ):
        parts = super().__new__(cls, X, Xdot, t, groups, noise)
        parts.names = tuple(names_or_numbers(tuple(names), X.shape[1]))
        parts.window = int(window)
        return parts

    def __repr__(self) -> str:
        n_groups = len(np.unique(self.groups))
        trajectories = "1 trajectory" if n_groups == 1 else f"{n_groups} trajectories"
        return f"Derivatives({span(self.t)}, {', '.join(self.names)}; {trajectories})"

    @property
    def rate_names(self) -> tuple[str, ...]:
        """Names of the columns of `Xdot`: those of the states with a prime."""
        return tuple(f"{name}'" for name in self.names[: self.Xdot.shape[1]])

    def to_frame(self) -> DataFrame:
        """States, inputs, rates and the trajectory of each row, ``group``, as a data frame.

        Returns
        -------
        pandas.DataFrame of n_kept rows
            Indexed by the times. With ``order=2`` velocities are both states and rates, and stand
            there once.
        """
        columns = dict(zip(self.rate_names, self.Xdot.T, strict=True))
        states = dict(zip(self.names, self.X.T, strict=True))
        return frame_of(self.t, {**states, **columns, **states}, {"group": self.groups})

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw states and inputs over time, trajectories apart.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, default=None
            None draws on a new figure.

        Returns
        -------
        matplotlib.axes.Axes
        """
        rows = [self.groups == label for label in np.unique(self.groups)]
        return draw_series(ax, [(self.t[some], self.X[some]) for some in rows], self.names, ())


def rates_appended(states: Sequence[str], inputs: Sequence[str], order: int) -> list[str]:
    """Names of the columns of X: states, their rates below the highest, inputs.

    Examples
    --------
    >>> rates_appended(["q"], ["u"], order=2)
    ['q', "q'", 'u']
    """
    return [*(name + "'" * level for level in range(order) for name in states), *inputs]
