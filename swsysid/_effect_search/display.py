"""A search for effects as a picture: residuals, errors, the effect's shape, a rollout."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Self

import numpy as np

from swsysid._checks.arrays import table
from swsysid._checks.estimators import check_fitted
from swsysid._checks.parameters import shown, whole
from swsysid._data.records import make_records
from swsysid._displays.style import Display
from swsysid._effect_search.contents import EffectContents
from swsysid._effect_search.data import EffectData
from swsysid._effect_search.panels import Panels

__all__ = ["EffectReportDisplay"]


@dataclass(kw_only=True, eq=False, repr=False)
class EffectReportDisplay(Display):
    """Before and after: four panels, or as many of them as the data allow.

    Residual of the declared model and of the one with the effects over the held-out rows; their
    error on each trajectory; what an effect contributes along its channel, with its 95 %
    confidence band and what the data ask of it (the residual without the effect); and, of the
    trajectories simulated from their first states by both models, the one on which the declared
    model is worst.

    Use `from_report`, the report's own ``plot``, or `from_estimator` for other data.

    Parameters
    ----------
    data : EffectData
    state : int
        State whose velocity (or next value) is shown.
    effect : int or None
        Number of the effect whose shape is shown.
    units : mapping from names to units, default=None

    Attributes
    ----------
    ax_ : ndarray of matplotlib Axes
    figure_ : matplotlib Figure

    Examples
    --------
    >>> import matplotlib; matplotlib.use("Agg")
    >>> from swsysid import EffectSearchCV
    >>> from swsysid.datasets import make_undeclared
    >>> from swsysid.effects import CoulombFriction
    >>> from swsysid.plotting import EffectReportDisplay
    >>> data = make_undeclared("coulomb_friction", system="pendulum", random_state=0)
    >>> search = EffectSearchCV(data.estimator, effects=[CoulombFriction()])
    >>> search = search.fit(data.X, data.Xdot, t=data.t, groups=data.groups)
    >>> test = data.test
    >>> display = EffectReportDisplay.from_estimator(
    ...     search, test.X, test.Xdot, t=test.t, groups=test.groups)
    >>> display.ax_[2].get_xlabel()
    'x1'
    """

    data: EffectData
    state: int
    effect: int | None = None
    units: Mapping[str, str] | None = None

    _panel_size, _n_columns = (6.2, 4.4), 2

    @classmethod
    def from_estimator(
        cls,
        search,
        X,
        Xdot,
        *,
        t=None,
        groups=None,
        signals=None,
        equation=None,
        effect=None,
        units=None,
        ax=None,
    ):
        """Draw the declared and the final model of a search on data, best on fresh ones.

        Parameters
        ----------
        search : EffectSearchCV
        X : array-like of shape (n_samples, n_states + n_inputs)
        Xdot : array-like of shape (n_samples,) or (n_samples, n_states)
        t, groups : array-like of shape (n_samples,), default=None
        signals : array-like of shape (n_samples, n_signals), default=None
        equation : str, default=None
            The state that is shown, by name; the one in which the effect acts if None.
        effect : int, default=None
            Number of the effect whose shape is shown, from 0; the most important one if None.
        units : mapping from names to units, default=None
            A name ``"d/dt x"`` gives the unit of a velocity, ``"time"`` that of time.
        ax : array of matplotlib Axes, default=None
            One for each panel; a new figure if None.

        Returns
        -------
        EffectReportDisplay
        """
        check_fitted(search, "report_")
        known = search.report_.data
        if known is None:
            raise ValueError(_NOTHING)
        targets = table("Xdot", Xdot, n_columns=known.targets.shape[1])
        records = make_records(
            table("X", X, len(targets), known.records.X.shape[1]),
            targets.shape[1],
            t=t,
            groups=groups,
            signals=signals,
            names=known.records.names[: known.records.X.shape[1]],
        )
        data = EffectData(
            records=records,
            rows=np.arange(len(records)),
            targets=targets,
            models=(search.declared_estimator_, search.best_estimator_),
            final=search.best_estimator_,
            covariances=known.covariances,
            trajectory_names=None if groups is None else np.unique(groups),
        )
        return cls._of(data, equation, effect, units).plot(ax=ax)

    @classmethod
    def from_report(
        cls,
        report: EffectContents,
        *,
        equation: str | None = None,
        effect: int | None = None,
        units: Mapping[str, str] | None = None,
        ax=None,
    ) -> Self:
        """Draw what an `EffectReport` says of the held-out rows.

        Parameters
        ----------
        report : EffectReport
        equation, effect, units, ax
            As in `from_estimator`.

        Returns
        -------
        EffectReportDisplay
        """
        if not isinstance(report, EffectContents):
            raise TypeError(f"report={shown(report)} is none; give report_ of an EffectSearchCV.")
        if report.data is None:
            raise ValueError(_NOTHING)
        return cls._of(report.data, equation, effect, units).plot(ax=ax)

    @classmethod
    def _of(cls, data, equation, effect, units):
        n_effects = len(data.covariances)
        if whole("effect", effect, least=0, also=(None,)) not in (None, *range(n_effects)):
            raise ValueError(f"effect={effect} is too large; give a number below {n_effects}.")
        named = isinstance(equation, str) and equation in data.names
        if equation is not None and not named:
            raise ValueError(
                f"equation={shown(equation)} is unknown; choose among {', '.join(data.names)}."
            )
        chosen = 0 if effect is None and n_effects else effect
        if equation is not None:
            state = data.names.index(equation)
        else:
            state = data.most_changed if chosen is None else data.shapes[chosen].target
        return cls(data=data, state=state, effect=chosen, units=units)

    def _panels(self):
        panels, data, state = Panels(self.data, self.units), self.data, self.state
        drawn = [partial(panels.residuals, state=state)]
        if data.by_trajectory:
            drawn.append(partial(panels.trajectory_errors, state=state))
        if self.effect is not None:
            drawn.append(partial(panels.shape, place=self.effect))
        if data.rollouts:
            errors = [rollout.errors[0][state] for rollout in data.rollouts]
            worst = int(np.nanargmax(errors)) if np.isfinite(errors).any() else 0
            drawn.append(partial(panels.rollout, number=worst, state=state))
        return drawn


_NOTHING = "The record was too short to hold any of it out: there is nothing to draw."
