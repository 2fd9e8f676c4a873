"""A model with effects as a stated one, whose numbers rollouts can refine, and back.

What an effect adds to a law is a term with coefficient one; its own coefficients and its nonlinear
parameters are named parameters of that term.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from swsysid._effect_model.declared import SwitchingLaws
from swsysid._effect_model.joint_fit import JointFit
from swsysid._effect_model.models import laws_of
from swsysid._pipelines import steps_before
from swsysid._results import Array
from swsysid._simulation.inputs import trajectory_records
from swsysid._surfaces.surface import is_linear
from swsysid.effects import PlacedEffect, StructureEffect, UnmeasuredDisturbance
from swsysid.effects._placed import n_signals
from swsysid.refinement import ParametricLibrary, StatedModel
from swsysid.refinement._parameters import fitted_and_free

_ROWS_FOR_NAMES = 16  # of a record that is there for the names of parameters alone


@dataclass(frozen=True)
class _Part:
    """What an effect adds with one set of coefficients: in one mode, or alike in several."""

    place: int  # of the effect among those of the fit
    modes: tuple[int, ...]  # in which it acts
    own: slice  # its coefficients among those of the effect
    coefficients: tuple[str, ...]  # names of these
    theta: tuple[str, ...]  # names of the nonlinear parameters, which parts may share
    title: str

    @property
    def names(self) -> tuple[str, ...]:
        """All its parameters."""
        return self.coefficients + self.theta


class LawsAndEffects(ParametricLibrary):
    """The library of the laws of a fit, then what each effect adds.

    Parameters
    ----------
    joint : JointFit
    columns : sequence of str
        Names of the states, then of the inputs.
    parameters : dict of str to float, default=None
        Coefficients and nonlinear parameters of the effects; None means those of the fit.
    """

    def __init__(
        self,
        joint: JointFit,
        columns: Sequence[str],
        parameters: Mapping[str, float] | None = None,
    ):
        self.joint = joint
        self.columns = columns
        self.parameters = parameters

    def fit(self, X, y=None):
        """Nothing: all of it is known."""
        return self

    def evaluate(self, X: Array, parameters: Mapping[str, ArrayLike]) -> Array:
        laws, rows = self.joint.laws, np.zeros(len(X))
        records = trajectory_records(X, self.joint.n_states, rows, np.empty((len(X), 0)))
        added = []
        for part in self.parts:
            term = self.joint.terms[part.place]
            given = [np.broadcast_to(parameters[name], len(X)) for name in part.names]
            values = np.column_stack([*given, rows])  # one column more, so that there is one
            n_coef, n_all = len(part.coefficients), len(part.names)
            columns = np.empty((len(X), n_coef))
            every, which = np.unique(values[:, n_coef:n_all], axis=0, return_inverse=True)
            for number, theta in enumerate(every):
                own = np.flatnonzero(which.ravel() == number)
                moved = replace(term, theta=tuple(theta.tolist()))
                columns[own] = moved.columns(records.take(own))
            added.append(np.sum(columns * values[:, :n_coef], axis=1))
        return np.column_stack([laws.feature_map.at_rows(laws.seen(X)), *added])

    def get_feature_names_out(self, input_features=None):
        """Names of the terms of the laws, then of what the effects add."""
        laws = self.joint.laws
        names = laws.column_names(self.columns) or list(laws.feature_map.names_in)
        own = [part.title for part in self.parts]
        return np.array([*laws.feature_map.names(names), *own], dtype=object)

    @cached_property
    def parts(self) -> list[_Part]:
        """What the effects add, in the order of the terms."""
        return [
            part
            for place, term in enumerate(self.joint.terms)
            if term.effect.terms
            for part in _parts(self.joint, place, self.columns)
        ]

    @property
    def values(self) -> dict[str, float]:
        """Parameters of the fit by their names."""
        values: dict[str, float] = {}
        for part in self.parts:
            numbers = [*self.joint.coef[part.place][part.own], *self.joint.terms[part.place].theta]
            values |= dict(zip(part.names, map(float, numbers), strict=True))
        return values


def as_stated_model(fit: JointFit, names: Sequence[str]) -> StatedModel:
    """Laws and effects of a fit as a `StatedModel`; `names` are those of the channels."""
    _refuse_what_remembers(fit, names)
    laws = fit.laws
    assert isinstance(laws, SwitchingLaws)
    columns = list(names[: laws.n_columns])
    library = LawsAndEffects(fit, columns)
    library.set_params(parameters=library.values)
    effects = np.zeros((*laws.coef.shape[:2], len(library.parts)))
    for number, part in enumerate(library.parts):
        effects[list(part.modes), fit.terms[part.place].target, number] = 1.0
    coef = np.concatenate([laws.coef, effects], axis=2)
    fixed = np.zeros(effects.shape, dtype=bool)
    free = np.concatenate([fitted_and_free(laws.coef), fixed], axis=2)
    return StatedModel(
        library,
        coef,
        states=columns[: fit.n_states],
        inputs=columns[fit.n_states :],
        surface=laws.switching.switching_model.surface if fit.n_modes > 1 else None,
        free=free,
        discrete_time=laws.discrete_time,
    )


def with_numbers_of(fit: JointFit, stated: StatedModel) -> JointFit:
    """The fit with the numbers of what `as_stated_model` has made of it."""
    library = stated.feature_map.library
    assert isinstance(library, LawsAndEffects)
    given = dict(library.parameters or {})
    estimator = copy.deepcopy(fit.estimator)
    laws = laws_of(estimator)
    assert isinstance(laws, SwitchingLaws)
    laws.switching.coef_ = stated.coef_[:, :, : laws.coef.shape[2]].copy()
    own, other = laws.switching.switching_model.surface, stated.surface
    if fit.n_modes > 1 and is_linear(own) and is_linear(other):
        own.use_coef(other.linear_form(laws.n_columns).coef)
    coef, terms = [values.copy() for values in fit.coef], list(fit.terms)
    for part in library.parts:
        coef[part.place][part.own] = [given[name] for name in part.coefficients]
        theta = tuple(given[name] for name in part.theta)
        terms[part.place] = replace(terms[part.place], theta=theta)
    return replace(fit, estimator=estimator, terms=tuple(terms), coef=tuple(coef))


def _parts(fit: JointFit, place: int, names: Sequence[str]) -> Iterator[_Part]:
    term, n_modes = fit.terms[place], fit.n_modes
    listed, width = list(term.effect.terms), len(term.effect.terms)
    label = term.label([*names])
    title = f"{names[term.target]}', {term.effect.kind.replace('_', ' ')} of {label}"
    # where it stands in the record says nothing about the names of what is nonlinear
    known = np.linspace(-1.0, 1.0, _ROWS_FOR_NAMES)
    X = np.tile(known[:, None], (1, len(names)))
    records = trajectory_records(X, fit.n_states, known, np.empty((len(X), 0)))
    theta = tuple(f"{title}: {name}" for name in term.effect.theta_names(records, term.place))
    each: list[tuple[tuple[int, ...], slice]]
    if term.mode is None and term.replaced is not None and n_modes > 1:
        each = [((mode,), slice(mode * width, (mode + 1) * width)) for mode in range(n_modes)]
    elif term.mode is None:
        each = [(tuple(range(n_modes)), slice(0, width))]
    else:
        each = [((term.mode,), slice(0, width))]
    for modes, own in each:
        named = title if len(modes) == n_modes else f"mode {modes[0]}: {title}"
        yield _Part(place, modes, own, tuple(f"{named}: {name}" for name in listed), theta, named)


def _refuse_what_remembers(fit: JointFit, names: Sequence[str]) -> None:
    """Refuse what is no function of the present states and inputs."""
    laws = fit.laws
    if not isinstance(laws, SwitchingLaws):
        raise TypeError(
            "the model is an automaton; identify it with HybridAutomatonRegressor(refine=True), "
            "which refines laws, guards and resets on rollouts."
        )
    if steps_before(laws.estimator) is not None:
        raise TypeError(
            "the model is the last step of a pipeline; declare the SwitchingSystemRegressor alone, "
            "with the steps before it in its feature_library, and refine that."
        )
    for term in fit.terms:
        if not _is_of_the_present(term) or n_signals([term], laws.n_columns):
            raise ValueError(
                f"{term.effect.kind} of {term.label(names)} is no term of the present states and "
                "inputs, which is all that refine integrates; fit an EffectRegressor without it "
                "and refine that."
            )


def _is_of_the_present(term: PlacedEffect) -> bool:
    if isinstance(term.effect, (StructureEffect, UnmeasuredDisturbance)):
        return True  # nothing, or what is known of no rollout
    return bool(term.effect.terms) and not term.effect.needs
