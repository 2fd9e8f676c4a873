"""A declared model and effects beside it, fitted together."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator, clone
from sklearn.exceptions import ConvergenceWarning
from sklearn.utils import check_random_state

from swsysid._checks.parameters import shown
from swsysid._data.features import FeatureMap
from swsysid._data.matching import best_matching, contingency
from swsysid._data.records import Records
from swsysid._data.rows import CanonicalRows, canonical_rows
from swsysid._identification.identify import identify
from swsysid._identification.setup import build_problem, build_search
from swsysid._noise import robust_regression
from swsysid._pipelines import steps_before, switching_step, with_parameters
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._results import Array, GuardWarning, IdentificationWarning, MisfitWarning
from swsysid._simulation.model import SwitchingModel
from swsysid.effects import GuardEffect, PlacedEffect, StructureEffect
from swsysid.effects._placed import corrected

Modes = NDArray[np.intp]

_SHARPENINGS = 2  # of velocities that a filter has made, each from better modes
_SAME_MODES = 1e-3  # share of the rows whose mode may still change when the alternation ends
_DOUBTS = (ConvergenceWarning, IdentificationWarning)


@dataclass(frozen=True)
class JointFit:
    """A fitted declared model, the effects beside it and their coefficients."""

    estimator: BaseEstimator  # fitted to what the effects leave over
    terms: tuple[PlacedEffect, ...]
    coef: tuple[Array, ...]  # of the columns of each term (`PlacedEffect.design`)
    modes: Modes  # of the rows of the fit, from the data
    doubts: tuple[Warning, ...] = ()  # what the declared model had to say of its fit

    @property
    def switching(self) -> SwitchingSystemRegressor:
        """The switching regressor, the last step if the estimator is a pipeline."""
        regressor: SwitchingSystemRegressor = switching_step(self.estimator)[1]
        return regressor

    @property
    def model(self) -> SwitchingModel:
        """The laws and surfaces of the switching regressor."""
        return self.switching.switching_model

    @property
    def n_modes(self) -> int:
        """Number of modes."""
        return int(self.switching.n_modes_)

    @property
    def guard(self) -> PlacedEffect | None:
        """The effect that takes the place of the surface, if there is one."""
        return next((term for term in self.terms if isinstance(term.effect, GuardEffect)), None)

    def seen(self, records: Records) -> Array:
        """States and inputs as the switching regressor sees them, measurement corrected."""
        transform, _ = switching_step(self.estimator)
        return np.asarray(transform(corrected(self.terms, records).X))

    def library(self, records: Records) -> Array:
        """Library of the declared model on corrected records, (n_samples, n_features_out)."""
        transform, _ = switching_step(self.estimator)
        return np.asarray(self.model.feature_map(transform(records.X)))

    def features(self, records: Records) -> Array:
        """The library as the velocities show it."""
        return records.averaged(self.library(records))

    def predict_modes(self, records: Records) -> Modes:
        """Modes along the trajectories."""
        if self.guard is None:
            return self.surface_modes(records)
        return self.guard.switched(corrected(self.terms, records))

    def surface_modes(self, records: Records) -> Modes:
        """Modes according to the surface alone."""
        return self.switching.predict_modes(self.seen(records))

    def modes_along(self, records: Records, rows: NDArray[np.intp]) -> Modes:
        """Modes of a whole record: on the rows of the fit from the data, elsewhere predicted."""
        modes = self.predict_modes(records)
        modes[rows] = self.modes
        return modes

    def mode_proba(self, records: Records) -> Array:
        """Probability of every mode according to the surface."""
        return np.asarray(self.switching.predict_mode_proba(self.seen(records)))

    def mode_velocities(self, records: Records) -> Array:
        """Velocity in every mode, effects included, (n_modes, n_samples, n_states)."""
        known = corrected(self.terms, records)
        if records.average is None:
            fields = np.array(self.switching.mode_velocities(self.seen(records)))
        else:
            fields = np.einsum("jkf,nf->jnk", self.switching.coef_, self.features(known))
        for term, coef in zip(self.terms, self.coef, strict=True):
            columns = term.columns(known)
            for mode in range(self.n_modes):
                own = term.in_mode(coef, mode, self.n_modes)
                if len(own):
                    fields[mode, :, term.target] += columns @ own
        return fields

    def contributions(self, records: Records) -> Array:
        """What the effects add to the velocities at the instants, shaped like those of all modes.

        The measurement as it should be is part of it.
        """
        transform, _ = switching_step(self.estimator)
        declared = np.array(self.switching.mode_velocities(np.asarray(transform(records.X))))
        if not self.terms:
            return np.zeros_like(declared)
        return self.mode_velocities(replace(records, average=None)) - declared

    def predict(self, records: Records, modes: Modes | None = None) -> Array:
        """Velocities, shape (n_samples, n_states)."""
        modes = self.predict_modes(records) if modes is None else modes
        return np.asarray(self.mode_velocities(records)[modes, np.arange(len(modes))])

    def residuals(self, records: Records, rows: NDArray[np.intp], targets: Array) -> Array:
        """What the fit leaves over of the targets of its own rows of a record."""
        return targets - self.predict(records, self.modes_along(records, rows))[rows]


def check_declared(estimator: object) -> None:
    """Refuse a declared model that is no switching regressor, and one that is a class."""
    regressor = None if isinstance(estimator, type) else switching_step(estimator)[1]
    if isinstance(regressor, type) or not hasattr(regressor, "mode_velocities"):
        raise TypeError(
            f"estimator={shown(estimator)} must be a SwitchingSystemRegressor or a pipeline "
            "that ends in one."
        )


def fit_jointly(
    estimator: BaseEstimator,
    terms: Sequence[PlacedEffect],
    records: Records,
    rows: NDArray[np.intp],
    targets: Array,
    modes: Modes | None = None,
    rounds: int = 4,
    like: Modes | None = None,
) -> JointFit:
    """Alternate between the effects' coefficients, for known modes, and the declared model.

    An effect in the place of a feature (a lag of the input instead of the input) has one gain in
    each mode. What it adds is taken from the velocities before the declared model is fitted to
    the rest; all that tells modes apart that differ in this gain alone would go with it. The
    feature has the gains while the model is fitted, and the fitted laws are restored afterwards.

    Columns with a memory are computed along the whole `records`, of which `rows` with `targets`
    are fitted. Without `modes` to start from they are sought with the effects' columns in the
    library; `like` then are modes to which the numbers in `terms` refer.
    """
    terms = tuple(terms)
    for term in terms:
        if isinstance(term.effect, StructureEffect):
            estimator = term.effect.extended(estimator)
    whole = corrected(terms, records)
    seen = whole.take(rows)
    columns = [term.columns(whole)[rows] for term in terms]
    if not any(part.shape[1] for part in columns):
        fitted, doubts = _fitted(estimator, seen, targets, modes)
        if whole.average is not None:
            blurred, sharp = _libraries(estimator, whole, rows)
            for _ in range(_SHARPENINGS):
                modes = _modes_of(fitted)
                at_instants = _sharpened(targets, blurred, sharp, modes)
                fitted, doubts = _fitted(estimator, seen, at_instants, modes)
        no_coef = tuple(np.zeros(0) for _ in terms)
        return _with_guards(
            JointFit(fitted, terms, no_coef, _modes_of(fitted), doubts), whole, rows
        )
    if modes is None:
        modes = _modes_with_columns(estimator, np.column_stack(columns), seen, targets)
        modes = modes if like is None else _matching(modes, like)[modes]
    features, sharp = _libraries(estimator, whole, rows)
    robust = switching_step(estimator)[1].loss != "squared"
    for _ in range(rounds):
        coef = _effect_coefficients(features, robust, terms, columns, targets, modes)
        replaced = _replaced_laws(terms, coef, sharp, seen, modes)
        rest = targets + np.einsum("nkf,nf->nk", replaced[modes], features)
        for term, part, values in zip(terms, columns, coef, strict=True):
            rest[:, term.target] -= term.design(part, modes, len(replaced)) @ values
        if whole.average is not None:
            rest = _sharpened(rest, features, sharp, modes)
        fitted, doubts = _fitted(estimator, seen, rest, modes)
        order, laws = _matching(modes, _modes_of(fitted)), switching_step(fitted)[1].coef_
        for mode, own in enumerate(replaced):
            if order[mode] < len(laws):  # a mode may have been left without rows
                laws[order[mode]] -= own
        terms = tuple(term.renumbered(order) for term in terms)
        before, modes = order[modes], _modes_of(fitted)
        if np.mean(before != modes) <= _SAME_MODES:
            break
    coef = _effect_coefficients(features, robust, terms, columns, targets, modes)
    return _with_guards(JointFit(fitted, terms, tuple(coef), modes, doubts), whole, rows)


def known_modes(fit: JointFit, records: Records, rows: NDArray[np.intp]) -> Modes:
    """Modes of a whole record from the data, -1 where they say nothing.

    On the rows of the fit they are its own, elsewhere those that measured states have told.
    """
    known = np.full(len(records), -1)
    if records.told is not None:
        order = _matching(records.told[rows], fit.modes)
        inside = (records.told >= 0) & (records.told < len(order))
        known[inside] = order[records.told[inside]]
    known[rows] = fit.modes
    return known


def warn_of_doubts(fit: JointFit, stacklevel: int) -> None:
    """Warn of what the declared model warned of in this fit, from `stacklevel` frames above."""
    # That the modes are no function of the state is no doubt where a guard remembers.
    for doubt in fit.doubts:
        if fit.guard is None or not isinstance(doubt, GuardWarning):
            warnings.warn(doubt, stacklevel=stacklevel + 1)


# -- the declared model ----------------------------------------------------------------------------


def _fitted(
    estimator: BaseEstimator, records: Records, targets: Array, modes: Modes | None
) -> tuple[BaseEstimator, tuple[Warning, ...]]:
    """The declared model, from known modes if there are any, and what it warns of."""
    # A search fits it often and on data that lack something: only the fit that is handed over may
    # warn the user; see `warn_of_doubts`.
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
    doubts = (
        one.message
        for one in caught
        if issubclass(one.category, _DOUBTS) and not issubclass(one.category, MisfitWarning)
    )
    return copy, tuple(one for one in doubts if isinstance(one, Warning))


def _modes_of(fitted: BaseEstimator) -> Modes:
    modes: Modes = switching_step(fitted)[1].modes_
    return modes


def _modes_with_columns(
    estimator: BaseEstimator, columns: Array, records: Records, targets: Array
) -> Modes:
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


def _libraries(
    estimator: BaseEstimator, whole: Records, rows: NDArray[np.intp]
) -> tuple[Array, Array]:
    """The library on some rows as the velocities show it, and as it is at their instants."""
    if whole.average is None:
        library, feature_map = _library(estimator, whole.X[rows])
        features = feature_map(library)
        return features, features
    library, feature_map = _library(estimator, whole.X)
    features = feature_map(library)
    return whole.averaged(features)[rows], features[rows]


def _sharpened(targets: Array, blurred: Array, sharp: Array, modes: Modes) -> Array:
    """Velocities as a filter shows them with the laws at the instants of the rows instead.

    The declared model knows its library at the instants only.
    """
    answer = targets.copy()
    for mode in np.unique(modes):
        rows = modes == mode
        for target in range(targets.shape[1]):
            law = robust_regression(blurred[rows], targets[rows, target])
            answer[rows, target] += (sharp[rows] - blurred[rows]) @ law
    return answer


def _library(estimator: BaseEstimator, X: Array) -> tuple[Array, FeatureMap]:
    """What the switching regressor of an estimator not fitted would see, and its library."""
    before = steps_before(estimator)
    X = X if before is None else clone(before).fit(X).transform(X)
    names = [f"x{column}" for column in range(X.shape[1])]
    return X, FeatureMap(switching_step(estimator)[1].feature_library, X, names)


# -- the effects -----------------------------------------------------------------------------------


def _with_guards(fit: JointFit, records: Records, rows: NDArray[np.intp]) -> JointFit:
    """The fit with the guards that remember found anew for its modes."""
    known, terms = known_modes(fit, records, rows), []
    for term in fit.terms:
        if isinstance(term.effect, GuardEffect):
            guard, theta = term.effect.refitted(term.place, records, known)
            term = replace(term, place=guard, theta=theta)
        terms.append(term)
    return replace(fit, terms=tuple(terms))


def _effect_coefficients(
    features: Array,
    robust: bool,
    terms: Sequence[PlacedEffect],
    columns: Sequence[Array],
    targets: Array,
    modes: Modes,
) -> list[Array]:
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
        ends = np.cumsum([part.shape[1] for part in parts])
        own = np.split(solved[blocks.shape[1] :], ends[:-1])
        for place, values in zip(acting, own, strict=True):
            coef[place] = values
    return coef


def _replaced_laws(
    terms: Sequence[PlacedEffect],
    coef: Sequence[Array],
    features: Array,
    records: Records,
    modes: Modes,
) -> Array:
    """Laws (n_modes, n_states, n_features) in which replaced features have the effects' gains."""
    n_modes = int(modes.max()) + 1
    laws = np.zeros((n_modes, records.n_states, features.shape[1]))
    for term, values in zip(terms, coef, strict=True):
        if term.replaced is not None:
            column, channel = features[:, term.replaced], records.channel(int(term.place))
            unit = float(column @ channel) / max(float(column @ column), 1e-300)
            gains = values.reshape(n_modes, -1).sum(axis=1)
            laws[:, term.target, term.replaced] += unit * gains
    return laws


def _matching(before: Modes, after: Modes) -> Modes:
    """New number of every old mode."""
    return best_matching(contingency(before, after))[1]
