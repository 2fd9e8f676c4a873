"""A declared model and effects beside it, fitted together."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from swsysid._data.records import Records
from swsysid._effect_model.declared import Declared, FittedLaws, Modes
from swsysid._effect_model.decoding import modes_of_velocities
from swsysid._effect_model.models import laws_of
from swsysid._effect_model.velocities import (
    as_shown,
    as_they_were,
    fitted_alone,
    libraries,
    on_time,
    sharpened_velocities,
)
from swsysid._journal import step
from swsysid._noise import robust_regression
from swsysid._results import Array, GuardWarning
from swsysid.effects import GuardEffect, PlacedEffect, StructureEffect
from swsysid.effects._placed import corrected, late_records, shaped
from swsysid.metrics._modes import best_matching, contingency

_MOST_SOUGHT = 12  # columns of an effect in the library while modes are sought anew
_SAME_MODES = 1e-3  # share of the rows whose mode may still change when the alternation ends
_DISAGREEING = 0.05  # share of them that a surface between modes told before may mistake


@dataclass(frozen=True)
class JointFit:
    """A fitted declared model, the effects beside it and their coefficients."""

    estimator: object  # as a user has it, fitted to what the effects leave over
    terms: tuple[PlacedEffect, ...]
    coef: tuple[Array, ...]  # of the columns of each term (`PlacedEffect.design`)
    modes: Modes  # of the rows of the fit, from the data
    doubts: tuple[Warning, ...] = ()  # what the declared model had to say of its fit
    quantity: str | None = None  # that the law gives, where it gives no rate

    @property
    def laws(self) -> FittedLaws:
        """The laws of the declared model, and what tells their modes."""
        return laws_of(self.estimator)

    @property
    def n_modes(self) -> int:
        """Number of modes."""
        return len(self.laws.coef)

    @property
    def n_states(self) -> int:
        """Number of states."""
        return int(self.laws.coef.shape[1])

    @property
    def guard(self) -> PlacedEffect | None:
        """The effect that takes the place of the surface, if there is one."""
        return next((term for term in self.terms if isinstance(term.effect, GuardEffect)), None)

    @property
    def remembers(self) -> bool:
        """Whether its modes depend on those of before."""
        guard = self.guard
        if guard is None:
            return False
        assert isinstance(guard.effect, GuardEffect)
        return guard.effect.remembers(*guard.theta)

    def library(self, records: Records) -> Array:
        """Library of the declared model on corrected records, (n_samples, n_features_out)."""
        laws = self.laws
        return np.asarray(laws.feature_map(laws.seen(records.X)))

    def features(self, records: Records, rows: NDArray[np.intp] | None = None) -> Array:
        """The library as the velocities of some rows or all show it."""
        return records.averaged(self.library(records), rows)

    def predict_modes(self, records: Records) -> Modes:
        """Modes along the trajectories."""
        if self.guard is None:
            return self.surface_modes(records)
        return self.guard.switched(corrected(self.terms, records))

    def surface_modes(self, records: Records) -> Modes:
        """Modes according to the declared model alone."""
        return self.laws.modes(corrected(self.terms, records), self._added)

    def first_mode(self, records: Records) -> int | None:
        """The mode in which a rollout along a trajectory begins; None where its state tells it."""
        return None if self.laws.automaton is None else int(self.predict_modes(records)[0])

    def modes_along(self, records: Records, rows: NDArray[np.intp]) -> Modes:
        """Modes of a whole record: on the rows of the fit from the data, elsewhere predicted."""
        modes = self.predict_modes(records)
        modes[rows] = self.modes
        return modes

    def mode_proba(self, records: Records) -> Array:
        """Probability of every mode according to the declared model."""
        return self.laws.probabilities(corrected(self.terms, records))

    def declared_velocities(self, X: Array) -> Array:
        """Velocity in every mode of the declared model alone, (n_modes, n_rows, n_states)."""
        laws = self.laws
        features = laws.feature_map(laws.seen(X))
        return np.asarray(np.matmul(features, laws.coef.transpose(0, 2, 1)))

    def mode_velocities(self, records: Records, rows: NDArray[np.intp] | None = None) -> Array:
        """Velocity in every mode, effects included, (n_modes, n_samples, n_states).

        Of all samples, or of some; as it is recorded, late where its sensor is.
        """
        known = corrected(self.terms, records)
        fields = self._fields(known, rows)
        for term, late in late_records(self.terms, known):
            fields[:, :, term.place] = self._fields(late, rows)[:, :, term.place]
        return fields

    def _fields(self, known: Records, rows: NDArray[np.intp] | None) -> Array:
        """Velocity in every mode on corrected records, at the instants of the samples."""
        X = known.X if rows is None else known.X[rows]
        if known.average is None:
            fields = self.declared_velocities(X)
        else:
            fields = np.einsum("jkf,nf->jnk", self.laws.coef, self.features(known, rows))
        return shaped(self.terms, fields + self._added(known, rows), X)

    def on_time(self, records: Records, rows: NDArray[np.intp], targets: Array) -> Array:
        """Targets of its own rows as they would be if no velocity were late with its state."""
        known, answer = corrected(self.terms, records), targets.copy()
        for term, late in late_records(self.terms, known):
            now, then = (
                self._fields(one, rows)[self.modes, np.arange(len(rows)), term.place]
                for one in (known, late)
            )
            answer[:, term.place] += now - then
        return answer

    def _added(self, known: Records, rows: NDArray[np.intp] | None = None) -> Array:
        """What the effects with columns add in every mode, on corrected records."""
        count = len(known) if rows is None else len(rows)
        fields = np.zeros((self.n_modes, count, known.n_states))
        for term, coef in zip(self.terms, self.coef, strict=True):
            columns = term.columns(known, rows)
            for mode in range(self.n_modes):
                own = term.in_mode(coef, mode, self.n_modes)
                if len(own):
                    fields[mode, :, term.target] += columns @ own
        return fields

    def contributions(self, records: Records) -> Array:
        """What the effects add to the velocities at the instants, shaped like those of all modes.

        The measurement as it should be is part of it.
        """
        declared = self.declared_velocities(records.X)
        return self.mode_velocities(replace(records, average=None)) - declared

    def predict(
        self, records: Records, modes: Modes | None = None, rows: NDArray[np.intp] | None = None
    ) -> Array:
        """Velocities of all samples or of some, shape (n_samples, n_states); modes are of all."""
        modes = self.predict_modes(records) if modes is None else modes
        some = slice(None) if rows is None else rows
        fields, every = self.mode_velocities(records, rows), np.arange(len(modes[some]))
        answer = np.asarray(fields[modes[some], every])
        for term, _ in late_records(self.terms, records):
            then = as_shown(term, records, modes)[some]
            answer[:, term.place] = fields[then, every, term.place]
        return answer

    def most_switched_state(self, features: Array, scale: Array | None = None) -> int:
        """State whose laws differ most between the modes, for some rows of the library.

        In units of `scale`, (n_states,), or of what the terms of each law usually sum up to.
        """
        coef, sizes = self.laws.coef, np.abs(features).mean(axis=0)
        if scale is None:
            scale = np.maximum(np.abs(coef).mean(axis=0) @ sizes, np.finfo(float).tiny)
        return int(np.argmax((np.ptp(coef, axis=0) * sizes).sum(axis=1) / scale))

    def residuals(self, records: Records, rows: NDArray[np.intp], targets: Array) -> Array:
        """What the fit leaves over of the targets of its own rows of a record."""
        fields = self.mode_velocities(records, rows)
        return np.asarray(targets - fields[self.modes, np.arange(len(rows))])


@step
def fit_jointly(
    declared: Declared, terms: Sequence[PlacedEffect], records: Records, rows: NDArray[np.intp],
    targets: Array, modes: Modes | None = None, rounds: int = 4, like: Modes | None = None,
) -> JointFit:  # fmt: skip
    """Alternate between the effects' coefficients, for known modes, and the declared model.

    An effect in the place of a feature (a lag of the input instead of the input) has one gain in
    each mode. What it adds is taken from the velocities before the declared model is fitted to
    the rest; all that tells modes apart that differ in this gain alone would go with it. The
    feature has the gains while the model is fitted, and the fitted laws are restored afterwards.

    Columns with a memory are computed along the whole `records`, of which `rows` with `targets`
    are fitted. Without `modes` to start from they are sought with the effects' columns in the
    library; `like` then are modes to which the numbers in `terms` refer. Where the columns are
    many, each effect then stands there with what it contributes beside these modes.
    """
    terms = tuple(terms)
    for term in terms:
        if isinstance(term.effect, StructureEffect):
            declared = declared.extended(term.effect)
    whole = corrected(terms, records)
    seen = whole.take(rows)
    columns = [term.columns(whole, rows) for term in terms]
    targets = on_time(declared, terms, whole, rows, targets, modes)
    if not any(part.shape[1] for part in columns):
        fitted = fitted_alone(declared, whole, rows, targets, modes)
        no_coef = tuple(np.zeros(0) for _ in terms)
        fit = JointFit(fitted.estimator, terms, no_coef, fitted.modes, fitted.doubts)
        return _of_the_record(fit, whole, rows)
    features, sharp = libraries(declared, whole, rows)
    if modes is None:
        sought = columns
        if like is not None and max(part.shape[1] for part in columns) > _MOST_SOUGHT:
            coef = _effect_coefficients(declared, features, terms, columns, targets, like)
            sought = [
                (term.design(part, like, int(like.max()) + 1) @ values)[:, None]
                for term, part, values in zip(terms, columns, coef, strict=True)
                if len(values)
            ]
        modes = declared.sought(np.column_stack(sought), seen, targets)
        modes = modes if like is None else _matching(modes, like)[modes]
    for _ in range(rounds):
        coef = _effect_coefficients(declared, features, terms, columns, targets, modes)
        replaced = _replaced_laws(terms, coef, sharp, seen, modes)
        rest = targets + np.einsum("nkf,nf->nk", replaced[modes], features)
        for term, part, values in zip(terms, columns, coef, strict=True):
            rest[:, term.target] -= term.design(part, modes, len(replaced)) @ values
        if whole.average is not None:
            rest = sharpened_velocities(declared, rest, features, sharp, modes)
        fitted = declared.fitted(seen, rest, modes)
        order, laws = _matching(modes, fitted.modes), laws_of(fitted.estimator).coef
        for mode, own in enumerate(replaced):
            if order[mode] < len(laws):  # a mode may have been left without rows
                laws[order[mode]] -= own
        terms = tuple(term.renumbered(order) for term in terms)
        before, modes = order[modes], fitted.modes
        if np.mean(before != modes) <= _SAME_MODES:
            break
    coef = _effect_coefficients(declared, features, terms, columns, targets, modes)
    fit = JointFit(fitted.estimator, terms, tuple(coef), modes, fitted.doubts)
    return _of_the_record(fit, whole, rows)


def as_stated(declared: Declared, records: Records) -> JointFit | None:
    """A declared model whose laws are known before any fit; None if they are not."""
    if declared.known is None:
        return None
    return JointFit(declared.known, (), (), np.zeros(len(records), dtype=np.intp))


def with_decoded_modes(
    fit: JointFit, records: Records, rows: NDArray[np.intp], targets: Array
) -> Records:
    """The record with the modes that velocities tell on some of its rows."""
    modes = modes_of_velocities(fit.laws, records, targets, fit.contributions)
    decoded = np.full(len(records), -1)
    decoded[rows] = modes[rows]
    return replace(records, decoded_modes=decoded)


def known_modes(fit: JointFit, records: Records, rows: NDArray[np.intp]) -> Modes:
    """Modes of a whole record from the data, -1 where they say nothing.

    On the rows of the fit they are its own, elsewhere those that measured states show. Where a
    late velocity tells them apart they are brought to the time of the states.
    """
    known = np.full(len(records), -1)
    if records.decoded_modes is not None:
        order = _matching(records.decoded_modes[rows], fit.modes)
        inside = (records.decoded_modes >= 0) & (records.decoded_modes < len(order))
        known[inside] = order[records.decoded_modes[inside]]
        known[known >= fit.n_modes] = -1  # a mode that a fit has lost
    known[rows] = fit.modes
    for term, _ in late_records(fit.terms, records):
        if term.place == fit.most_switched_state(fit.library(records)):
            known = as_they_were(term, records, known)
    return known


def with_decoded_surface(fit: JointFit, records: Records, rows: NDArray[np.intp]) -> JointFit:
    """The fit with a surface between all modes that measured states tell, those of `rows` or not.

    The rows of a recording are a few from the middle of its stays, which say little of where the
    modes change. The fit keeps its own surface where the modes that it has itself contradict this.
    """
    # One more mode is in nothing that was told before it was found.
    last = (
        -1
        if records.average is None or records.decoded_modes is None
        else records.decoded_modes.max()
    )
    if last != fit.n_modes - 1 or fit.n_modes == 1:
        return fit
    known = known_modes(fit, records, rows)
    sure = known >= 0
    if np.all(fit.surface_modes(records)[sure] == known[sure]):
        return fit
    X = corrected(fit.terms, records).X
    redrawn = replace(fit, estimator=fit.laws.with_surface_between(X[sure], known[sure]))
    # Modes that were told by laws without an effect may be others than those that it leaves.
    own, others = (np.mean(one.surface_modes(records)[rows] != fit.modes) for one in (fit, redrawn))
    return redrawn if others <= own + _DISAGREEING else fit


def warn_of_doubts(fit: JointFit, stacklevel: int) -> None:
    """Warn of what the declared model warned of in this fit, from `stacklevel` frames above."""
    # That the modes are no function of the state is no doubt where a guard remembers.
    for doubt in fit.doubts:
        if fit.guard is None or not isinstance(doubt, GuardWarning):
            warnings.warn(doubt, stacklevel=stacklevel + 1)


# -- the effects -----------------------------------------------------------------------------------


def _of_the_record(fit: JointFit, records: Records, rows: NDArray[np.intp]) -> JointFit:
    """The fit with the guards that remember found anew for its modes, and what its law gives."""
    known, terms = known_modes(fit, records, rows), []
    for term in fit.terms:
        if isinstance(term.effect, GuardEffect):
            guard, theta = term.effect.refitted(term.place, records, known)
            term = replace(term, place=guard, theta=theta)
        terms.append(term)
    return replace(fit, terms=tuple(terms), quantity=records.quantity)


def _effect_coefficients(
    declared: Declared,
    features: Array,
    terms: Sequence[PlacedEffect],
    columns: Sequence[Array],
    targets: Array,
    modes: Modes,
) -> list[Array]:
    """Robust least squares of the library in each mode and of the effects, state by state."""
    coef: list[Array] = [np.zeros(0) for _ in columns]
    n_modes = int(modes.max()) + 1
    support = declared.support(n_modes, targets.shape[1], features.shape[1])
    for target in range(targets.shape[1]):
        acting = [place for place, term in enumerate(terms) if term.target == target]
        if not acting:
            continue
        own = ((support[mode, target], modes == mode) for mode in np.unique(modes))
        blocks = np.column_stack([features[:, some] * rows[:, None] for some, rows in own])
        parts = [terms[place].design(columns[place], modes, n_modes) for place in acting]
        design = np.column_stack([blocks, *parts])
        prior = block_diag(
            np.zeros((0, blocks.shape[1])), *(terms[place].prior(n_modes) for place in acting)
        )
        solved = robust_regression(design, targets[:, target], declared.robust, prior)
        ends = np.cumsum([part.shape[1] for part in parts])
        found = np.split(solved[blocks.shape[1] :], ends[:-1])
        for place, values in zip(acting, found, strict=True):
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
