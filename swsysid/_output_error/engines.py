"""What a search asks of whoever estimates laws: of rates, or of a quantity that is no rate.

Laws of a quantity are estimated by weighted regression on rows. Nothing is rolled out: what
remembers is computed along whole recordings, and the rest is linear. So the score of a candidate is
what it explains of the residual beside the law's own columns.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from joblib import Parallel, delayed, effective_n_jobs
from numpy.typing import NDArray
from scipy.linalg import block_diag

from swsysid._journal import resumable, step
from swsysid._output_error import estimate, scan
from swsysid._output_error.criterion import Left, most_share, price
from swsysid._output_error.estimate import Courses, Fit, Places, cost
from swsysid._output_error.law import Law
from swsysid._output_error.scan import Score, explained
from swsysid._output_error.settings import SETTINGS
from swsysid._output_error.stretches import Stretches
from swsysid._results import Array
from swsysid.effects import PlacedEffect


@dataclass(frozen=True)
class Regressed(Fit):
    """A law with coefficients of least squares on the rows of some stretches."""

    rows: Weighted

    @property
    def noise(self) -> Array:
        """What misfits are measured in."""
        return self.errors

    @property
    def misfits(self) -> Array:
        """Measured less predicted values, in the noise, (n_samples, 1)."""
        return self.left / self.noise

    def courses_of(self, numbers: Sequence[int]) -> Courses | None:
        """None: a row has no course."""
        return None

    def covariance(self, wider: Law, stretches: Stretches) -> tuple[Array, Places, Places]:
        rows = Weighted.of(wider, stretches)
        own, column = rows.own / self.noise, np.flatnonzero(rows.free)
        covariance = np.linalg.pinv(own.T @ own, rcond=1e-12, hermitian=True)
        return np.asarray(covariance), np.zeros_like(column), column


@dataclass(frozen=True)
class Weighted:
    """Rows of a law, each by what it counts; those that are gross count nothing."""

    weights: Array  # (n_rows,)
    columns: Array  # (n_rows, n_columns)
    measured: Array  # (n_rows,)
    free: NDArray[np.bool_]  # columns of which the rows say anything

    @classmethod
    def of(cls, law: Law, stretches: Stretches) -> Weighted:
        """The rows of all stretches."""
        seen, rows = stretches.seen, stretches.rows
        columns = np.nan_to_num(law.columns(seen)[rows])
        measured = stretches.measured[rows, 0]
        weights = np.where(np.isfinite(measured), 1.0 / stretches.sizes[rows], 0.0)
        free = law.free[0] & columns.any(axis=0)
        return cls(weights, weights[:, None] * columns, weights * np.nan_to_num(measured), free)

    @property
    def own(self) -> Array:
        """Columns whose coefficients are sought."""
        return self.columns[:, self.free]

    def left(self, coef: Array) -> Array:
        """What coefficients of all columns leave, NaN where a value is gross, (n_rows, 1)."""
        left = np.where(self.weights > 0.0, self.measured - self.columns @ coef, np.nan)
        return left[:, None]


@step
def fitted(
    law: Law,
    stretches: Stretches,
    start: Courses | None = None,
    noise: Array | None = None,
    turns: int = SETTINGS.noise_turns,
    most: int = 1,
) -> Regressed:
    """Coefficients of least squares; no start is needed, no size of the noise and no turns."""
    rows, coef = Weighted.of(law, stretches), law.coef.copy()
    free, own = rows.free, rows.own
    nothing = np.zeros((0, law.declared.shape[1]))
    prior = block_diag(nothing, *(term.effect.prior for term in law.terms))[:, free]
    unit = np.maximum(np.linalg.norm(own, axis=0), np.finfo(float).tiny)
    rest = rows.measured - rows.columns[:, ~free] @ coef[0, ~free]
    design, values = np.vstack([own, prior]), np.append(rest, np.zeros(len(prior)))
    coef[0, free] = np.linalg.lstsq(design / unit, values, rcond=None)[0] / unit
    return Regressed(replace(law, coef=coef), rows.left(coef[0]), rows)


@step
def left_over(fit: Fit, stretches: Stretches, start: Courses | None = None) -> Left:
    """What a fitted law leaves of other stretches."""
    return Left(left_of(fit, stretches), stretches.series)


@step
def left_of(fit: Fit, stretches: Stretches) -> Array:
    """What a fitted law leaves of the values of other stretches, (n_samples, 1)."""
    return Weighted.of(fit.law, stretches).left(fit.law.coef[0])


@dataclass(frozen=True)
class RowScore:
    """The residual of a law, and all that its own coefficients can say."""

    weights: Array  # (n_rows,), in units of the noise
    spanned: Array  # (n_rows, rank): orthonormal columns
    left: Array  # (n_rows,)

    @classmethod
    def of(cls, fit: Regressed) -> RowScore:
        """Of a fitted law."""
        own = fit.rows.own / np.maximum(np.linalg.norm(fit.rows.own, axis=0), np.finfo(float).tiny)
        basis, sizes, _ = np.linalg.svd(own, full_matrices=False)
        spanned = basis[:, sizes > SETTINGS.spanned * sizes.max(initial=0.0)]
        return cls(fit.rows.weights / fit.noise, spanned, np.nan_to_num(fit.left[:, 0]) / fit.noise)

    @property
    def squares(self) -> float:
        """That are left."""
        return float(self.left @ self.left)

    def missed(self, stretches: Stretches) -> Array:
        """What the law lacks at every sample, zero at others than those of the stretches."""
        missed = np.zeros((len(stretches.seen), 1))
        missed[stretches.rows, 0] = self.left
        return missed

    def response(self, columns: Array) -> Array:
        """Columns of unit coefficient in units of the noise."""
        return np.asarray(self.weights[:, None] * columns)

    def gains(self, trials: Sequence[PlacedEffect], responses: Sequence[Array]) -> Array:
        """Squares that each trial explains, in units of the noise."""
        gains = np.zeros(len(trials))
        for number, columns in enumerate(responses):
            beside = columns - self.spanned @ (self.spanned.T @ columns)
            alone = np.sum(np.square(columns), axis=0)
            gains[number] = explained(beside.T @ beside, beside.T @ self.left, alone)
        return gains


@step
def scores(fit: Regressed, ties: Sequence[float] = SETTINGS.ties) -> list[RowScore]:
    """The one score that there is, whatever the ties: rows follow nothing."""
    return [RowScore.of(fit)]


@dataclass(frozen=True, eq=False)
class Model:
    """A law fitted to all stretches, and what laws fitted to some of them leave of the others."""

    fit: Fit
    unseen: Left

    @property
    def law(self) -> Law:
        """The law with its coefficients."""
        return self.fit.law

    @property
    def is_nameless(self) -> bool:
        """True of a function of any shape as the last effect."""
        return self.law.is_nameless


def loss(fit: Fit, count: float) -> float:
    """Minus the log likelihood of all stretches as so many samples, with its price."""
    return count * len(fit.errors) * cost(fit) + price(fit.law.n_parameters, count)


def as_likely(models: Sequence[Model], count: float, significance: float) -> list[Model]:
    """Those that so many independent samples do not surely speak against beside the likeliest."""
    losses = [loss(one.fit, count) for one in models]
    most = min(losses) - np.log(significance)
    return [one for one, loss in zip(models, losses, strict=True) if loss <= most]


def of_other_kinds(own: PlacedEffect, models: Sequence[Model]) -> tuple[PlacedEffect, ...]:
    """The last effects of models, the first of each kind that is another one."""
    last = (one.law.terms[-1] for one in reversed(models))
    of_kinds = {one.effect.kind: one for one in last if one.effect.kind != own.effect.kind}
    return tuple(of_kinds.values())


@dataclass(frozen=True)
class Finding:
    """An effect that was added, why, and what would have done as well."""

    candidate: PlacedEffect
    p_value: float  # of the fall on stretches that took no part in its fit, times all candidates
    rivals: tuple[PlacedEffect, ...]
    behind: tuple[PlacedEffect, ...]  # other kinds that explain at least half as much
    n_candidates: int
    share: float  # of the squares of such stretches, by which they fall
    longer: float  # how many times the record that would be sure of it, 1 if this one is


def n_happened(findings: Sequence[Finding]) -> int:
    """How many effects at first act once."""
    return [*(one.candidate.effect.acts_once for one in findings), False].index(False)


@dataclass(frozen=True)
class Engine:
    """Estimation of laws, and what they leave of stretches."""

    fitted: Callable[..., Fit]  # a law, stretches; where it may begin
    left_over: Callable[..., Left]  # a fit, other stretches; where their states may begin
    left_of: Callable[..., Array]  # the same by the law alone, which nothing helps
    scores: Callable[..., Sequence[Score]]  # of a fit, by how nodes are tied
    stepped: Callable[[Law, Stretches], Stretches]  # in steps that the law allows
    disturbances: tuple[float, ...]  # of a law, with each of which a first effect is looked for


@dataclass(frozen=True)
class Unseen:
    """Folds of stretches, of which each is predicted by laws fitted to the others."""

    engine: Engine
    stretches: Stretches
    n_jobs: int | None = None

    def model(self, fit: Fit) -> Model:
        """A law fitted to all stretches, and fold by fold."""
        return self._model(fit, list(self._left(fit)))

    def worthwhile(self, fit: Fit, now: Model) -> Model | None:
        """The same; None once the folds that are left cannot make it worth it beside a model."""
        left: list[Array] = []
        for one in self._left(fit):
            left.append(one)
            if most_share(now.unseen, np.vstack(left)) < SETTINGS.worthwhile:
                return None
        return self._model(fit, left)

    def _left(self, fit: Fit) -> Iterable[Array]:
        folds = self.stretches.folds()
        # done one by one, folds after the one that settles the question are never fitted
        how = "generator" if effective_n_jobs(self.n_jobs) == 1 else "list"
        return Parallel(n_jobs=self.n_jobs, return_as=how)(
            delayed(one)(fit, *fold)
            for one, fold in zip([resumable(self._of_fold) for _ in folds], folds, strict=True)
        )

    def _of_fold(self, fit: Fit, train: Sequence[int], test: Sequence[int]) -> Array:
        known, unknown = (fit.courses_of(one) for one in (train, test))
        own = self.stretches.some(train)
        part = self.engine.fitted(fit.law, own, known, fit.noise, turns=1)
        return self.engine.left_over(part, self.stretches.some(test), unknown).samples

    def _model(self, fit: Fit, left: Sequence[Array]) -> Model:
        tested = [number for _, test in self.stretches.folds() for number in test]
        return Model(fit, Left(np.vstack(left), self.stretches.some(tested).series))


RATES = Engine(
    estimate.fitted,
    estimate.left_over,
    estimate.rolled_out,
    scan.scores,
    estimate.stepped,
    SETTINGS.disturbances,
)
QUANTITIES = Engine(
    fitted,
    left_over,
    left_of,
    scores,
    lambda _, own: own,
    SETTINGS.disturbances[:1],  # nothing is rolled out
)
