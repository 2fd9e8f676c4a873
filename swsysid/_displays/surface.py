"""The switching surface over the samples, in a plane of two features."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._checks.estimators import in_fitted_form
from swsysid._checks.parameters import function, shown, whole
from swsysid._displays.style import (
    Display,
    axis_label,
    legend_above,
    mode_colour,
    mode_marker,
    mode_names,
    named_as_predicted,
    predicted_modes,
    read,
    resolve_column,
)
from swsysid._surfaces.surface import gives_values, mode_book_of

_MOST_RESOLUTION = 5000


@dataclass(kw_only=True, eq=False, repr=False)
class SwitchingSurfaceDisplay(Display):
    """Samples coloured by mode, predicted regions shaded, identified surfaces drawn.

    Use `from_estimator`. All features but two are held at their medians over the samples, or at
    the sample below where that falls between two. Where the modes depend on such a feature, a line
    below the axis says at which value the regions are drawn.

    Parameters
    ----------
    grid : tuple of two ndarrays of shape (n_grid,)
        Values of the two features on the axes.
    regions : ndarray of shape (n_grid, n_grid)
        Position in `classes` of the predicted mode; rows go along the second feature.
    levels : list of ndarray of shape (n_grid, n_grid)
        Functions whose zero level sets are drawn as the identified surfaces.
    true_levels : list of ndarray of shape (n_grid, n_grid)
        The same for the true guard; empty if unknown.
    samples : ndarray of shape (n_samples, 2)
    modes : ndarray of shape (n_samples,)
    classes : list
        Names of the modes.
    labels : tuple of two str
        Labels of the axes, with units where they are known.
    where : str, default=""
        Values of the other features on which the predicted modes depend.

    Attributes
    ----------
    ax_ : matplotlib Axes
    figure_ : matplotlib Figure

    Examples
    --------
    >>> import matplotlib; matplotlib.use("Agg")
    >>> import numpy as np
    >>> from sklearn.linear_model import LogisticRegression
    >>> from swsysid.plotting import SwitchingSurfaceDisplay
    >>> X = np.random.default_rng(0).uniform(-1, 1, size=(200, 2))
    >>> surface = LogisticRegression().fit(X, X[:, 0] > 0)
    >>> display = SwitchingSurfaceDisplay.from_estimator(surface, X, true_guard=lambda X: X[:, 0])
    >>> display.ax_.get_xlabel()
    'x0'
    """

    grid: tuple[NDArray, NDArray]
    regions: NDArray
    levels: list[NDArray]
    true_levels: list[NDArray]
    samples: NDArray
    modes: NDArray
    classes: list
    labels: tuple[str, str]
    where: str = ""

    _panel_size, _one_panel = (6.4, 5.2), True

    @classmethod
    def from_estimator(
        cls,
        estimator,
        X,
        *,
        modes=None,
        features=(0, 1),
        true_guard=None,
        names=None,
        units=None,
        limits=None,
        grid_resolution=250,
        ax=None,
        **kwargs,
    ):
        """Evaluate the surface on a grid and draw it.

        Parameters
        ----------
        estimator : SwitchingSystemRegressor or classifier
            Anything fitted with ``predict_modes`` or, without it, ``predict``. Its
            ``surface_`` (or itself) may offer ``surface_values``; otherwise the boundaries of
            the predicted regions are drawn.
        X : array-like or data frame of shape (n_samples, n_features)
        modes : array-like of shape (n_samples,) or "fitted", default=None
            True labels that colour the samples, under the names of the predicted modes that they
            agree with best; the predicted ones if None. ``"fitted"`` are the labels that the fit
            gave its samples, ``estimator.modes_``, for the `X` of the fit.
        features : pair of int or str, or "auto", default=(0, 1)
            The features on the axes. ``"auto"`` are the two on which the mode of most samples
            depends, such as the input of a gate; the first ones where it depends on fewer.
        true_guard : callable, default=None
            ``true_guard(X)`` of shape (n_samples,) or (n_samples, n_surfaces) vanishes on the
            true surfaces; drawn dashed.
        names : sequence of str, default=None
            Names of the columns of `X`.
        units : mapping from names to units, default=None
        limits : pair of (low, high), default=None
            What the two axes show; the range of the samples, a little widened, if None.
        grid_resolution : int, default=250
        ax : matplotlib Axes, default=None
        **kwargs
            Passed to ``ax.scatter``.

        Returns
        -------
        SwitchingSurfaceDisplay
        """
        whole("grid_resolution", grid_resolution, least=2, most=_MOST_RESOLUTION)
        function("true_guard", true_guard, "X", also=(None,))
        X, names = read(estimator, X, names)
        if X.shape[1] < 2:
            raise ValueError("X has one feature; a plane needs two.")
        columns = _columns(estimator, X, features, names)
        if limits is None:
            room = [0.04 * (np.ptp(X[:, column]) or 1.0) for column in columns]
            ends = X[:, columns].min(axis=0) - room, X[:, columns].max(axis=0) + room
            limits = np.transpose(ends)
        grid = tuple(np.linspace(low, high, grid_resolution) for low, high in limits)
        first, second = np.meshgrid(*grid)
        # a value that occurs: half of a switch that is 0 or 1 is no state of it
        middle = np.quantile(X, 0.5, axis=0, method="lower")
        shape, points = first.shape, np.tile(middle, (first.size, 1))
        points[:, columns] = np.column_stack([first.ravel(), second.ravel()])
        held = _deciding(estimator, X, points[0], set(range(X.shape[1])) - set(columns))
        with_units = {one: (units or {}).get(names[one], "") for one in held}
        where = [f"{names[one]} = {points[0, one]:.3g} {unit}" for one, unit in with_units.items()]

        predicted = predicted_modes(estimator, np.vstack([X, points]))
        if isinstance(modes, str):
            modes = _fitted_modes(estimator, modes, len(X))
        else:
            modes = named_as_predicted(modes, predicted[: len(X)])
        regions = np.searchsorted(np.unique(predicted), predicted[len(X) :]).reshape(shape)
        display = cls(
            grid=grid,
            regions=regions,
            levels=_level_functions(estimator, points, regions),
            true_levels=[] if true_guard is None else _as_levels(true_guard(points), shape),
            samples=X[:, columns],
            modes=modes,
            classes=mode_names(predicted, modes),
            labels=tuple(axis_label(names[column], units) for column in columns),
            where=", ".join(map(str.strip, where)),
        )
        return display.plot(ax=ax, **kwargs)

    def _draw(self, ax, **kwargs):
        style = {"s": 14, "alpha": 0.75, "linewidths": 0, **kwargs}
        looks = [(mode_colour(place), mode_marker(place)) for place in range(len(self.classes))]
        for position, (colour, _) in enumerate(looks):
            # a mask of one region, filled where it exceeds one half
            mask = (self.regions == position).astype(float)
            if mask.any():
                ax.contourf(*self.grid, mask, levels=[0.5, 1.5], colors=[colour], alpha=0.18)
        for mode, (colour, marker) in zip(self.classes, looks, strict=True):
            points = self.samples[self.modes == mode].T
            ax.scatter(*points, color=colour, marker=marker, label=f"mode {mode}", **style)
        _draw_levels(ax, self.grid, self.levels, "identified surface", "black", "-")
        _draw_levels(ax, self.grid, self.true_levels, "true guard", "#F0E442", "--")
        where = f"\nregions shown at {self.where}" if self.where else ""
        ax.set(xlabel=self.labels[0] + where, ylabel=self.labels[1])
        ax.set_xlim(self.grid[0][[0, -1]])
        ax.set_ylim(self.grid[1][[0, -1]])
        handles, _ = ax.get_legend_handles_labels()
        spaces = {"handletextpad": 0.4, "columnspacing": 1.2}
        legend = legend_above(ax, min(len(handles), 4), **spaces)
        for handle in legend.legend_handles[: len(self.classes)]:
            handle.set_sizes([50])
            handle.set_alpha(1.0)


def _columns(estimator, X, features, names):
    """The columns on the axes."""
    if isinstance(features, str) and features == "auto":
        every = range(X.shape[1])
        shares = _shares(estimator, X, np.quantile(X, 0.5, axis=0, method="lower"), every)
        # less than one sample in two hundred is not seen in a picture; of equals the first
        return sorted(sorted(every, key=lambda column: -round(100 * shares[column]))[:2])
    if isinstance(features, str) or not np.iterable(features) or len(list(features)) != 2:
        raise ValueError(
            f'features={shown(features)} must name the two columns on the axes, or be "auto".'
        )
    return [resolve_column(feature, names) for feature in features]


def _deciding(estimator, X, middle, others):
    """The columns beside those on the axes that change the mode of a sample if they are held."""
    return [column for column, share in _shares(estimator, X, middle, others).items() if share]


def _shares(estimator, X, middle, columns):
    """Of each column, the share of samples whose mode changes if it is held in the middle."""
    found, shares = predicted_modes(estimator, X), {}
    for column in sorted(columns):
        held = X.copy()
        held[:, column] = middle[column]
        shares[column] = np.mean(predicted_modes(estimator, held) != found)
    return shares


def _fitted_modes(estimator, modes, n_samples):
    """The labels that the fit gave its samples."""
    if modes != "fitted":
        raise ValueError(f"modes={modes!r} is unknown; give labels, 'fitted' or None.")
    labels = np.asarray(estimator.modes_)
    if len(labels) != n_samples:
        raise ValueError(
            f"modes='fitted' are the labels of the {len(labels)} samples of the fit and X has "
            f"{n_samples} rows; give the X of the fit, or modes=None."
        )
    return labels


def _level_functions(estimator, points, regions):
    surface = getattr(estimator, "surface_", estimator)
    # A surface between two of several modes is an edge only where no third mode is active
    book = mode_book_of(surface)
    if gives_values(surface) and (book is None or book.all()):
        values = surface.surface_values(in_fitted_form(surface, points))
        return _as_levels(values, regions.shape)
    # no formula to draw: the edges of each predicted region but one
    return [(regions == position) - 0.5 for position in np.unique(regions)[1:]]


def _as_levels(values, shape):
    values = np.asarray(values, dtype=float).reshape(shape[0] * shape[1], -1)
    return [column.reshape(shape) for column in values.T]


def _draw_levels(ax, grid, levels, label, colour, style):
    import matplotlib.patheffects as effects

    # the yellow dashes of the true guard lie on the black line of the identified surface
    width = 3.0 if style == "-" else 1.8
    look = {"colors": colour, "linestyles": style, "linewidths": width}
    crossing = [level for level in levels if level.min() < 0.0 < level.max()]
    for level in crossing:
        ax.contour(*grid, level, levels=[0.0], **look)
    if crossing:
        (proxy,) = ax.plot([], [], color=colour, linestyle=style, linewidth=width, label=label)
        if style != "-":
            edge = effects.Stroke(linewidth=3.4, foreground="black")
            proxy.set_path_effects([edge, effects.Normal()])
