"""The identification problem: its data, and the three steps of the bilevel method.

The method (paper, section "Bilevel convex program") alternates three convex programs on the
same data, and each of them is one method of `SwitchingProblem`:

==================  ==========================================================================
`assign`            memberships for given vector fields (relaxed mode constraint)
`estimate`          vector fields for given memberships (paper, "Dynamics estimation as LP")
`refit_surface`     surfaces for given modes (paper, "Recovery of Switching Surfaces")
==================  ==========================================================================

All three decrease the joint objective

    J = sum_i w_i loss_i / scale + coupling * (sum_i w_i slack_i + beta ||a||_1)

whose first term is the paper's objective and whose second is the margin LP's. With
``coupling = 0`` the surface has no say in the assignment, which is the paper's method.

The noise of a problem is its scale, the rows that no mode explains, and the odds of the modes.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass, replace

import numpy as np
from numpy.typing import NDArray
from sklearn.base import clone

from swsysid._identification.settings import IdentificationSettings
from swsysid._identification.within import KnownLaws, Rows, estimate_within
from swsysid._known.region import Region
from swsysid._losses import Loss
from swsysid._noise import (
    LAPLACE_SCALE,
    NORMAL,
    Outliers,
    mixed_with_outliers,
    robust_scale,
    weighted_quantile,
)
from swsysid._results import Array, Assignment
from swsysid._surfaces.surface import (
    Classifier,
    CoupledClassifier,
    fit_weighted,
    mode_book_of,
    solves_margin_program,
)
from swsysid.relaxations._base import Relaxation

Modes = NDArray[np.intp]


@dataclass(frozen=True)
class CoupledSurface:
    """A surface fitted to some modes, and what it asks of every sample."""

    classifier: CoupledClassifier
    penalty: Array  # (n_samples, n_modes): slack of every sample in every mode
    book_modes: Modes  # (n_samples,): the modes for which its mode-book was chosen


@dataclass(frozen=True)
class Costs:
    """What an assignment costs."""

    loss: float  # weighted sum of the losses over their scale, of the rows that vote
    # Weighted sums in the user's units, for the labels and for the relaxed memberships.
    hard_loss: float
    relaxed_loss: float
    slack: float  # weighted sum of the slacks
    tight: float  # weight of the rows at which the relaxation was one-hot

    def __add__(self, other: Costs) -> Costs:
        return Costs(*np.add(astuple(self), astuple(other)).tolist())


@dataclass(frozen=True)
class SwitchingProblem:
    """Data and choices of one identification."""

    features: Array  # (n_samples, n_features_out): Phi(x_i)
    targets: Array  # (n_samples, n_states): measured velocities
    coordinates: Array  # (n_samples, n_features_in): what the surface is a function of
    weight: Array  # (n_samples,): multiplicity of every row
    n_modes: int
    loss: Loss
    relaxation: Relaxation
    surface: Classifier
    coupling: float  # price of disagreeing with the surface
    # (n_states,): size of a typical residual of each velocity; residuals are compared in this unit.
    scale: Array
    # (n_samples,): rows that no mode explains: they do not vote on the vector fields, and their
    # mode is what the surface says.
    outlying: NDArray[np.bool_]
    coef_bound: float | None = None
    solver: str = "auto"
    # (n_modes, n_states, n_features_out) or None: coefficients that may differ from zero.
    support: NDArray[np.bool_] | None = None
    known: KnownLaws | None = None
    settings: IdentificationSettings = IdentificationSettings()

    # -- the three steps -------------------------------------------------------------------

    def estimate(self, membership: Array, start: Array | None = None) -> Array:
        """Vector fields that minimise the loss for given memberships."""
        if (region := self.region) is not None:
            rows = Rows(self.features, self.targets, self.informative_weight)
            return estimate_within(region, self.loss.name, rows, membership, self.support, start)
        # A one-hot membership separates the modes. Otherwise the program is one regression whose
        # design has the blocks lambda_ij Phi(x_i), n_modes * n_features_out columns in all.
        if (membership.max(axis=1) > 1.0 - 1e-9).all():
            return self._estimate_each(membership.argmax(axis=1), start)
        return self._estimate_jointly(membership)

    def assign(self, coef: Array, penalty: Array | None = None) -> Assignment:
        """Memberships for given vector fields, and for a given surface if they are coupled.

        The penalty for disagreeing with the surface, (n_samples, n_modes), None if they are not
        coupled, enters as one more coordinate of the residual (`Loss.extra_coordinate`), so that a
        relaxation sees an ordinary assignment.
        """
        return self.assign_velocities(self.velocities(coef), penalty)

    def assign_velocities(self, velocities: Array, penalty: Array | None = None) -> Assignment:
        """The same for velocities of every mode, (n_modes, n_samples, n_states)."""
        n_modes, n_samples, n_states = velocities.shape
        # In memory one state after the other, and the surface after them.
        n_coordinates = n_states + (penalty is not None)
        candidates = np.empty((n_modes, n_coordinates, n_samples))
        targets = np.zeros((n_coordinates, n_samples))
        targets[:n_states] = self.targets.T / self.scale[:, None]
        scaled = candidates[:, :n_states]
        np.divide(velocities.transpose(0, 2, 1), self.scale[:, None], out=scaled)
        if penalty is not None:
            if self.outlying.any():
                scaled[:, :, self.outlying] = targets[:n_states, self.outlying]
            losses = self.loss.values((targets[:n_states] - scaled).transpose(0, 2, 1))
            candidates[:, -1] = self.loss.extra_coordinate(losses, self.coupling * penalty.T)
        return self._relax(candidates.transpose(0, 2, 1), targets.T)

    def fit_surface(self, modes: Modes) -> CoupledSurface | None:
        """A surface fitted to the modes, None if the two are not coupled."""
        return self._fit_surface(modes, modes) if self.coupling else None

    def refit_surface(self, modes: Modes, previous: CoupledSurface) -> CoupledSurface:
        """A surface at least as good for the modes as the previous one, with its mode-book."""
        # To choose a mode-book takes longer than to fit its surfaces.
        fitted = self._fit_surface(modes, previous.book_modes, previous.classifier)
        # The margin LP is convex only for a given mode-book; another book can be worse.
        worse = self.surface_cost(previous, modes) < self.surface_cost(fitted, modes)
        return previous if worse else fitted

    def renew_book(self, modes: Modes, previous: CoupledSurface) -> CoupledSurface:
        """A better surface with a new mode-book; the previous one if there is none."""
        # It is looked for if the modes are no longer those for which the book was chosen.
        changed = self.weight @ (modes != previous.book_modes)
        if changed <= self.settings.another_book * self.weight.sum():
            return previous
        fitted = self._fit_surface(modes, modes)
        limit = (1.0 - self.settings.no_gain) * self.surface_cost(previous, modes)
        return fitted if self.surface_cost(fitted, modes) < limit else previous

    @property
    def region(self) -> Region | None:
        """Vector fields that what is known allows; None for all."""
        return None if self.known is None else self.known.region(self.n_modes)

    # -- what the steps decrease -----------------------------------------------------------

    def joint_objective(self, loss: float, surface_cost: float) -> float:
        """The joint objective J of a loss over its scale and the objective of the margin LPs."""
        return loss + self.coupling * surface_cost

    def costs(
        self, velocities: Array, assignment: Assignment, penalty: Array | None = None
    ) -> Costs:
        """What an assignment costs for the velocities of every mode and the slacks of a surface."""
        modes, each = assignment.modes, np.arange(len(self.targets))
        residuals = self.targets - velocities[modes, each]
        hard_loss = relaxed_loss = float(self.weight @ self.loss.values(residuals))
        tight = assignment.tightness
        if not tight.all():
            relaxed_loss = self.relaxed_loss(velocities, assignment.membership)
        return Costs(
            loss=float(self.informative_weight @ self.loss.values(residuals / self.scale)),
            hard_loss=hard_loss,
            relaxed_loss=relaxed_loss,
            slack=0.0 if penalty is None else float(self.weight @ penalty[each, modes]),
            tight=float(self.weight @ tight),
        )

    def surface_cost(self, surface: CoupledSurface, modes: Modes) -> float:
        """Objective of the margin LP: sum of weighted slacks plus beta ||a||_1."""
        slack = surface.penalty[np.arange(len(modes)), modes]
        return float(self.weight @ slack) + surface.classifier.complexity_

    def hard_loss(self, coef: Array, modes: Modes) -> float:
        """Loss of hard labels, in the user's units."""
        return float(self.weight @ self.loss.values(self.residuals(coef, modes)))

    # -- parts -----------------------------------------------------------------------------

    def relaxed_loss(self, velocities: Array, membership: Array) -> float:
        """Loss of a soft membership for the velocities of every mode, in the user's units."""
        mixed = np.einsum("im,mik->ik", membership, velocities)
        return float(self.weight @ self.loss.values(self.targets - mixed))

    @property
    def informative_weight(self) -> Array:
        """Weight of the rows that vote on the vector fields."""
        return np.where(self.outlying, 0.0, self.weight)

    def velocities(self, coef: Array) -> Array:
        """Velocity of every mode at every sample, shape (n_modes, n_samples, n_states)."""
        # In memory it is one state after the other.
        n_modes, n_states, n_features = coef.shape
        every = coef.reshape(-1, n_features) @ self.features.T
        return every.reshape(n_modes, n_states, -1).transpose(0, 2, 1)

    def residuals(self, coef: Array, modes: Modes) -> Array:
        """Measured minus modelled velocities, shape (n_samples, n_states)."""
        return self.targets - self.velocities(coef)[modes, np.arange(len(modes))]

    def penalty(self, surface: CoupledClassifier) -> Array:
        """Slack of every sample in every mode, shape (n_samples, n_modes)."""
        # A mode unknown to the surface, because it had no samples, costs as much as the dearest.
        return self.penalty_of_all(surface.classes_, surface.mode_penalty(self.coordinates))

    def penalty_of_all(self, classes: Modes, known: Array) -> Array:
        """Slack in every mode, from that in the modes `classes` that a surface knows."""
        if len(classes) == self.n_modes:
            return known
        penalty = np.repeat(known.max(axis=1, keepdims=True), self.n_modes, axis=1)
        penalty[:, classes] = known
        return penalty

    def some(self, rows: NDArray[np.intp]) -> SwitchingProblem:
        """The problem on some of its rows, which carry the weight of all."""
        weight = self.weight[rows] * (self.weight.sum() / self.weight[rows].sum())
        taken = self.on_rows(self.features[rows], self.targets[rows], self.coordinates[rows])
        return replace(taken, weight=weight, outlying=self.outlying[rows])

    def on_rows(self, features: Array, targets: Array, coordinates: Array) -> SwitchingProblem:
        """The same choices on other rows, each of weight one and none of them outlying."""
        n_samples = len(targets)
        return replace(
            self,
            features=features,
            targets=targets,
            coordinates=coordinates,
            weight=np.ones(n_samples),
            outlying=np.zeros(n_samples, dtype=bool),
        )

    def _fit_surface(
        self, modes: Modes, book_modes: Modes, start: CoupledClassifier | None = None
    ) -> CoupledSurface:
        """A surface fitted to the modes with the book of `start`, or one chosen for the modes."""
        surface, book = clone(self.surface), mode_book_of(start)
        if start is None or book is None or not np.array_equal(np.unique(modes), start.classes_):
            book_modes = modes
        else:
            surface.set_params(mode_book="pairwise" if (book == 0).any() else book)
        fitted = fit_weighted(surface, self.coordinates, modes, self.weight, start)
        return CoupledSurface(fitted, self.penalty(fitted), book_modes)

    def _relax(self, candidates: Array, targets: Array) -> Assignment:
        """Ask the relaxation, which may be a user's, and look at what it answers."""
        assignment = self.relaxation.assign(candidates, targets)
        expected = (len(targets), len(candidates))
        if np.shape(getattr(assignment, "membership", ())) != expected:
            raise TypeError(
                f"{type(self.relaxation).__name__}.assign must return a swsysid.Assignment whose "
                f"membership has the shape (n_samples, n_modes) = {expected}."
            )
        return assignment

    def _estimate_each(self, modes: Modes, start: Array | None) -> Array:
        shape = (self.n_modes, self.targets.shape[1], self.features.shape[1])
        coef = np.zeros(shape) if start is None else start.copy()
        for mode in range(self.n_modes):
            rows = np.flatnonzero((modes == mode) & (self.informative_weight > 0))
            if len(rows) == 0:  # a mode without samples keeps its vector field
                continue
            coef[mode] = self.loss.fit(
                self.features[rows],
                self.targets[rows],
                sample_weight=self.weight[rows],
                coef_bound=self.coef_bound,
                solver=self.solver,
                start=None if start is None else start[mode],
                support=None if self.support is None else self.support[mode],
            ).coef
        return coef

    def _estimate_jointly(self, membership: Array) -> Array:
        n_states, n_features = self.targets.shape[1], self.features.shape[1]
        design = (membership[:, :, None] * self.features[:, None, :]).reshape(len(membership), -1)
        support = self.support
        if support is not None:
            support = support.transpose(1, 0, 2).reshape(n_states, -1)
        stacked = self.loss.fit(
            design,
            self.targets,
            sample_weight=self.informative_weight,
            coef_bound=self.coef_bound,
            solver=self.solver,
            support=support,
        ).coef
        return stacked.reshape(n_states, self.n_modes, n_features).transpose(1, 0, 2)


def calibrate(problem: SwitchingProblem, coef: Array, modes: Modes) -> SwitchingProblem:
    """The problem with the scale of some residuals, and with the rows that are outlying."""
    # The scale is that of a Laplace law with the median size of the residuals, so that an l1 loss
    # is a negative log likelihood in nats.
    size = _sizes(problem, coef, modes)
    middle = weighted_quantile(problem.targets, problem.weight, 0.5, axis=0)
    spread = np.abs(problem.targets - middle).max(axis=0)
    floor = problem.settings.calibration.least_scale * np.where(spread > 0, spread, 1.0)
    scale = np.maximum(LAPLACE_SCALE * robust_scale(size, problem.weight), floor)
    problem = replace(problem, scale=scale)
    outlying = _outlying(problem, size)
    return replace(problem, outlying=outlying & may_discard(problem, coef, modes)[modes])


def may_discard(problem: SwitchingProblem, coef: Array, modes: Modes) -> NDArray[np.bool_]:
    """Modes of which not too many rows would be outlying, (n_modes,)."""
    outlying = _outlying(problem, _sizes(problem, coef, modes))
    members = np.bincount(modes, problem.weight, problem.n_modes)
    discarded = np.bincount(modes, problem.weight * outlying, problem.n_modes)
    return discarded <= problem.settings.calibration.most_outlying * members


def log_densities(problem: SwitchingProblem, coef: Array) -> Array:
    """Log density of every row's velocity in every mode, outliers allowed for, (n_rows, n_modes).

    Where the vector fields differ by less than the noise, as they do near a guard that they meet
    continuously, a row is no evidence for any mode.
    """
    deviation, settings = problem.scale / LAPLACE_SCALE, problem.settings.calibration
    squares = np.square((problem.targets - problem.velocities(coef)) / deviation).sum(axis=2).T
    inside = NORMAL.log_density(squares, np.log(deviation).sum(), len(deviation))
    breadth = settings.outlier_breadth
    outliers = Outliers.among(problem.targets, problem.weight, breadth, least=deviation)
    outside = outliers.log_density(problem.targets)[:, None]
    return mixed_with_outliers(inside, outside, settings.outlier_share)[0]


def attach_likelihood(
    surface: Classifier, problem: SwitchingProblem, coef: Array, modes: Modes
) -> None:
    """Attach the likelihood of the modes at every row to a surface that claims probabilities."""
    if problem.n_modes > 1 and solves_margin_program(surface):
        problem = calibrate(problem, coef, modes)
        surface.use_likelihood(problem.coordinates, log_densities(problem, coef), problem.weight)


def _outlying(problem: SwitchingProblem, size: Array) -> NDArray[np.bool_]:
    return (size / problem.scale).max(axis=1) > problem.settings.calibration.outlying


def _sizes(problem: SwitchingProblem, coef: Array, modes: Modes) -> Array:
    """Sizes of the residuals, the same for all outputs if the loss does not separate them."""
    size = np.abs(problem.residuals(coef, modes))
    if not problem.loss.separable:
        size = np.repeat(size.mean(axis=1, keepdims=True), size.shape[1], axis=1)
    return size
