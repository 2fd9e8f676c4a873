"""One pass over all rows: the labels for given vector fields and surfaces, and what they say.

A pass looks at every block of rows on its own: it assigns the rows to modes, values the joint
objective, and summarises the rows for the next vector fields and surfaces. Its answer is small, and
answers of blocks are joined in the order of the blocks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._data.features import FeatureMap
from swsysid._data.sources import Rows
from swsysid._identification.problem import Costs, Modes, SwitchingProblem
from swsysid._identification.trust_region import Estimate, TrustRegions
from swsysid._results import Array
from swsysid._surfaces.fitted import FittedSurfaces, HingeSummary


@dataclass(frozen=True)
class PassResult:
    """What a pass found in some rows."""

    # (n_rows,): mode of every row; ``-1 - mode`` for a row that no mode explains.
    labels: NDArray[np.int8]
    costs: Costs
    weight: Array  # (n_modes,): of the rows of every mode
    dynamics: tuple  # a summary of the rows of every mode, of the kind that the loss has
    surfaces: tuple[HingeSummary, ...]

    @classmethod
    def joined(cls, parts: Sequence[PassResult]) -> PassResult:
        """The result for the rows of several, one after the other."""
        dynamics = zip(*(part.dynamics for part in parts), strict=True)
        surfaces = zip(*(part.surfaces for part in parts), strict=True)
        return cls(
            np.concatenate([part.labels for part in parts]),
            sum((part.costs for part in parts), Costs(0.0, 0.0, 0.0, 0.0, 0.0)),
            np.sum([part.weight for part in parts], axis=0),
            tuple(type(of_mode[0]).joined(of_mode) for of_mode in dynamics),
            tuple(HingeSummary.joined(of_surface) for of_surface in surfaces),
        )

    @property
    def modes(self) -> NDArray[np.int8]:
        """Mode of every row."""
        modes, outlying = self.labels.copy(), np.flatnonzero(self.labels < 0)
        modes[outlying] = -1 - modes[outlying]
        return modes


@dataclass(frozen=True)
class Pass:
    """A pass over rows with one estimate."""

    problem: SwitchingProblem  # without rows
    feature_map: FeatureMap
    estimate: Estimate
    # (n_modes, n_states, n_features_out): vector fields that say which rows no mode explains. They
    # stay while those of the estimate move: else rows would come and go, and the objective with
    # them.
    reference: Array
    discards: NDArray[np.bool_]  # (n_modes,): modes whose rows may be outliers
    regions: TrustRegions  # how far residuals and margins may move; rows within it are kept
    # True if the vector fields are known to be optimal for the labels of the pass before.
    exact: bool = False

    def __call__(self, rows: Rows, before: NDArray[np.int8] | None = None) -> PassResult:
        """The result for a block; `before` are its labels of the pass before."""
        results, start = [], 0
        for piece in rows.pieces():
            end = start + len(piece)
            results.append(self._piece(piece, None if before is None else before[start:end]))
            start = end
        return PassResult.joined(results)

    def widened(self) -> Pass:
        """The same pass, which keeps more rows."""
        return replace(self, regions=self.regions.widened(self.problem.settings))

    def _piece(self, rows: Rows, before: NDArray[np.int8] | None) -> PassResult:
        # In memory one state after the other, as velocities are: passes over few long columns.
        targets = np.asfortranarray(rows.targets)
        problem = self.problem.on_rows(self.feature_map(rows.X), targets, rows.X)
        velocities = problem.velocities(self.estimate.coef)
        losses = problem.loss.values((problem.targets - velocities) / problem.scale)
        problem = replace(problem, weight=rows.weight, outlying=self._outlying(problem, losses))
        values = self.estimate.surface_values(rows.X)
        penalty = self.estimate.penalty(problem, values)
        assignment = problem.assign_velocities(velocities, penalty)
        modes = assignment.modes
        labels = np.where(problem.outlying, -1 - modes, modes).astype(np.int8)
        return PassResult(
            labels,
            costs=problem.costs(velocities, assignment, penalty),
            weight=np.bincount(modes, rows.weight, problem.n_modes).astype(float),
            dynamics=self._dynamics(problem, labels, before),
            surfaces=self._surfaces(rows, values, modes),
        )

    def _outlying(self, problem, losses) -> NDArray[np.bool_]:
        """Rows that their best mode of the reference does not explain either; see `calibrate`."""
        outlying = np.zeros(len(problem.targets), dtype=bool)
        if not (problem.coupling and self.discards.any()):
            return outlying
        # A loss is at least that of its largest residual.
        calibration = problem.settings.calibration
        near = np.full(len(problem.scale), calibration.suspected * calibration.outlying)
        near[1:] *= not problem.loss.separable
        far = np.flatnonzero(losses.min(axis=0) > problem.loss.values(near))
        some = problem.on_rows(
            problem.features[far], problem.targets[far], problem.coordinates[far]
        )
        residuals = (some.targets - some.velocities(self.reference)) / problem.scale
        own = problem.loss.values(residuals).argmin(axis=0)
        size = np.abs(residuals[own, np.arange(len(far))])
        if not problem.loss.separable:
            size = size.mean(axis=1, keepdims=True)
        beyond = size.max(axis=1, initial=0.0) > calibration.outlying
        outlying[far] = beyond & self.discards[own]
        return outlying

    def _dynamics(self, problem: SwitchingProblem, labels, before) -> tuple:
        """Summaries of every mode; of the rows that joined or left it, if `before` says which."""

        def summary(mode: int, members: NDArray[np.bool_], sign: float = 1.0):
            rows = np.flatnonzero(members)
            return problem.loss.summary.of(
                np.take(problem.features.T, rows, axis=1).T,
                problem.targets[rows],
                sign * problem.weight[rows],
                self.estimate.coef[mode],
                self.regions.residuals[mode],
            )

        modes = range(problem.n_modes)
        if before is None or not problem.loss.additive:
            return tuple(summary(mode, labels == mode) for mode in modes)
        changed = labels != before
        joining = (summary(mode, changed & (labels == mode)) for mode in modes)
        leaving = (summary(mode, changed & (before == mode), -1.0) for mode in modes)
        return tuple(map(problem.loss.summary.joined, zip(joining, leaving, strict=True)))

    def _surfaces(self, rows: Rows, values: Array | None, modes: Modes) -> tuple[HingeSummary, ...]:
        surface = self.estimate.surface
        if values is None or not isinstance(surface, FittedSurfaces):
            return ()
        place = np.full(self.problem.n_modes, -1)
        place[surface.classes] = np.arange(len(surface.classes))
        labels = place[modes]
        known = labels >= 0
        if not known.all():  # a mode without samples has no surface
            rows, values, labels = rows.take(known), values[known], labels[known]
        margins = self.regions.margins
        return tuple(surface.summarise(rows.X, values, labels, rows.weight, margins))
