"""How far residuals and margins may still move, judged on a sample of the rows."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from swsysid._identification.estimate import Estimate
from swsysid._identification.problem import Modes, SwitchingProblem
from swsysid._identification.settings import IdentificationSettings
from swsysid._losses import Reach
from swsysid._results import Array
from swsysid._seeding.designs import whiten
from swsysid._surfaces.fitted import Anchors, FittedSurfaces

__all__ = ["Sampled", "rows_to_know"]

_SMALL = 1e-300


@dataclass(frozen=True)
class TrustRegionSettings:
    """How far from a sample's answer that of all rows is looked for.

    Attributes
    ----------
    chance : float
        Chance that vector fields of a sample are farther from those of all rows than expected.
    fewest : int
        Rows kept at least for each column.
    near_margin, fewest_near_margin : float
        Rows kept next to a margin, in units of p / m for p features known from m rows; and never
        fewer than so many for each feature.
    leverage : float
        No row of all is expected to have more than so many times the leverage of those sampled.
    following : float
        Residuals and margins may move this share of what they moved in the step before.
    exact : float
        Residuals below this share of the spread of the targets count as zero.
    resolved, counted : float
        Share of the smallest residuals that tell their density at zero; number of the smallest
        distances that tell how many are smaller still.
    """

    chance: float = 0.01
    fewest: int = 10
    near_margin: float = 10.0
    fewest_near_margin: int = 20
    leverage: float = 3.0
    following: float = 0.3
    exact: float = 1e-9
    resolved: float = 0.1
    counted: int = 20


_SETTINGS = TrustRegionSettings()


@dataclass(frozen=True)
class TrustRegion:
    """How far an estimate may still move; the rows that this may turn over are kept by a pass.

    Attributes
    ----------
    residuals : tuple of Reach
        Of the residuals of every mode.
    margins : Reach
        Of the distances to the margins of the surfaces.
    """

    residuals: tuple[Reach, ...]
    margins: Reach

    def widened(self, settings: IdentificationSettings) -> TrustRegion:
        """A larger one, in which rows of any leverage are kept."""
        return TrustRegion(
            tuple(each.scaled(settings.wider).of_any_row for each in self.residuals),
            self.margins.scaled(settings.wider_margins).of_any_row,
        )


_NO_MARGINS = Reach(np.empty((0, 0)), np.empty(0))


def rows_to_know(n_rows: int, n_features: int, n_outputs: int, most_kept: int) -> int:
    r"""From how many rows vector fields must be known for a pass over `n_rows` to keep enough.

    Of n rows it keeps :math:`\chi_p n K \sqrt{p / m}` for K outputs and p features that are known
    from m rows; see `Sampled.reach`.
    """
    kept_of_one = _radius(n_features) * np.sqrt(n_features) * n_rows * n_outputs
    return int((kept_of_one / most_kept) ** 2)


def _radius(n_features: int) -> float:
    """Distance from the origin that a standard normal vector rarely exceeds."""
    return float(np.sqrt(chdtri(n_features, _SETTINGS.chance)))


@dataclass(frozen=True)
class Sampled:
    """Rows of a sample as a problem, to judge distances by.

    Attributes
    ----------
    problem : SwitchingProblem
    n_rows : int
        How many rows the sample stands for.
    n_known : int
        How many rows the vector fields and surfaces are known from when the passes begin.
    """

    problem: SwitchingProblem
    n_rows: int
    n_known: int

    def around(self, estimate: Estimate) -> TrustRegion:
        """How far an estimate of as many rows as are known may be from that of all rows."""
        modes = estimate.modes_of(self.problem)
        residuals = self._residual_reach(estimate.coef, modes)
        if not isinstance(estimate.surface, FittedSurfaces):
            return TrustRegion(residuals, _NO_MARGINS)
        return TrustRegion(residuals, self._margin_reach(estimate.surface, modes))

    def after(
        self, region: TrustRegion, before: Estimate, now: Estimate, modes: Modes
    ) -> TrustRegion:
        """The trust region after a step from one estimate to the next; `modes` are before it."""
        residuals = tuple(
            self._nearer(reach, mode, before.coef, now.coef, modes)
            for mode, reach in enumerate(region.residuals)
        )
        margins = region.margins
        if isinstance(now.surface, FittedSurfaces) and isinstance(before.surface, FittedSurfaces):
            margins = self._nearer_margin(margins, before.surface, now.surface, modes)
        return TrustRegion(residuals, margins)

    def holds(self, region: TrustRegion, change: Array, modes: Modes) -> bool:
        """True if a change of the vector fields moves no residual out of the trust region."""
        return all(
            self._is_within(reach, mode, change[mode], modes)
            for mode, reach in enumerate(region.residuals)
        )

    def _residual_reach(self, coef: Array, modes: Modes) -> tuple[Reach, ...]:
        r"""How far the residuals of each mode may move from vector fields of as many rows.

        Coefficients of least absolute deviations have the covariance :math:`\tau^2 G^{-1}` with
        :math:`\tau = 1 / (2 f(0))`, where f is the density of the residuals (Koenker and Bassett
        1978): changes are within :math:`\tau \chi_p` in the metric of G, with the quantile
        :math:`\chi_p` of the length of a standard normal vector. Coefficients of an output that a
        mode meets exactly stay.
        """
        first = [self._reach(coef, modes, mode) for mode in range(len(coef))]
        kept = sum(n_kept for _, n_kept in first)
        return tuple(reach.scaled(min(1.0, self._most_kept / max(kept, 1.0))) for reach, _ in first)

    def _reach(self, coef: Array, modes: Modes, mode: int) -> tuple[Reach, float]:
        """The reach of one mode, and how many rows it will keep, over all outputs."""
        rows = self._members(modes, mode)
        features = self.problem.features[rows]
        if not rows.size:
            return Reach(np.zeros((features.shape[1], 0)), np.full(coef.shape[1], -1.0), 0.0), 0.0
        metric = whiten(features, np.ones(len(rows))).transform / np.sqrt(self._known(rows))
        sizes = np.abs(self.problem.residuals(coef, modes)[rows])
        leverage = _leverage(features, metric)
        exact = np.median(sizes, axis=0) <= _SETTINGS.exact * np.ptp(self.problem.targets, axis=0)
        radius = _radius(metric.shape[1])
        size = np.where(exact, -1.0, radius * _sparsity(sizes))
        n_rows = self.n_rows * self._share(rows)
        n_kept = n_rows * radius * float(leverage.mean()) * np.count_nonzero(~exact)
        return Reach(metric, size, _SETTINGS.leverage * float(leverage.max())), n_kept

    def _nearer(self, reach: Reach, mode: int, coef: Array, moved: Array, modes: Modes) -> Reach:
        """The reach after a step of one mode from `coef` to `moved`."""
        rows = self._members(modes, mode)
        if not rows.size:
            return reach
        features, step = self.problem.features[rows], self._step(rows, moved[mode] - coef[mode])
        sparsity = _sparsity(np.abs(self.problem.residuals(moved, modes)[rows]))
        leverage = _leverage(features, reach.metric).mean()
        n_rows = self.n_rows * self._share(rows)
        fewest = _SETTINGS.fewest * features.shape[1] / (n_rows * leverage) * sparsity
        wanted = np.maximum(_SETTINGS.following * step, fewest)
        return replace(reach, size=np.minimum(reach.size, wanted))

    def _is_within(self, reach: Reach, mode: int, change: Array, modes: Modes) -> bool:
        """True if a change of the vector field of a mode moves no residual out of its reach."""
        rows = self._members(modes, mode)
        return not rows.size or bool(
            (self._step(rows, change) <= np.maximum(reach.size, 0.0)).all()
        )

    def _step(self, rows: Modes, change: Array) -> Array:
        """Size of a change of the vector field in the metric of a reach, (n_states,)."""
        moved = np.square(self.problem.features[rows] @ change.T).mean(axis=0)
        return np.sqrt(self._known(rows) * moved)

    def _members(self, modes: Modes, mode: int) -> Modes:
        return np.flatnonzero((modes == mode) & ~self.problem.outlying)

    def _known(self, rows: Modes) -> float:
        """From how many rows the vector field of these rows is known."""
        return self.n_known * self._share(rows)

    def _share(self, rows: Modes) -> float:
        return len(rows) / len(self.problem.weight)

    def _margin_reach(self, surface: FittedSurfaces, modes: Modes) -> Reach:
        """How far distances to the margins may move from surfaces of as many rows."""
        features, distance = self._from_margins(surface, modes)
        metric = whiten(features, np.ones(len(features))).transform
        leverage = _leverage(features, metric)
        share = self._within_memory(_SETTINGS.near_margin * features.shape[1] / self.n_known)
        size = _quantile(distance / np.maximum(leverage, _SMALL), share)
        return Reach(metric, np.atleast_1d(size), _SETTINGS.leverage * float(leverage.max()))

    def _nearer_margin(
        self, reach: Reach, surface: FittedSurfaces, moved: FittedSurfaces, modes: Modes
    ) -> Reach:
        """The reach after a step from `surface` to `moved`."""
        features, distance = self._from_margins(moved, modes)
        step = np.sqrt(np.square(features @ (moved.coef - surface.coef).T).mean(axis=0).max())
        share = self._within_memory(_SETTINGS.fewest_near_margin * features.shape[1] / self.n_rows)
        ratio = distance / np.maximum(_leverage(features, reach.metric), _SMALL)
        fewest = _quantile(ratio, share)
        wanted = np.maximum(_SETTINGS.following * step, fewest)
        return replace(reach, size=np.minimum(reach.size, wanted))

    def _from_margins(self, surface: FittedSurfaces, modes: Modes) -> tuple[Array, Array]:
        """Surface features of every row, and its distance from the nearest margin."""
        X, place = self.problem.coordinates, np.searchsorted(surface.classes, modes)
        return surface.basis(X), np.abs(surface.distance(X, place)).min(axis=1)

    def anchors(self, estimate: Estimate, surface: FittedSurfaces, region: TrustRegion) -> Anchors:
        """The rows that hold the surfaces of an estimate."""
        problem, classes = self.problem, surface.classes
        labels = np.searchsorted(classes, estimate.modes_of(problem))
        weight = problem.weight * (self.n_rows / len(problem.weight))
        return Anchors(problem.coordinates, labels, weight, region.margins)

    @property
    def _most_kept(self) -> int:
        return self.problem.settings.most_kept

    def _within_memory(self, share: float) -> float:
        n_outputs = self.problem.targets.shape[1]
        return min(share, self._most_kept / (self.n_rows * n_outputs))


def _leverage(features: Array, metric: Array) -> Array:
    """Root of the leverage of every row."""
    return np.asarray(np.linalg.norm(features @ metric, axis=1), dtype=float)


def _sparsity(sizes: Array) -> Array:
    """1 / (2 f(0)) of every column, where f is the density of residuals of these sizes."""
    return np.asarray(np.quantile(sizes, _SETTINGS.resolved, axis=0)) / _SETTINGS.resolved


def _quantile(values: Array, share: float) -> float:
    """Quantile of few values; below the smallest few in proportion to these."""
    resolved = min(1.0, max(share, _SETTINGS.counted / len(values)))
    return float(np.quantile(values, resolved)) * min(1.0, share / resolved)
