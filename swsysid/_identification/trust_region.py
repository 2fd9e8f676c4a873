"""How far residuals and margins may still move, judged on a sample of the rows."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from swsysid._identification.problem import Modes, SwitchingProblem
from swsysid._identification.settings import IdentificationSettings, TrustRegionSettings
from swsysid._losses import TrustRegion
from swsysid._results import Array
from swsysid._seeding.designs import whiten
from swsysid._surfaces.fitted import Anchors, FittedSurfaces
from swsysid._surfaces.surface import CoupledClassifier

_SMALL = 1e-300


@dataclass(frozen=True)
class Estimate:
    """Vector fields and surfaces, as a pass over many rows takes them."""

    coef: Array  # (n_modes, n_states, n_features_out)
    # What the assignment is coupled to; where it is not coupled, `FittedSurfaces` next to which the
    # labels are summarised.
    surface: FittedSurfaces | CoupledClassifier | None

    def modes_of(self, problem: SwitchingProblem) -> Modes:
        """Labels of the rows of a problem."""
        penalty = self.penalty(problem, self.surface_values(problem.coordinates))
        return problem.assign(self.coef, penalty).modes

    def surface_values(self, X: Array) -> Array | None:
        """Values of the surfaces, None for a classifier that is known by its labels only."""
        return self.surface.values(X) if isinstance(self.surface, FittedSurfaces) else None

    def penalty(self, problem: SwitchingProblem, values: Array | None) -> Array | None:
        """Slack of every row in every mode at these values, None without coupling."""
        surface = self.surface
        if not problem.coupling or surface is None:
            return None
        if not isinstance(surface, FittedSurfaces):
            return problem.penalty(surface)
        assert values is not None, "the surfaces are functions"
        return problem.penalty_of_all(surface.classes, surface.penalty(values))

    @property
    def complexity(self) -> float:
        """The part of the surfaces' objective that no row has a say in."""
        return self.surface.complexity if isinstance(self.surface, FittedSurfaces) else 0.0


@dataclass(frozen=True)
class TrustRegions:
    """How far an estimate may still move; the rows that this may turn over are kept by a pass."""

    residuals: tuple[TrustRegion, ...]  # of every mode
    margins: TrustRegion  # of the distances to the margins of the surfaces

    def widened(self, settings: IdentificationSettings) -> TrustRegions:
        """Larger ones, in which rows of any leverage are kept."""
        return TrustRegions(
            tuple(each.scaled(settings.wider).of_any_row for each in self.residuals),
            self.margins.scaled(settings.wider_margins).of_any_row,
        )


_NO_MARGINS = TrustRegion(np.empty((0, 0)), np.empty(0))


def rows_to_know(
    n_rows: int, n_features: int, n_outputs: int, settings: IdentificationSettings
) -> int:
    r"""From how many rows vector fields must be known for a pass over `n_rows` to keep enough.

    Of n rows it keeps :math:`\chi_p n K \sqrt{p / m}` for K outputs and p features that are known
    from m rows; see `Sampled.around`.
    """
    radius = _radius(n_features, settings.trust_region)
    kept_of_one = radius * np.sqrt(n_features) * n_rows * n_outputs
    return int((kept_of_one / settings.most_kept) ** 2)


def _radius(n_features: int, settings: TrustRegionSettings) -> float:
    """Distance from the origin that a standard normal vector rarely exceeds."""
    return float(np.sqrt(chdtri(n_features, settings.chance)))


@dataclass(frozen=True)
class Sampled:
    """Rows of a sample as a problem, to judge distances by."""

    problem: SwitchingProblem
    n_rows: int  # how many rows the sample stands for
    n_known: int  # how many rows the estimate is known from when the passes begin

    @property
    def settings(self) -> TrustRegionSettings:
        """Those of the problem."""
        return self.problem.settings.trust_region

    def around(self, estimate: Estimate) -> TrustRegions:
        r"""How far an estimate of as many rows as are known may be from that of all rows.

        Coefficients of least absolute deviations have the covariance :math:`\tau^2 G^{-1}` with
        :math:`\tau = 1 / (2 f(0))`, where f is the density of the residuals (Koenker and Bassett
        1978): changes are within :math:`\tau \chi_p` in the metric of G, with the quantile
        :math:`\chi_p` of the length of a standard normal vector. Coefficients of an output that a
        mode meets exactly stay.
        """
        modes = estimate.modes_of(self.problem)
        first = [self._around_mode(estimate.coef, modes, j) for j in range(len(estimate.coef))]
        kept = max(sum(n_kept for _, n_kept in first), 1.0)
        share = min(1.0, self.problem.settings.most_kept / kept)
        residuals = tuple(region.scaled(share) for region, _ in first)
        if not isinstance(estimate.surface, FittedSurfaces):
            return TrustRegions(residuals, _NO_MARGINS)
        return TrustRegions(residuals, self._around_margins(estimate.surface, modes))

    def after(
        self, regions: TrustRegions, before: Estimate, now: Estimate, modes: Modes
    ) -> TrustRegions:
        """The trust regions after a step from one estimate to the next; `modes` are before it."""
        residuals = tuple(
            self._nearer(region, mode, before.coef, now.coef, modes)
            for mode, region in enumerate(regions.residuals)
        )
        margins = regions.margins
        if isinstance(now.surface, FittedSurfaces) and isinstance(before.surface, FittedSurfaces):
            margins = self._nearer_margins(margins, before.surface, now.surface, modes)
        return TrustRegions(residuals, margins)

    def holds(self, regions: TrustRegions, change: Array, modes: Modes) -> bool:
        """True if a change of the vector fields moves no residual out of its trust region."""
        return all(
            (self._step(rows, change[mode]) <= np.maximum(region.size, 0.0)).all()
            for mode, region in enumerate(regions.residuals)
            if (rows := self._members(modes, mode)).size
        )

    def anchors(
        self, estimate: Estimate, surface: FittedSurfaces, regions: TrustRegions
    ) -> Anchors:
        """The rows that hold the surfaces of an estimate."""
        problem, classes = self.problem, surface.classes
        labels = np.searchsorted(classes, estimate.modes_of(problem))
        weight = problem.weight * (self.n_rows / len(problem.weight))
        return Anchors(problem.coordinates, labels, weight, regions.margins)

    def _around_mode(self, coef: Array, modes: Modes, mode: int) -> tuple[TrustRegion, float]:
        """The trust region of one mode, and how many rows it will keep, over all outputs."""
        rows = self._members(modes, mode)
        features = self.problem.features[rows]
        if not rows.size:
            nowhere = np.zeros((features.shape[1], 0)), np.full(coef.shape[1], -1.0)
            return TrustRegion(*nowhere, 0.0), 0.0
        metric = whiten(features, np.ones(len(rows))).transform / np.sqrt(self._known(rows))
        sizes = np.abs(self.problem.residuals(coef, modes)[rows])
        leverage = _leverage(features, metric)
        spread = np.ptp(self.problem.targets, axis=0)
        exact = np.median(sizes, axis=0) <= self.settings.exact * spread
        radius = _radius(metric.shape[1], self.settings)
        size = np.where(exact, -1.0, radius * self._sparsity(sizes))
        n_rows = self.n_rows * self._share(rows)
        n_kept = n_rows * radius * float(leverage.mean()) * np.count_nonzero(~exact)
        return TrustRegion(metric, size, self.settings.leverage * float(leverage.max())), n_kept

    def _nearer(
        self, region: TrustRegion, mode: int, coef: Array, moved: Array, modes: Modes
    ) -> TrustRegion:
        """The trust region after a step of one mode from `coef` to `moved`."""
        rows = self._members(modes, mode)
        if not rows.size:
            return region
        features, step = self.problem.features[rows], self._step(rows, moved[mode] - coef[mode])
        sparsity = self._sparsity(np.abs(self.problem.residuals(moved, modes)[rows]))
        leverage = _leverage(features, region.metric).mean()
        n_rows = self.n_rows * self._share(rows)
        fewest = self.settings.fewest * features.shape[1] / (n_rows * leverage) * sparsity
        wanted = np.maximum(self.settings.following * step, fewest)
        return replace(region, size=np.minimum(region.size, wanted))

    def _step(self, rows: Modes, change: Array) -> Array:
        """Size of a change of the vector field in the metric of a trust region, (n_states,)."""
        moved = np.square(self.problem.features[rows] @ change.T).mean(axis=0)
        return np.sqrt(self._known(rows) * moved)

    def _members(self, modes: Modes, mode: int) -> Modes:
        return np.flatnonzero((modes == mode) & ~self.problem.outlying)

    def _known(self, rows: Modes) -> float:
        """From how many rows the vector field of these rows is known."""
        return self.n_known * self._share(rows)

    def _share(self, rows: Modes) -> float:
        return len(rows) / len(self.problem.weight)

    def _around_margins(self, surface: FittedSurfaces, modes: Modes) -> TrustRegion:
        """How far distances to the margins may move from surfaces of as many rows."""
        features, distance = self._from_margins(surface, modes)
        metric = whiten(features, np.ones(len(features))).transform
        leverage = _leverage(features, metric)
        share = self._within_memory(self.settings.near_margin * features.shape[1] / self.n_known)
        size = self._quantile(distance / np.maximum(leverage, _SMALL), share)
        most = self.settings.leverage * float(leverage.max())
        return TrustRegion(metric, np.atleast_1d(size), most)

    def _nearer_margins(
        self, region: TrustRegion, surface: FittedSurfaces, moved: FittedSurfaces, modes: Modes
    ) -> TrustRegion:
        """The trust region after a step from `surface` to `moved`."""
        features, distance = self._from_margins(moved, modes)
        step = np.sqrt(np.square(features @ (moved.coef - surface.coef).T).mean(axis=0).max())
        fewest = self.settings.fewest_near_margin * features.shape[1]
        ratio = distance / np.maximum(_leverage(features, region.metric), _SMALL)
        least = self._quantile(ratio, self._within_memory(fewest / self.n_rows))
        wanted = np.maximum(self.settings.following * step, least)
        return replace(region, size=np.minimum(region.size, wanted))

    def _from_margins(self, surface: FittedSurfaces, modes: Modes) -> tuple[Array, Array]:
        """Surface features of every row, and its distance from the nearest margin."""
        X, place = self.problem.coordinates, np.searchsorted(surface.classes, modes)
        return surface.basis(X), np.abs(surface.distance(X, place)).min(axis=1)

    def _within_memory(self, share: float) -> float:
        n_kept = self.n_rows * self.problem.targets.shape[1]
        return min(share, self.problem.settings.most_kept / n_kept)

    def _sparsity(self, sizes: Array) -> Array:
        """1 / (2 f(0)) of every column, where f is the density of residuals of these sizes."""
        resolved = self.settings.resolved
        return np.asarray(np.quantile(sizes, resolved, axis=0)) / resolved

    def _quantile(self, values: Array, share: float) -> float:
        """Quantile of few values; below the smallest few in proportion to these."""
        resolved = min(1.0, max(share, self.settings.counted / len(values)))
        return float(np.quantile(values, resolved)) * min(1.0, share / resolved)


def _leverage(features: Array, metric: Array) -> Array:
    """Root of the leverage of every row."""
    return np.asarray(np.linalg.norm(features @ metric, axis=1), dtype=float)
