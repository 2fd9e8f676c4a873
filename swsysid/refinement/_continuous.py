r"""Whole rollouts by their segments: single shooting at the cost of multiple shooting.

The unknowns are the parameters and the initial state of each record; the states at which later
segments begin follow from continuity. For given unknowns they solve :math:`s_{k+1} = x_k(s_k)`
by Newton's method over all segments at once,

.. math::

    \delta_{k+1} = x_k(s_k) + G_k \delta_k - s_{k+1},
    \qquad G_k = \partial x_k / \partial s_k,

a few passes of length one segment instead of one of the length of the record. The Jacobian is
that of `Shooting` with the inner states eliminated by the same recursion. Unlike a penalty of
the defects this leaves no narrow valley that least squares would have to follow in small steps.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array
from swsysid.refinement._settings import SETTINGS
from swsysid.refinement._shooting import Shooting


class WholeRollouts:
    """Residuals and Jacobian as functions of parameters and initial states.

    `shooting` has so many segments that they are worth a few passes; `whole` has the same records
    uncut, for where the passes do not close the defects. The segments begin about `nodes`; not
    `joined` they stay apart, each with an initial state of its own.
    """

    def __init__(self, shooting: Shooting, whole: Shooting, nodes: Array, joined: bool):
        self.shooting, self.whole, self.nodes = shooting, whole, nodes
        segments = shooting.segments
        self.piece = segments.record if joined else np.arange(len(segments))
        self.first = np.flatnonzero(np.diff(self.piece, prepend=-1))
        self.follower = np.flatnonzero(np.diff(self.piece) == 0)

    def residuals(self, unknowns: Array) -> Array:
        """Residuals of all samples along whole rollouts."""
        read, _ = self._closed(*self.shooting.split(unknowns))
        return self.shooting.misfit(read[None])[0]

    def jacobian(self, unknowns: Array) -> Array:
        """Derivatives of `residuals`, (n_residuals, n_unknowns), the inner states eliminated."""
        vector, starts = self.shooting.split(unknowns)
        # least squares asks for a Jacobian where it has arrived
        _, self.nodes = self._closed(vector, starts)
        slopes, end_slopes = self.shooting.slopes(vector, self.nodes)
        p, n = len(vector), self.shooting.maps.n_states
        whole = np.zeros((len(slopes), p + n * len(self.first)))
        limits = np.searchsorted(self.shooting.segment, np.arange(len(self.piece) + 1))
        place = -1
        for s, (low, high) in enumerate(zip(limits[:-1], limits[1:], strict=True)):
            if place < 0 or self.piece[s] != self.piece[s - 1]:
                place, chain = place + 1, np.hstack([np.zeros((n, p)), np.eye(n)])
            rows = slopes[low:high, p:] @ chain
            whole[low:high, :p] = slopes[low:high, :p] + rows[:, :p]
            whole[low:high, p + n * place : p + n * (place + 1)] = rows[:, p:]
            chain = end_slopes[s, :, p:] @ chain
            chain[:, :p] += end_slopes[s, :, :p]
        return np.nan_to_num(whole)

    def information(self, unknowns: Array) -> tuple[Array, Array, NDArray[np.intp]]:
        """What the data say about the parameters alone, the initial states eliminated.

        Slopes (n_residuals, n_parameters), residuals, and the number of the rollout of each.
        """
        n, whole = self.shooting.maps.n_states, self.jacobian(unknowns)
        p = len(unknowns) - n * len(self.first)
        slopes, piece = whole[:, :p], self.piece[self.shooting.segment]
        for place, k in enumerate(self.piece[self.first]):
            rows = piece == k
            by_start = whole[rows, p + n * place : p + n * (place + 1)]
            basis, sizes, _ = np.linalg.svd(by_start, full_matrices=False)
            basis = basis[:, sizes > 1e-10 * max(sizes.max(initial=0.0), 1e-300)]
            slopes[rows] -= basis @ (basis.T @ slopes[rows])
        return slopes, self.residuals(unknowns), piece

    def _closed(self, vector: Array, starts: Array) -> tuple[Array, Array]:
        """Readings along rollouts without defects, and where their segments begin."""
        if len(self.first) == len(self.piece):
            return self.shooting.outputs(vector[None], starts[None])[0][0], starts
        shooting, nodes = self.shooting, self.nodes.copy()
        for _ in range(SETTINGS.most_passes):
            read, ends, slopes = shooting.ends(vector, nodes)
            moves = np.zeros_like(nodes)
            moves[self.first] = starts - nodes[self.first]
            for k in self.follower:
                moves[k + 1] = ends[k] + slopes[k] @ moves[k] - nodes[k + 1]
            if not (np.abs(nodes + moves) <= shooting.units.bound).all():
                break
            nodes += moves
            if np.abs(moves / shooting.units.states).max() < SETTINGS.closed:
                return read, nodes
        return self.uncut(vector, starts)

    def uncut(self, vector: Array, starts: Array) -> tuple[Array, Array]:
        """The same by one long integration."""
        segments = self.shooting.segments
        read, states, _ = self.whole.states(vector[None], starts[None])
        nodes = states[segments.first, 0, segments.record]
        pieces = np.full(segments.y.shape, np.nan)
        for s, (record, first) in enumerate(segments.places):
            stop = segments.count[s] + 1
            pieces[:stop, s] = read[0, first : first + stop, record]
        return pieces, nodes
