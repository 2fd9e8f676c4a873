r"""What the states of a map have shown of a force, one step before each row.

A state :math:`x_k = \varphi_{k-1}^\top c + d_{k-1}` shows the force d of the step before as exactly
as states are measured, often better than the residuals of noisy targets do. Whatever remembers
inputs helps an observer to tell that force from the states, and so seems to act wherever there is
one. Beside the force that the law itself leaves of that step,

.. math:: y_k = \varphi_k^\top c + \rho\,(x_k - \varphi_{k-1}^\top c) + e_k,

it does not, unless it acts. For a given :math:`\rho` this is a linear regression of
:math:`y_k - \rho x_k` on :math:`\varphi_k - \rho \varphi_{k-1}` (Cochrane and Orcutt, 1949).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from swsysid._effect_search.folds import SearchData
from swsysid._results import Array


@dataclass(frozen=True)
class StepBefore:
    """The row before each row of a search, where it is one of these, and what the state was."""

    rows: NDArray[np.intp]  # of those searched that have one
    before: NDArray[np.intp]
    state: Array  # (n_rows,)

    @classmethod
    def of(cls, data: SearchData, target: int) -> StepBefore:
        """Neighbours in the trajectories of the record, no longer than a gap apart."""
        records, number = data.records, np.full(len(data.records), -1)
        assert records.t is not None
        number[data.rows] = np.arange(len(data.rows))
        pairs = np.hstack([np.stack([rows[:-1], rows[1:]]) for rows in records.trajectories])
        near = (
            np.abs(np.diff(records.t[pairs], axis=0)[0]) <= data.settings.gap_steps * records.step
        )
        before, rows = number[pairs[:, near]]
        known = (before >= 0) & (rows >= 0)
        return cls(rows[known], before[known], records.X[data.rows, target])

    def law(
        self, features: Array, targets: Array, usual: NDArray[np.intp]
    ) -> tuple[Array, float, float]:
        """Coefficients of a law beside the force that it shows, and what it leaves of usual rows.

        The squares are those of the law alone, and beside the force.
        """
        earlier, shown = np.zeros_like(features), np.zeros_like(targets)
        earlier[self.rows], shown[self.rows] = features[self.before], self.state[self.rows]
        columns = np.column_stack([features, targets, earlier, shown])
        now, then = np.hsplit(np.linalg.qr(columns[usual], mode="r"), 2)

        def fitted(share: float) -> tuple[Array, float]:
            rest = now - share * then
            coef = np.linalg.lstsq(rest[:, :-1], rest[:, -1], rcond=None)[0]
            return np.asarray(coef), float(np.sum((rest[:, -1] - rest[:, :-1] @ coef) ** 2))

        best = minimize_scalar(lambda share: fitted(share)[1], bounds=(0.0, 1.0), method="bounded")
        return fitted(best.x)[0], fitted(0.0)[1], float(best.fun)
