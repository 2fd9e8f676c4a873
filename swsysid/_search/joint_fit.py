"""A declared model and effects beside it, fitted together."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning
from sklearn.utils import check_random_state

from swsysid._checks.parameters import shown
from swsysid._data.features import FeatureMap
from swsysid._data.records import Records
from swsysid._data.rows import CanonicalRows, canonical_rows
from swsysid._identification.identify import identify
from swsysid._identification.setup import build_problem, build_search
from swsysid._noise import robust_regression
from swsysid._pipelines import switching_step, with_parameters
from swsysid._results import Array, GuardWarning, IdentificationWarning, MisfitWarning
from swsysid._search.lending import loans
from swsysid._search.trials import PlacedEffect

__all__ = [
    "JointFit",
    "check_declared",
    "corrected",
    "fit_jointly",
    "tell_doubts",
]

Modes = NDArray[np.intp]

_ROUNDS = 4
_SETTLED = 1e-3  # share of the rows whose mode may still change
_DOUBTS = (ConvergenceWarning, IdentificationWarning)


@dataclass(frozen=True)
class JointFit:
    """A fitted declared model, the effects beside it and their coefficients.

    Attributes
    ----------
    estimator : fitted estimator
        Fitted to what the effects leave over.
    terms : tuple of PlacedEffect
    coef : tuple of ndarray
        Coefficients of the columns of each term (`PlacedEffect.design`).
    modes : ndarray of shape (n_samples,), int
        Modes of the rows of the fit, from the data.
    doubts : tuple of Warning
        What the declared model had to say of its fit.
    """

    estimator: Any
    terms: tuple[PlacedEffect, ...]
    coef: tuple[Array, ...]
    modes: Modes
    doubts: tuple[Warning, ...] = ()

    @property
    def switching(self) -> Any:
        """The switching regressor, the last step if the estimator is a pipeline."""
        return switching_step(self.estimator)[1]

    @property
    def n_modes(self) -> int:
        """Number of modes."""
        return int(self.switching.n_modes_)

    def features(self, records: Records) -> Array:
        """Library of the declared model, (n_samples, n_features_out)."""
        transform, switching = switching_step(self.estimator)
        return switching._feature_map(transform(records.X))

    def predict_modes(self, records: Records) -> Modes:
        """Modes along the trajectories."""
        for term in self.terms:
            if term.effect.remembers:
                seen = corrected(self.terms, records)
                return term.effect.switched(seen, term.place, *term.theta)
        return self.estimator_modes(records)

    def estimator_modes(self, records: Records) -> Modes:
        """Modes according to the surface alone."""
        transform, switching = switching_step(self.estimator)
        return switching.predict_modes(transform(corrected(self.terms, records).X))

    def mode_proba(self, records: Records) -> Array:
        """Probability of every mode according to the surface."""
        transform, switching = switching_step(self.estimator)
        return switching.predict_mode_proba(transform(corrected(self.terms, records).X))

    def mode_velocities(self, records: Records) -> Array:
        """Velocity in every mode, effects included, (n_modes, n_samples, n_states)."""
        seen = corrected(self.terms, records)
        transform, switching = switching_step(self.estimator)
        fields = switching.mode_velocities(transform(seen.X))
        every = [np.full(len(records), mode) for mode in range(self.n_modes)]
        return np.stack(
            [field + self.contribution(seen, m) for field, m in zip(fields, every, strict=True)]
        )

    def predict(self, records: Records, modes: Modes | None = None) -> Array:
        """Velocities, shape (n_samples, n_states)."""
        modes = self.predict_modes(records) if modes is None else modes
        return self.mode_velocities(records)[modes, np.arange(len(modes))]

    def contribution(self, records: Records, modes: Modes) -> Array:
        """What the effects add to the velocities, shape (n_samples, n_states)."""
        added = np.zeros((len(records), records.n_states))
        for term, coef in zip(self.terms, self.coef, strict=True):
            columns = term.effect.columns(records, term.place, *term.theta)
            added[:, term.target] += term.design(columns, modes, self.n_modes) @ coef
        return added


def check_declared(estimator: Any) -> None:
    """Refuse a declared model that is no switching regressor, and one that is a class."""
    regressor = None if isinstance(estimator, type) else switching_step(estimator)[1]
    if isinstance(regressor, type) or not hasattr(regressor, "mode_velocities"):
        raise TypeError(
            f"estimator={shown(estimator)} must be a SwitchingSystemRegressor or a pipeline "
            "that ends in one."
        )


def fit_jointly(
    estimator: Any,
    terms: Sequence[PlacedEffect],
    records: Records,
    rows: NDArray[np.intp],
    targets: Array,
    modes: Modes | None = None,
    rounds: int = _ROUNDS,
    like: Modes | None = None,
) -> JointFit:
    """Alternate between the effects' coefficients, for known modes, and the declared model.

    Parameters
    ----------
    estimator : estimator
        The declared model, not fitted.
    terms : sequence of PlacedEffect
    records : Records
        The whole record, along which columns with a memory are computed.
    rows : ndarray
        Rows of the record to fit.
    targets : ndarray of shape (n_rows, n_states)
    modes : ndarray of shape (n_rows,), default=None
        Modes to start from; sought with the effects' columns in the library if None.
    rounds : int, default=4
        Most alternations.
    like : ndarray of shape (n_rows,), default=None
        Modes to which the numbers in `terms` refer, where `modes` are sought.
    """
    terms = tuple(terms)
    for term in terms:
        estimator = term.effect.extended(estimator)
    seen = corrected(terms, records)
    columns = [term.effect.columns(seen, term.place, *term.theta)[rows] for term in terms]
    whole, seen = seen, seen.take(rows)
    if not any(part.shape[1] for part in columns):
        fitted, doubts = _fitted(estimator, seen, targets, modes)
        nothing = tuple(np.zeros(0) for _ in terms)
        return _settled(JointFit(fitted, terms, nothing, _modes_of(fitted), doubts), whole, rows)
    if modes is None:
        modes = modes_with_columns(estimator, np.column_stack(columns), seen, targets)
        modes = modes if like is None else _matching(modes, like)[modes]
    features = _library_values(estimator, seen)
    robust = switching_step(estimator)[1].loss != "squared"
    for _ in range(rounds):
        coef = _effect_coefficients(features, robust, terms, columns, targets, modes)
        rest = targets - _added(terms, columns, coef, modes, targets.shape)
        lent = loans(terms, coef, features, seen, int(modes.max()) + 1)
        for loan in lent:
            rest[:, loan.target] += loan.values(features, modes)
        fitted, doubts = _fitted(estimator, seen, rest, modes)
        order = _matching(modes, _modes_of(fitted))
        for loan in lent:
            loan.give_back(switching_step(fitted)[1].coef_, order)
        terms = tuple(_renamed(term, order) for term in terms)
        before, modes = order[modes], _modes_of(fitted)
        if np.mean(before != modes) <= _SETTLED:
            break
    coef = _effect_coefficients(features, robust, terms, columns, targets, modes)
    return _settled(JointFit(fitted, terms, tuple(coef), modes, doubts), whole, rows)


def _settled(fit: JointFit, records: Records, rows: NDArray[np.intp]) -> JointFit:
    """The fit with the guards that remember found anew for its modes."""
    terms = list(fit.terms)
    for place, term in enumerate(terms):
        if term.effect.remembers:
            guard, band = term.effect.settled(term.place, records, rows, fit.modes)
            terms[place] = replace(term, place=guard, theta=band)
    return replace(fit, terms=tuple(terms))


def modes_with_columns(estimator: Any, columns: Array, records: Records, targets: Array) -> Modes:
    """Modes of an identification whose library has the effects' columns as well."""
    switching = switching_step(estimator)[1]
    X, feature_map = _library(estimator, records.X)
    groups = np.zeros(len(X), np.intp) if records.groups is None else records.groups
    rows = canonical_rows(np.column_stack([X, columns]), targets, groups)
    extended, *rest = rows.arrays
    plain = CanonicalRows((extended[:, : X.shape[1]], *rest), rows.weight, rows.inverse)
    problem = build_problem(switching, plain, feature_map)
    problem = replace(
        problem, features=np.column_stack([problem.features, extended[:, X.shape[1] :]])
    )
    found = identify(
        problem, build_search(switching, plain), check_random_state(switching.random_state)
    )
    return rows.restore(found.best.modes)


def _library_values(estimator: Any, records: Records) -> Array:
    """Library of an estimator not fitted, (n_samples, n_features_out)."""
    X, feature_map = _library(estimator, records.X)
    return feature_map(X)


def _library(estimator: Any, X: Array) -> tuple[Array, FeatureMap]:
    """What the switching regressor of an estimator not fitted would see, and its library."""
    if len(getattr(estimator, "steps", ())) > 1:
        X = clone(estimator[:-1]).fit(X).transform(X)
    names = [f"x{column}" for column in range(X.shape[1])]
    return X, FeatureMap(switching_step(estimator)[1].feature_library, X, names)


def corrected(terms: Sequence[PlacedEffect], records: Records) -> Records:
    """The records as they would be without the effects of sensors and clocks."""
    for term in terms:
        records = term.effect.corrected(records, term.place, *term.theta)
    return records


def _fitted(
    estimator: Any, records: Records, targets: Array, modes: Modes | None
) -> tuple[Any, tuple[Warning, ...]]:
    """The declared model, from known modes if there are any, and what it warns of.

    A search fits it often and on data that lack something: only the fit that is handed over may
    tell the user of its doubts; see `tell_doubts`.
    """
    declared = switching_step(estimator)[1].get_params(deep=False)
    copy = clone(estimator)
    if modes is not None and declared["init"] == "auto":
        n_modes = int(modes.max()) + 1 if declared["n_modes"] == "auto" else declared["n_modes"]
        copy = with_parameters(estimator, init=modes, n_modes=n_modes)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        copy.fit(records.X, targets)
    switching_step(copy)[1].set_params(init=declared["init"], n_modes=declared["n_modes"])
    # What the model leaves over is what the search is for, so that is no doubt about its fit.
    said = (one for one in caught if not issubclass(one.category, MisfitWarning))
    doubts = (one.message for one in said if issubclass(one.category, _DOUBTS))
    return copy, tuple(one for one in doubts if isinstance(one, Warning))


def tell_doubts(fit: JointFit, stacklevel: int) -> None:
    """Warn of what the declared model warned of in this fit, from `stacklevel` frames above.

    That the modes are no function of the state is no doubt where a guard remembers.
    """
    remembered = any(term.effect.remembers for term in fit.terms)
    for doubt in fit.doubts:
        if not (remembered and isinstance(doubt, GuardWarning)):
            warnings.warn(doubt, stacklevel=stacklevel + 1)


def _modes_of(fitted: Any) -> Modes:
    return switching_step(fitted)[1].modes_


def _effect_coefficients(features, robust, terms, columns, targets, modes) -> list[Array]:
    """Robust least squares of the library in each mode and of the effects, state by state."""
    blocks = np.column_stack([features * (modes == mode)[:, None] for mode in np.unique(modes)])
    coef: list[Array] = [np.zeros(0) for _ in columns]
    n_modes = int(modes.max()) + 1
    for target in range(targets.shape[1]):
        acting = [place for place, term in enumerate(terms) if term.target == target]
        if not acting:
            continue
        parts = [terms[place].design(columns[place], modes, n_modes) for place in acting]
        solved = robust_regression(np.column_stack([blocks, *parts]), targets[:, target], robust)
        start = blocks.shape[1]
        for place, part in zip(acting, parts, strict=True):
            coef[place] = solved[start : start + part.shape[1]]
            start += part.shape[1]
    return coef


def _added(terms, columns, coef, modes, shape) -> Array:
    added, n_modes = np.zeros(shape), int(modes.max()) + 1
    for term, part, values in zip(terms, columns, coef, strict=True):
        added[:, term.target] += term.design(part, modes, n_modes) @ values
    return added


def _matching(before: Modes, after: Modes) -> Modes:
    """New number of every old mode."""
    n_modes = int(max(before.max(), after.max())) + 1
    shared = np.zeros((n_modes, n_modes))
    np.add.at(shared, (before, after), 1.0)
    return linear_sum_assignment(-shared)[1]


def _renamed(term: PlacedEffect, order: Modes) -> PlacedEffect:
    """The term with its modes by their new numbers."""
    place = term.effect.renamed(term.place, order)
    mode = term.mode
    if mode is not None and mode < len(order):  # not of a mode that is there no more
        mode = int(order[mode])
    return replace(term, place=place, mode=mode)
