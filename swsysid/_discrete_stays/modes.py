"""Modes of rows by the filter of their states: for known laws and noise where it was measured.

A row by itself says little where noise is as large as what tells two laws apart. The filter knows
the states from all rows before, so that a mode shows in where the states go.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._discrete_stays.data import DiscreteData
from swsysid._discrete_stays.known_guard import KnownGuard
from swsysid._discrete_stays.rows import (
    RowFit,
    as_fit,
    assigned,
    row_costs,
    scale_of,
    switching_of,
)
from swsysid._discrete_stays.states import StateFit
from swsysid._discrete_stays.switching import Switching
from swsysid._results import Array
from swsysid._stays.decoding import decode
from swsysid._stays.filtering import Belief
from swsysid._stays.laws import Laws, Modes, slopes_of
from swsysid._stays.recordings import Recordings


def reassigned(data: DiscreteData, fit: RowFit, found: StateFit) -> tuple[RowFit, float]:
    """The modes of all rows for laws and noise of highest likelihood, and that in nats."""
    problem, likelihood = data.problem, 0.0
    unexplained = _unexplained(data, fit, found)
    scale = scale_of(problem, found.coef, np.where(unexplained, -1, fit.modes))
    modes = assigned(problem, found.coef, scale, fit.switching).modes
    if len(found.coef) > 1 and not unexplained.all():
        pieces = _pieces(data, unexplained)
        side_by_side = _side_by_side(data, pieces)
        maps = MapFilter.of(data, found, fit.switching, fit.guards, side_by_side.u)
        decoded = decode(maps, side_by_side, price=0.0, n_kept=data.settings.n_kept)
        likelihood = float(decoded.log_likelihood.sum())
        for place, piece in enumerate(pieces):
            inner = slice(piece.first - piece.begin, piece.last - piece.begin)
            modes[piece.first : piece.last] = decoded.modes[inner, place]
    switching = switching_of(np.where(unexplained, -1, modes), problem)
    costs = row_costs(problem, found.coef, scale)
    again = replace(
        as_fit(problem, found.coef, scale, switching, modes, costs),
        unexplained=unexplained,
        history=fit.history,
        guards=fit.guards,
    )
    if fit.guards:
        again = replace(again, of_switches=_of_switches(data, again, found))
    return again, likelihood


def _of_switches(data: DiscreteData, fit: RowFit, found: StateFit) -> float:
    """Nats that modes take where guards tell them, states no better known than measured."""
    told = ~fit.unexplained
    rows = np.flatnonzero(told & np.append(False, told[:-1]) & ~data.rows.begins)
    mean = found.states[found.back[rows, 1:]].reshape(len(rows), -1)
    variance = np.tile(np.square(found.noise), data.rows.lags + 1)
    covariance = np.tile(np.diag(variance), (len(rows), 1, 1))
    switching = Switching.of(data, len(found.coef), fit.switching, fit.guards)
    modes, u = fit.modes, data.columns[rows, data.n_lagged :]
    return float(-switching.nats(modes[rows - 1], modes[rows], mean, covariance, u).sum())


def _unexplained(data: DiscreteData, fit: RowFit, found: StateFit) -> NDArray[np.bool_]:
    """Rows between states that are no disturbance apart, or, so far unexplained, no noise."""
    allowed = found.tie * found.noise
    nats = (0.5 * np.square(found.left / allowed) + np.log(allowed)).sum(axis=1)
    rows, n_lagged = np.flatnonzero(fit.unexplained), data.n_lagged
    before = found.states[found.back[rows, 1:]].reshape(len(rows), n_lagged)
    features = data.features(np.hstack([before, data.columns[rows, n_lagged:]]))
    left = found.states[found.back[rows, 0]] - features @ found.coef.transpose(0, 2, 1)
    by_noise = 0.5 * np.square(left / fit.scale[:, None]) + np.log(fit.scale)[:, None]
    nats[rows] = by_noise.sum(axis=2).min(axis=0)
    return np.asarray(nats > -np.log(data.settings.unexplained))


@dataclass(frozen=True)
class _Piece:
    """Rows `first` to `last`, and those from `begin` to `end` that surround them."""

    begin: int
    first: int
    last: int
    end: int


def _pieces(data: DiscreteData, unexplained: NDArray[np.bool_]) -> list[_Piece]:
    """Stretches of explained rows, long ones in pieces that overlap."""
    settings, inside = data.settings, ~unexplained
    begins = inside & (data.rows.begins | np.append(True, unexplained[:-1]))
    ends = inside & np.append((data.rows.begins | unexplained)[1:], True)
    pieces = []
    for begin, end in zip(np.flatnonzero(begins), np.flatnonzero(ends) + 1, strict=True):
        count = max(1, round((end - begin) / settings.decoded))
        edges = np.linspace(begin, end, count + 1).round().astype(int).tolist()
        for first, last in zip(edges[:-1], edges[1:], strict=True):
            around = max(begin, first - settings.overlap), min(end, last + settings.overlap)
            pieces.append(_Piece(around[0], first, last, around[1]))
    return pieces


def _side_by_side(data: DiscreteData, pieces: list[_Piece]) -> Recordings:
    """Lagged states of the pieces: the first row tells all of them, the others the newest."""
    rows, n = data.rows, data.rows.n_states
    n_lagged, longest = n * (rows.lags + 1), max(piece.end - piece.begin for piece in pieces)
    measured = rows.columns[:, :n_lagged] / data.column_unit[:n_lagged]
    steps = np.zeros((longest, len(pieces)))
    y = np.full((longest + 1, len(pieces), n_lagged), np.nan)
    u = np.zeros((longest + 1, len(pieces), rows.columns.shape[1] - n_lagged))
    for place, piece in enumerate(pieces):
        own, count = slice(piece.begin, piece.end), piece.end - piece.begin
        steps[:count, place] = 1.0
        y[0, place] = measured[piece.begin]
        y[1 : count + 1, place, :n] = rows.targets[own] / data.target_unit
        u[:count, place] = rows.columns[own, n_lagged:]
    guess = np.nan_to_num(y)
    times = tuple(np.arange(piece.end - piece.begin + 1.0) for piece in pieces)
    sampled = tuple(np.arange(len(t)) for t in times)
    return Recordings(times, sampled, steps, y, u, guess, first_step=1.0)


@dataclass(frozen=True)
class MapFilter:
    """Kalman's filter of the lagged states of maps; a switch is at a sample."""

    laws: Laws
    noise: Array  # (n_lagged,)
    disturbance: Array  # (n_lagged,)
    u: Array  # (n_rows, n_pieces, n_inputs)
    switching: Switching
    farthest: float  # a state that is further off says nothing

    @classmethod
    def of(
        cls,
        data: DiscreteData,
        found: StateFit,
        probability: float,
        guards: tuple[KnownGuard, ...],
        u: Array,
    ) -> MapFilter:
        """The filter of identified laws, states in units of the data."""
        n, memory = data.rows.n_states, data.rows.lags + 1
        laws = Laws(found.coef, data.features, np.ones(n * memory), np.zeros_like(found.coef) > 0)
        disturbance = np.zeros(n * memory)
        farthest = data.settings.farthest * float(np.abs(found.states).max())
        disturbance[:n] = found.tie * found.noise
        switching = Switching.of(data, len(found.coef), probability, guards)
        return cls(laws, np.tile(found.noise, memory), disturbance, u, switching, farthest)

    @property
    def n_modes(self) -> int:
        """Number of modes."""
        return len(self.laws.coef)

    @property
    def spread(self) -> Array:
        """Typical size of each lagged state, in units of the data."""
        return self.laws.spread

    def ahead(self, k: int, belief: Belief, modes: Modes) -> tuple[Belief, Array]:
        """As `swsysid._stays.filtering.Filter.ahead`, every hypothesis by the law of each mode."""
        shape, n_columns = (*modes.shape, self.n_modes), len(belief.mean)
        x = belief.mean.reshape(n_columns, -1).T
        wide = belief.covariance.reshape(n_columns, n_columns, -1).transpose(2, 0, 1)
        u = np.repeat(self.u[k], modes.shape[1], axis=0)
        features, slopes = slopes_of(self.laws.features, np.hstack([x, u]), self.spread)
        n, older = self.laws.coef.shape[1], np.arange(self.laws.coef.shape[1], n_columns)
        transition = np.zeros((len(x), self.n_modes, n_columns, n_columns))
        transition[:, :, :n] = np.matmul(self.laws.coef, slopes[:, None])
        transition[:, :, older, older - n] = 1.0
        mean = np.empty((len(x), self.n_modes, n_columns))
        mean[:, :, :n] = np.einsum("jnf,rf->rjn", self.laws.coef, features)
        mean[:, :, n:] = x[:, None, : n_columns - n]
        lost = ~(np.abs(mean) < self.farthest).all(axis=2)
        mean[lost], transition[lost] = 0.0, np.eye(n_columns) * self.farthest / self.noise
        covariance = transition @ wide[:, None] @ transition.transpose(0, 1, 3, 2)
        every = np.arange(n_columns)
        covariance[:, :, every, every] += self.disturbance**2
        old, new = np.repeat(modes.ravel(), self.n_modes), np.tile(np.arange(self.n_modes), len(x))
        parts = (np.repeat(part, self.n_modes, axis=0) for part in (x, wide, u))
        nats = self.switching.nats(old, new, *parts).reshape(shape)
        ahead = Belief(
            mean.transpose(2, 0, 1).reshape(n_columns, *shape),
            covariance.transpose(2, 3, 0, 1).reshape(n_columns, n_columns, *shape),
        )
        return ahead, nats
