"""Fitted surfaces as a program on many rows: penalties, and the rows that decide about them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._losses import TrustRegion
from swsysid._results import Array
from swsysid._surfaces.hinge import MarginProgram
from swsysid._surfaces.margin_program import SurfaceFit, fit_programs
from swsysid._surfaces.polynomials import Basis


@dataclass(frozen=True)
class HingeSummary:
    """What many rows say about one surface, next to the fitted one.

    A row beyond its margin costs nothing while the surface moves a little, and one with much slack
    enters linearly: the rows of slack are one row, their sum.
    """

    near: Array  # (n_near, n_surface_features): features times the sign of the row
    weight: Array  # (n_near,)
    slack: Array  # (n_surface_features,): weighted sum of the rows with much slack
    slack_weight: float

    @classmethod
    def joined(cls, parts: Sequence[HingeSummary]) -> HingeSummary:
        """Summary of several blocks."""
        return cls(
            np.concatenate([part.near for part in parts]),
            np.concatenate([part.weight for part in parts]),
            np.sum([part.slack for part in parts], axis=0),
            sum(part.slack_weight for part in parts),
        )

    @property
    def cut(self) -> tuple[Array, Array]:
        """The rows with much slack as one row, and its weight; no row if there are none."""
        n_rows = int(self.slack_weight > 0.0)
        weight = np.full(n_rows, self.slack_weight)
        return np.repeat(self.slack[None, :], n_rows, axis=0) / weight[:, None], weight

    def program(self, added: Sequence[tuple[Array, Array]], *options: float) -> MarginProgram:
        """The margin LP around the fitted surface, with more rows and their weights."""
        rows = [(self.near, self.weight), self.cut, *added]
        signed, weight = (np.concatenate(each) for each in zip(*rows, strict=True))
        return MarginProgram(signed, weight, *options)


@dataclass(frozen=True)
class Anchors:
    """Some rows that hold a surface where it is, beyond the region in which all are kept.

    A surface that is left alone by the rows far away could move among them.
    """

    X: Array  # (n_anchors, n_features_in)
    labels: NDArray[np.intp]  # (n_anchors,): places in the classes of the surfaces
    weight: Array  # (n_anchors,): of the rows that each stands for
    region: TrustRegion  # how far from their margin rows are kept


@dataclass(frozen=True)
class FittedSurfaces:
    """Surfaces in fitting coordinates and the margin LP that they solve."""

    basis: Basis  # features (n_rows, n_surface_features) of coordinates
    coef: Array  # (n_surfaces, n_surface_features)
    book: NDArray[np.int64]  # (n_classes, n_surfaces)
    classes: NDArray  # (n_classes,)
    margin: float
    beta: float
    bound: float
    solver: str

    @property
    def complexity(self) -> float:
        """The part of the margin LPs' objective that no row has a say in."""
        return self.beta * float(np.abs(self.coef).sum())

    def objective(self, summaries: Sequence[HingeSummary]) -> float:
        """Objective of the margin LPs, from one summary for each surface."""
        total = 0.0
        for summary, coef in zip(summaries, self.coef, strict=True):
            program = summary.program([], self.margin, self.beta, self.bound)
            total += program.objective(coef, program.signed @ coef)
        return total

    def values(self, X: Array) -> Array:
        """Values of the surfaces, (n_rows, n_surfaces)."""
        return np.asarray(self.basis(X) @ self.coef.T, dtype=float)

    def penalty(self, values: Array) -> Array:
        """Slack that each class would cost each row, (n_rows, n_classes)."""
        penalty = np.zeros((len(values), len(self.book)))
        for surface, signs in enumerate(self.book.T):
            for column, sign in enumerate(signs):
                if sign:
                    penalty[:, column] += np.maximum(0.0, self.margin - sign * values[:, surface])
        return penalty

    def distance(self, X: Array, labels: NDArray) -> Array:
        """How far each row is beyond the margin of each surface; infinite if it has no say."""
        return self._distance(self.values(X), labels)

    def _distance(self, values: Array, labels: NDArray) -> Array:
        signs = self.book[labels]
        return np.where(signs == 0, np.inf, signs * values - self.margin)

    def summarise(
        self, X: Array, values: Array, labels: NDArray, weight: Array, region: TrustRegion
    ) -> list[HingeSummary]:
        """One summary for each surface; rows of the trust region around their margin are kept."""
        # `labels` are places in `classes`.
        distance = self._distance(values, labels)
        summaries = []
        for surface, signs in enumerate(self.book.T):
            some = np.flatnonzero(distance[:, surface] <= region.farthest)
            signed = self.basis(X[some]) * signs[labels[some], None] if some.size else self.empty
            beyond = distance[some, surface]
            within = region.of(signed)[:, 0]
            is_near = np.abs(beyond) <= within
            slack_weight = np.where(beyond < -within, weight[some], 0.0)
            summaries.append(
                HingeSummary(
                    signed[is_near],
                    weight[some[is_near]],
                    slack_weight @ signed,
                    float(slack_weight.sum()),
                )
            )
        return summaries

    def refit(
        self,
        summaries: Sequence[HingeSummary],
        anchors: Anchors,
        refused: Sequence[Sequence[HingeSummary]] = (),
    ) -> list[SurfaceFit]:
        """Solve the margin LPs of the summaries, from these surfaces."""
        # `refused` are summaries at surfaces that were no better: what had much slack there is one
        # row more, so that they are not found again.
        programs = []
        features, distance = self.basis(anchors.X), self.distance(anchors.X, anchors.labels)
        within = anchors.region.of(features)[:, 0]
        for surface, summary in enumerate(summaries):
            beyond = distance[:, surface]
            far = np.flatnonzero((beyond > within) & np.isfinite(beyond))
            signs = self.book[anchors.labels[far], surface]
            added = features[far] * signs[:, None], anchors.weight[far]
            cuts = [each[surface].cut for each in refused]
            programs.append(summary.program([added, *cuts], self.margin, self.beta, self.bound))
        return fit_programs(programs, self.solver, self.coef)

    @property
    def empty(self) -> Array:
        """Features of no rows."""
        return np.empty((0, self.coef.shape[1]))
