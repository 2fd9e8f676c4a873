"""What laws fitted to some stretches leave of the others, fold by fold."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from joblib import Parallel, delayed, effective_n_jobs

from swsysid._journal import resumable
from swsysid._output_error.criterion import Left, most_share
from swsysid._output_error.engines import Engine, Model
from swsysid._output_error.estimate import Fit
from swsysid._output_error.settings import SETTINGS
from swsysid._output_error.stretches import Stretches
from swsysid._results import Array


@dataclass(frozen=True)
class Unseen:
    """The folds of some stretches."""

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
