r"""Laws and stays by rows: the most likely modes for given laws, and laws for given modes.

A row whose law is known leaves a normal residual with standard deviations :math:`s_{jc}`; one in
:math:`1/\varepsilon` rows is explained by no law, and only as likely as the spread of the targets
makes it. A recording goes on in its mode, or switches with probability p:

.. math:: \sum_i \min\Big(\sum_c \tfrac12 \frac{r_{ic}^2}{s_{jc}^2} + \log s_{jc},\;
          -\log\varepsilon\Big) + n_\text{switches} \log\frac{(1 - p)(M - 1)}{p}

is descended by dynamic programming over the modes in turn with least squares over the laws. Rows
that straddle a jump of the state are among those that no law explains. Two fits are compared with
the shares of such rows and of switches that they have themselves.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swsysid._discrete_stays.lagged import KnownGuard, Labels
from swsysid._known.region import Region
from swsysid._losses.within import Block, least_within
from swsysid._noise import robust_scale
from swsysid._results import Array
from swsysid._stays.decoding import cheapest_modes

# Of a value: what is left undecided, by rounding or by terms that laws lack (8e-12 of a published
# spacecraft, which got three modes for that where it was 1e-14); of a feature: by which it differs
# from combinations of others.
_ROUNDING, DEPENDENT = 1e-11, 1e-11
# Probability beforehand of a row that no law explains, and of a switch.
UNEXPLAINED, SWITCHING = 1e-3, 0.02
# Alternation: by how much a scale may shrink at once, what it keeps at the end, most rounds.
_SHRINKS, _SETTLED, _MOST_ROUNDS = 0.1, 0.99, 40


@dataclass(frozen=True)
class RowProblem:
    """Features and targets in their own units, and where stretches of successive rows begin."""

    features: Array  # (n_rows, n_features)
    targets: Array  # (n_rows, n_states)
    begins: NDArray[np.bool_]
    memory: Labels  # (n_features,): the longest lag that each feature sees
    known: Callable[[int], Region] | None = None  # of so many laws; None where nothing is known

    @cached_property
    def floor(self) -> Array:
        """Residuals that rounding leaves, (n_states,)."""
        return _ROUNDING * np.sqrt(np.square(self.targets).mean(axis=0)).clip(1.0)

    @cached_property
    def places(self) -> tuple[Labels, Labels]:
        """Place within its stretch, and stretch, of every row."""
        stretch = np.cumsum(self.begins) - 1
        first = np.flatnonzero(self.begins)
        return np.arange(len(stretch)) - first[stretch], stretch

    def residuals(self, coef: Array) -> Array:
        """What laws (n_laws, n_states, n_features) leave, (n_laws, n_rows, n_states)."""
        return self.targets - np.matmul(self.features, coef.transpose(0, 2, 1))


@dataclass(frozen=True)
class RowFit:
    """Laws, the modes of the rows, and what they are worth.

    `cost` is what is descended, in nats, with what the coefficients take.
    """

    coef: Array  # (n_modes, n_states, n_features)
    modes: Labels  # (n_rows,)
    unexplained: NDArray[np.bool_]  # (n_rows,)
    scale: Array  # (n_modes, n_states): of what the laws leave
    switching: float  # probability
    cost: float
    of_switches: float  # its part that switches take
    history: tuple[float, ...] = ()
    guards: tuple[KnownGuard, ...] = ()  # of these modes, where they are known

    @property
    def lawful(self) -> Labels:
        """Modes, -1 for rows that no law explains."""
        return np.where(self.unexplained, -1, self.modes)

    def take(self, rows: NDArray) -> RowFit:
        """The same laws on some of the rows."""
        return replace(self, modes=self.modes[rows], unexplained=self.unexplained[rows])


def alternate(problem: RowProblem, coef: Array, free: NDArray[np.bool_] | None = None) -> RowFit:
    """Modes and laws in turn until the modes stay; `free` (n_modes, n_features) are in a law."""
    free = np.ones(coef[:, 0].shape, dtype=bool) if free is None else free
    scale = _first_scale(problem, coef)
    switching, modes, history = SWITCHING, None, []
    for _ in range(_MOST_ROUNDS):
        fit = assigned(problem, coef, scale, switching)
        history.append(fit.cost)
        same = modes is not None and np.array_equal(modes, fit.lawful)
        modes = fit.lawful
        coef = fitted(problem, modes, coef, free)
        reached = scale_of(problem, coef, modes, free.sum(axis=1))
        settled = same and (reached >= _SETTLED * scale).all()
        scale = reached if same else np.maximum(reached, _SHRINKS * scale)
        switching = switching_of(modes, problem)
        if settled:
            break
    fit = assigned(problem, coef, scale, switching)
    return replace(fit, cost=fit.cost + worth(problem, fit, free), history=tuple(history))


def _first_scale(problem: RowProblem, coef: Array) -> Array:
    """Scales of laws on the rows to which they are nearest: a law that is right is exact there."""
    left = problem.residuals(coef)
    nearest = np.square(left).sum(axis=2).argmin(axis=0)
    scale = np.ones(coef.shape[:2])
    for mode in np.unique(nearest):
        scale[mode] = robust_scale(left[mode, nearest == mode])
    return np.maximum(scale, problem.floor)


def scale_of(problem: RowProblem, coef: Array, modes: Labels, n_free: int | NDArray = 0) -> Array:
    """Deviation of what each law leaves, (n_modes, n_states); of all laws where rows are few."""
    squares, counts = np.zeros(coef.shape[:2]), np.zeros(len(coef))
    for mode, law in enumerate(coef):
        rows = modes == mode
        left = problem.targets[rows] - problem.features[rows] @ law.T
        squares[mode], counts[mode] = np.square(left).sum(axis=0), len(left)
    freedom = (counts - n_free)[:, None]
    joint = squares.sum(axis=0) / max(1.0, float(freedom.clip(0.0).sum()))
    few = freedom < np.broadcast_to(n_free, counts.shape)[:, None]
    variance = np.where(few, joint, squares / np.maximum(freedom, 1.0))
    return np.maximum(np.sqrt(variance), problem.floor)


def assigned(problem: RowProblem, coef: Array, scale: Array, switching: float) -> RowFit:
    """The most likely modes for given laws."""
    costs = row_costs(problem, coef, scale)
    price = _price(len(coef), switching)
    modes = cheapest_modes(costs, problem.begins, price)
    return as_fit(problem, coef, scale, switching, modes, costs)


def of_modes(problem: RowProblem, modes: Labels, n_modes: int) -> RowFit:
    """Laws of least squares of given modes, -1 for rows that no law explains."""
    free = np.ones((n_modes, problem.features.shape[1]), dtype=bool)
    coef = np.zeros((n_modes, problem.targets.shape[1], problem.features.shape[1]))
    coef = fitted(problem, modes, coef, free)
    scale = scale_of(problem, coef, modes, free.sum(axis=1))
    costs = row_costs(problem, coef, scale)
    fit = as_fit(problem, coef, scale, switching_of(modes, problem), modes.clip(0), costs)
    return replace(fit, unexplained=modes < 0)


def _price(n_modes: int, switching: float) -> float:
    """Nats that a switch takes."""
    return max(0.0, float(np.log((1.0 - switching) / switching * max(1, n_modes - 1))))


def row_costs(problem: RowProblem, coef: Array, scale: Array) -> Array:
    """Nats of every row in every mode, at most those of a row that no law explains."""
    squares = np.square(problem.residuals(coef) / scale[:, None]).sum(axis=2)
    costs = (0.5 * squares + np.log(scale).sum(axis=1)[:, None]).T
    return np.minimum(costs, -np.log(UNEXPLAINED))


def as_fit(
    problem: RowProblem, coef: Array, scale: Array, switching: float, modes: Labels, costs: Array
) -> RowFit:
    """Laws and modes with what they are worth."""
    own = costs[np.arange(len(modes)), modes]
    n_switches = int(np.count_nonzero((np.diff(modes) != 0) & ~problem.begins[1:]))
    price = _price(len(coef), switching)
    of_switches = float(price * n_switches - len(modes) * np.log1p(-switching))
    unexplained = own >= -np.log(UNEXPLAINED)
    cost = float(own[~unexplained].sum()) + nats_of_unexplained(unexplained) + of_switches
    return RowFit(coef, modes, unexplained, scale, switching, cost, of_switches)


def nats_of_unexplained(unexplained: NDArray[np.bool_]) -> float:
    """What rows without a law take, given how many of them there are."""
    count, n = np.count_nonzero(unexplained), len(unexplained)
    share = (count + 0.5) / (n + 1.0)
    return float(-count * np.log(share) - (n - count) * np.log1p(-share))


def fitted(problem: RowProblem, modes: Labels, coef: Array, free: NDArray[np.bool_]) -> Array:
    """Laws of least squares; a mode without rows keeps its law.

    In a mode of short memory longer lags repeat what shorter ones tell, and no row but the first
    one after a switch says which of them the law sees: it is the shorter ones.
    """
    coef = coef.copy()
    if problem.known is not None:
        return _fitted_within(problem, problem.known(len(coef)), modes, coef, free)
    for mode, columns in enumerate(free):
        rows = modes == mode
        if rows.any():
            coef[mode] = law_of(problem, rows, columns)
    return coef


def _fitted_within(
    problem: RowProblem, region: Region, modes: Labels, coef: Array, free: NDArray[np.bool_]
) -> Array:
    """The same of laws that modes and equations may share, of what is known."""
    own = np.repeat(free[:, None], coef.shape[1], axis=1)
    coef = region.nearest(np.where(own, coef, 0.0), own, np.eye(int(own.sum())))
    own &= (np.bincount(modes[modes >= 0], minlength=len(coef)) > 0)[:, None, None]
    place, blocks = np.cumsum(own).reshape(own.shape) - 1, []
    for mode, columns in enumerate(free):
        rows = np.flatnonzero(modes == mode)
        features = problem.features[rows]
        for state, law in enumerate(coef[mode]):
            left = problem.targets[rows, state] - features @ law
            places = place[mode, state][own[mode, state]]
            used = features[:, columns] if len(places) else features[:0, :0]
            blocks.append(Block(used, left[: len(used)], np.ones(len(used)), rows, places))
    coef[own] += least_within("squared", blocks, region.steps(coef, own))
    return coef.clip(*region.box)


def law_of(problem: RowProblem, rows: NDArray, columns: NDArray[np.bool_] | None = None) -> Array:
    """The law of least squares of some rows, (n_states, n_features), zero but in some columns."""
    features, targets = problem.features[rows], problem.targets[rows]
    law = np.zeros((targets.shape[1], features.shape[1]))
    every = np.arange(features.shape[1]) if columns is None else np.flatnonzero(columns)
    used = _independent(features, every, problem)
    law[:, used] = np.linalg.lstsq(features[:, used], targets, rcond=None)[0].T
    return law


def _independent(
    features: Array, columns: NDArray[np.intp], problem: RowProblem
) -> NDArray[np.intp]:
    """Those of some columns that are no combination of others with shorter memory."""
    ordered = columns[np.argsort(problem.memory[columns], kind="stable")]
    if len(features) < len(ordered):
        return ordered
    own = np.abs(np.diag(np.linalg.qr(features[:, ordered], mode="r")))
    size = np.linalg.norm(features[:, ordered], axis=0)
    return ordered[own > DEPENDENT * size]


def worth(problem: RowProblem, fit: RowFit, free: NDArray[np.bool_]) -> float:
    r"""Nats that the coefficients take.

    With a normal prior of unit deviation they are :math:`\tfrac12 \log\det(I + \Phi^\top\Phi /
    s_c^2)` for every law and state: of noise and number of rows, and as much as a row for a
    coefficient that explains nothing but one row.
    """
    nats = 0.0
    for mode, columns in enumerate(free):
        rows = fit.lawful == mode
        singular = np.linalg.svd(problem.features[rows][:, columns], compute_uv=False)
        nats += 0.5 * float(np.log1p(np.square(singular / fit.scale[mode][:, None])).sum())
    return nats


def switching_of(modes: Labels, problem: RowProblem) -> float:
    """Probability of a switch, from the rows that have a mode."""
    inside = ~problem.begins[1:] & (modes[1:] >= 0) & (modes[:-1] >= 0)
    switches = np.count_nonzero(np.diff(modes)[inside])
    return float((switches + 0.5) / (np.count_nonzero(inside) + 1.0))
