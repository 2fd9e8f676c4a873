"""A declared switching model with effects beside it, as a scikit-learn regressor."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator, MultiOutputMixin, RegressorMixin

from swsysid._checks.arrays import column
from swsysid._checks.estimators import check_fitted, column_names, rows_and_velocities, rows_of
from swsysid._checks.parameters import MOST_MODES, shown
from swsysid._data.records import Records, make_records
from swsysid._effect_model.equations import (
    NoAutomatonError,
    automaton_of_fit,
    guards_with_effects,
    laws_with_effects,
    system_of,
)
from swsysid._effect_model.joint_fit import (
    JointFit,
    as_stated,
    warn_of_doubts,
    with_decoded_modes,
)
from swsysid._effect_model.models import check_declared, declared_model
from swsysid._effect_model.refinable import as_stated_model, with_numbers_of
from swsysid._effect_model.shaped_fit import fit_with_shapes
from swsysid._effect_model.simulation import simulate_with_effects
from swsysid._effect_model.velocities import with_quantity
from swsysid._rendering.printing import check_format
from swsysid._whole_or_nothing import whole_or_nothing
from swsysid.effects import Effect, PlacedEffect
from swsysid.exporting import ToOtherTools
from swsysid.metrics._scorers import ScoredByR2
from swsysid.refinement import StatedModel


class EffectRegressor(ToOtherTools, ScoredByR2, MultiOutputMixin, RegressorMixin, BaseEstimator):
    """A switching model with effects beside it, whose coefficients are fitted jointly.

    State k obeys ``xdot_k = C_jk Phi(x) + sum_e c_e h_e(x, u, t; theta_e)`` in mode j. The
    columns h of the effects and their nonlinear parameters theta are given; C and c are fitted.

    Parameters
    ----------
    estimator : estimator or HybridAutomaton
        The declared model, as `EffectSearchCV` takes it.
    effects : sequence of PlacedEffect, default=()
        Effects with their places and nonlinear parameters, as `EffectSearchCV` finds them.

    Attributes
    ----------
    estimator_ : fitted estimator or HybridAutomaton
        The declared model, fitted to what the effects leave over.
    effects_ : tuple of PlacedEffect
    effect_coef_ : tuple of ndarray
        Coefficients of the columns of each effect.
    modes_ : ndarray of shape (n_samples,)
        Modes of the training rows.
    automaton_ : HybridAutomaton
        Laws and transitions, with the hysteresis and the resets of the effects.

    Examples
    --------
    >>> import numpy as np
    >>> from swsysid import EffectRegressor, SwitchingSystemRegressor
    >>> from swsysid.effects import CoulombFriction, PlacedEffect
    >>> v = np.linspace(-1.0, 1.0, 41)[:, None]
    >>> friction = PlacedEffect(CoulombFriction(), place=0, target=0)
    >>> model = EffectRegressor(SwitchingSystemRegressor(n_modes=1), [friction])
    >>> model = model.fit(v, -2.0 * v - 0.3 * np.sign(v))
    >>> round(float(model.effect_coef_[0][0]), 6)
    0.3
    """

    def __init__(self, estimator, effects=()):
        self.estimator = estimator
        self.effects = effects

    @whole_or_nothing
    def fit(self, X, y, *, t=None, groups=None, signals=None, modes=None):
        """Fit the declared model and the effects' coefficients.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_states + n_inputs)
        y : array-like of shape (n_samples,) or (n_samples, n_states)
            Xdot, the measured velocities (next states in discrete time); or one quantity that is
            no rate of the first column, such as a force: no column is a state then.
        t, groups : array-like of shape (n_samples,), default=None
            Times and trajectories, for effects that need them.
        signals : array-like of shape (n_samples, n_signals), default=None
        modes : array-like of shape (n_samples,), int, default=None
            Modes to start from; sought if None.

        Returns
        -------
        self
        """
        check_declared(self.estimator)
        terms = _checked_terms(self.effects)
        given = y
        X, y = rows_and_velocities(self, X, y, reset=True)
        targets, rows = y.reshape(len(y), -1), np.arange(len(X))
        self._one_target, self._n_targets = y.ndim == 1, targets.shape[1]
        records = self._records(X, t, groups, signals, terms)
        start = None if modes is None else _checked_modes(modes, len(X))
        declared = declared_model(self.estimator, records)
        for term in terms:
            term.check_number("mode", MOST_MODES)
            if term.replaced is not None:
                term.check_number("replaced", declared.library(records.X).shape[1])
        records = with_quantity(declared, records, targets, given)
        stated = as_stated(declared, records)
        if stated is not None:
            decoded = with_decoded_modes(stated, records, rows, targets) if start is None else None
            records = replace(records, decoded_modes=start) if decoded is None else decoded
        fit = fit_with_shapes(declared, terms, records, rows, targets, start)
        for term in terms:
            term.check_number("mode", fit.n_modes)
        warn_of_doubts(fit, 3)
        return self._adopt(fit, records.names)

    def predict(self, X, *, t=None, groups=None, signals=None):
        """Velocities, of the shape that `y` had in `fit`."""
        velocity = self.joint_fit_.predict(self._known(X, t, groups, signals))
        return velocity[:, 0] if self._one_target else velocity

    def predict_modes(self, X, *, t=None, groups=None, signals=None):
        """Mode of every sample, shape (n_samples,)."""
        return self.joint_fit_.predict_modes(self._known(X, t, groups, signals))

    def simulate(
        self, x0, t, inputs=None, *, signals=None, input_hold="zero", mode=None, **options
    ):
        """Roll the system out from a state, effects included.

        Parameters
        ----------
        x0 : array-like of shape (n_states,)
        t : array-like of shape (n_times,)
            Increasing times.
        inputs : array-like of shape (n_times, n_inputs), default=None
        signals : array-like of shape (n_times, n_signals), default=None
            Needed if an effect uses them.
        input_hold : {"zero", "linear", "next"}, default="zero"
        mode : int, default=None
            Of an automaton: that in which the rollout starts; None is what its guards tell.
        **options
            Of `SwitchingSystemRegressor.simulate`.

        Returns
        -------
        Trajectory
        """
        done = simulate_with_effects(
            self.joint_fit_,
            x0,
            t,
            inputs,
            signals=signals,
            input_hold=input_hold,
            mode=mode,
            **options,
        )
        return replace(done, names=self._channel_names[: done.x.shape[1]])

    def equations(self, precision=3, format="text"):
        """The law of every mode, with the terms of the effects.

        Parameters
        ----------
        precision : int, default=3
        format : {"text", "latex"}, default="text"

        Returns
        -------
        list of str
            One equation for each mode and state, mode by mode; then one line for each effect of
            a sensor or a clock. ``clip(u, a, b)`` is u held between a and b, ``play(u, w)`` a
            play of width w, ``lag(u, T)`` a first-order lag of time constant T, ``u(t - T)`` a
            delay, ``[v > 0]`` one where v is positive and else zero.
        """
        fit = self.joint_fit_
        check_format(format, precision)
        return laws_with_effects(fit, self._channel_names, precision, format)

    def surface_equations(self, precision=3, format="text"):
        """The surfaces and the modes on their sides, or the guard with memory in their place.

        Parameters
        ----------
        precision : int, default=3
        format : {"text", "latex"}, default="text"

        Returns
        -------
        list of str
            One for each surface (one for all if an effect remembers the mode); then one line for
            each jump of a state.
        """
        fit = self.joint_fit_
        check_format(format, precision)
        return guards_with_effects(fit, self._channel_names, precision, format)

    @property
    def automaton_(self):
        """Laws and transitions as a `HybridAutomaton`.

        A guard that remembers is two guards, one for each direction, and a jump of a state the
        reset of a transition. Effects with columns (`effects_`) act beside its laws: `simulate` has
        both.
        """
        fit = self.joint_fit_
        try:
            return automaton_of_fit(fit)
        except NoAutomatonError as error:
            raise AttributeError(str(error)) from None

    def to_hybrid_system(self):
        """Laws, effects, surfaces and guards as formulas; a lag is a state more."""
        return system_of(self.joint_fit_, self._channel_names)

    # -- refinement ----------------------------------------------------------------------------

    def stated(self) -> StatedModel:
        """Laws and effects as a `StatedModel`, which is what `refinement.refine` refines of it.

        What an effect adds is a term with coefficient one; its coefficients and its nonlinear
        parameters are named parameters, such as ``"v', coulomb friction of v: friction"``.

        Returns
        -------
        StatedModel

        Raises
        ------
        ValueError
            If an effect is no function of the present states and inputs.
        TypeError
            If the declared model is an automaton, or a pipeline.

        Examples
        --------
        >>> import numpy as np
        >>> from swsysid import EffectRegressor, SwitchingSystemRegressor
        >>> from swsysid.effects import CoulombFriction, PlacedEffect
        >>> from swsysid.refinement import refine
        >>> v = np.linspace(-1.0, 1.0, 41)[:, None]
        >>> friction = PlacedEffect(CoulombFriction(), place=0, target=0)
        >>> model = EffectRegressor(SwitchingSystemRegressor(n_modes=1), [friction])
        >>> model = model.fit(v, -1.5 * v - 0.2 * np.sign(v))
        >>> t = np.linspace(0.0, 0.5, 11)
        >>> x = 1.15 * np.exp(-2.0 * t) - 0.15  # x' = -2 x - 0.3
        >>> better = refine(model, {"t": t, "x": x}).model
        >>> better.equations(precision=2)
        ["mode 0: x0' = -2.00 x0 - 0.30 sign(x0)"]
        """
        return as_stated_model(self.joint_fit_, self._channel_names)

    def with_numbers_of(self, stated: StatedModel) -> EffectRegressor:
        """A copy with the numbers of what `stated` has given and a refinement has changed."""
        fit, one = with_numbers_of(self.joint_fit_, stated), self._one_target
        changed = EffectRegressor(self.estimator, fit.terms)
        return changed.around(fit, self, self._channel_names, one_target=one)

    # -- parts ---------------------------------------------------------------------------------

    def around(
        self, fit: JointFit, like: BaseEstimator, names: Sequence[str], one_target: bool = False
    ) -> EffectRegressor:
        """Itself, fitted as `fit` says to data that `like` has seen, to predict all states.

        `names` are those of the channels; with `one_target` predictions have one dimension.
        """
        for name in ("n_features_in_", "feature_names_in_"):
            if hasattr(like, name):
                setattr(self, name, getattr(like, name))
        self._one_target, self._n_targets = one_target, fit.laws.coef.shape[1]
        return self._adopt(fit, names)

    def in_recording(self, number):
        """The model of one of the recordings that it was fitted to, by itself.

        What acted in one recording only acts in no other, and in none that comes alone.

        Parameters
        ----------
        number : int
            From 0, in the order of the recordings or of their names in `groups`.

        Returns
        -------
        EffectRegressor
        """
        fit, one = self.joint_fit_, self._one_target
        places = [term.effect.in_recording(term.place, number) for term in fit.terms]
        acting = [k for k, place in enumerate(places) if place is not None]
        terms = tuple(replace(fit.terms[k], place=places[k]) for k in acting)
        fit = replace(fit, terms=terms, coef=tuple(fit.coef[k] for k in acting))
        changed = EffectRegressor(self.estimator, terms)
        return changed.around(fit, self, self._channel_names, one_target=one)

    @property
    def joint_fit_(self) -> JointFit:
        """The fit of the declared model and the effects, which predicts along whole records."""
        check_fitted(self, "estimator_")
        return self._fit

    def _adopt(self, fit: JointFit, channel_names: Sequence[str]):
        self._fit = replace(fit, doubts=())  # of which the user is warned once
        self._channel_names = tuple(channel_names)
        self.estimator_ = fit.estimator
        self.effects_ = fit.terms
        self.effect_coef_ = fit.coef
        self.modes_ = fit.modes
        return self

    def _known(self, X, t, groups, signals) -> Records:
        return self._records(rows_of(self, X), t, groups, signals, self.effects_)

    def _records(self, X, t, groups, signals, terms: Sequence[PlacedEffect]) -> Records:
        records = make_records(
            X, self._n_targets, t=t, groups=groups, signals=signals, names=column_names(self)
        )
        for term in terms:
            term.check(records)
        return records


def _checked_terms(effects: object) -> tuple[PlacedEffect, ...]:
    if not isinstance(effects, Iterable) or not all(
        isinstance(term, PlacedEffect) and isinstance(term.effect, Effect) for term in effects
    ):
        raise TypeError(
            f"effects={shown(effects)} must be a list of swsysid.effects.PlacedEffect, as "
            "EffectSearchCV finds them."
        )
    return tuple(effects)


def _checked_modes(modes: object, n_samples: int) -> NDArray[np.intp]:
    given = column("modes", modes, n_samples)
    if (given < 0).any() or (given != np.round(given)).any() or (given > MOST_MODES).any():
        raise ValueError("modes must be whole numbers from 0, one for each sample.")
    return given.astype(np.intp)
