"""Residuals of the velocities against a coordinate: what the model has not explained."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Integral

import numpy as np
from numpy.typing import NDArray

from swsysid._checks.arrays import column, table
from swsysid._checks.estimators import in_fitted_form
from swsysid._checks.parameters import whole
from swsysid._displays.style import (
    Display,
    axis_label,
    bins_along,
    legend_above,
    mode_colour,
    mode_marker,
    read,
    resolve_column,
    thinned,
)


@dataclass(kw_only=True, eq=False, repr=False)
class ResidualDisplay(Display):
    """Measured minus predicted velocity of one state, against a coordinate, by mode.

    Use `from_estimator`. The line of each mode is the median of the residual in bins of equally
    many samples: where it leaves zero the model lacks something.

    Parameters
    ----------
    coordinate : ndarray of shape (n_samples,)
    residual : ndarray of shape (n_samples,)
    modes : ndarray of shape (n_samples,)
    labels : tuple of two str
        Labels of the axes.

    Attributes
    ----------
    ax_ : matplotlib Axes
    figure_ : matplotlib Figure

    Examples
    --------
    >>> import matplotlib; matplotlib.use("Agg")
    >>> import numpy as np
    >>> from sklearn.linear_model import LinearRegression
    >>> from swsysid.plotting import ResidualDisplay
    >>> X = np.linspace(-1, 1, 100)[:, None]
    >>> Xdot = -X + 0.2 * np.sign(X)
    >>> display = ResidualDisplay.from_estimator(LinearRegression().fit(X, Xdot), X, Xdot)
    >>> display.ax_.get_ylabel()
    'residual of d/dt x0'
    """

    coordinate: NDArray
    residual: NDArray
    modes: NDArray
    labels: tuple[str, str]

    _panel_size, _one_panel = (6.4, 4.6), True

    @classmethod
    def from_estimator(
        cls,
        estimator,
        X,
        y,
        *,
        against=0,
        state=None,
        names=None,
        units=None,
        max_points=4000,
        ax=None,
        **kwargs,
    ):
        """Predict the velocities and draw what is left of the measured ones.

        Parameters
        ----------
        estimator : SwitchingSystemRegressor or regressor
            Samples are coloured by ``predict_modes`` where there is one.
        X : array-like or data frame of shape (n_samples, n_states + n_inputs)
        y : array-like of shape (n_samples, n_states)
            Measured velocities, Xdot.
        against : int, str or array-like of shape (n_samples,), default=0
            A column of `X`, or any other coordinate such as the times.
        state : int or str, default=None
            The state whose residual is drawn; the one with the largest if None.
        names : sequence of str, default=None
            Names of the columns of `X`.
        units : mapping from names to units, default=None
            A name ``"d/dt x"`` gives the unit of a velocity. Where `against` is an array, the
            name ``"against"`` gives its label.
        max_points : int, default=4000
            Draw at most so many samples, evenly spaced in their order.
        ax : matplotlib Axes, default=None
        **kwargs
            Passed to ``ax.scatter``.

        Returns
        -------
        ResidualDisplay
        """
        whole("max_points", max_points)
        (values, names), frame = read(estimator, X, names), in_fitted_form(estimator, X)
        y, predicted = table("y", y), table("the prediction", estimator.predict(frame))
        if y.shape != predicted.shape:
            raise ValueError(
                f"y has shape {np.shape(y)}; the model predicts {predicted.shape[1]} velocities of "
                f"{len(values)} samples, give one each."
            )
        residuals = y - predicted
        state = _state_index(state, names, residuals)
        coordinate, label = _coordinate(against, values, names, units)
        modes = np.zeros(len(y), dtype=int)
        if hasattr(estimator, "predict_modes"):
            modes = np.asarray(estimator.predict_modes(frame))
        rows = thinned(len(y), max_points)
        velocity = axis_label(f"d/dt {names[state]}", units)
        display = cls(
            coordinate=coordinate[rows],
            residual=residuals[rows, state],
            modes=modes[rows],
            labels=(label, f"residual of {velocity}"),
        )
        return display.plot(ax=ax, **kwargs)

    def _draw(self, ax, **kwargs):
        ax.axhline(0.0, color="0.4", linewidth=1.0)
        classes = np.unique(self.modes)
        for position, mode in enumerate(classes):
            points = [one[self.modes == mode] for one in (self.coordinate, self.residual)]
            look = {"color": mode_colour(position), "marker": mode_marker(position)}
            ax.scatter(*points, **look, **{"s": 10, "alpha": 0.4, "linewidths": 0, **kwargs})
            bins = bins_along(points[0])
            medians = [[np.median(one[rows]) for rows in bins] for one in points]
            label = f"median, mode {mode}" if len(classes) > 1 else "median"
            # a white edge keeps the line apart from the points of its own colour
            ax.plot(*medians, color="white", linewidth=5.0)
            ax.plot(*medians, color=mode_colour(position), linewidth=2.6, label=label)
        ax.set(xlabel=self.labels[0], ylabel=self.labels[1])
        legend_above(ax, len(classes))


def _state_index(state, names, residuals):
    if state is None:
        return int(np.square(residuals).mean(axis=0).argmax())
    state = resolve_column(state, names)
    if state >= residuals.shape[1]:
        raise ValueError(
            f"state={state} is none of the states; give 0 to {residuals.shape[1] - 1}."
        )
    return state


def _coordinate(against, X, names, units):
    if not isinstance(against, (str, Integral)):
        return column("against", against, len(X)), (units or {}).get("against", "coordinate")
    place = resolve_column(against, names)
    return X[:, place], axis_label(names[place], units)
