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
from swsysid.refinement._shooting import Blocks, Shooting

__all__ = ["WholeRollouts"]


class WholeRollouts:
    """Residuals and Jacobian as functions of parameters and initial states.

    Parameters
    ----------
    shooting : Shooting
        Segments of the records, so many that they are worth a few passes.
    whole : Shooting
        The same records uncut, for where the passes do not close the defects.
    nodes : ndarray of shape (n_segments, n_states)
        First guess of the states at which the segments begin.
    joined : bool
        False leaves the segments apart, each with an initial state of its own.
    """

    def __init__(self, shooting: Shooting, whole: Shooting, nodes: Array, joined: bool):
        self.shooting, self.whole, self.nodes = shooting, whole, nodes
        segments = shooting.segments
        self.piece = segments.record if joined else np.arange(len(segments))
        self.first = np.flatnonzero(np.diff(self.piece, prepend=-1))
        self.follower = np.flatnonzero(np.diff(self.piece) == 0)

    def residuals(self, unknowns: Array) -> Array:
        """Residuals of all samples along whole rollouts."""
        vector, starts = self.shooting.split(unknowns)
        read, _ = self._closed(vector, starts)
        return self.shooting.misfit(read[None])[0]

    def jacobian(self, unknowns: Array) -> Array:
        """Derivatives of `residuals`, (n_residuals, n_unknowns)."""
        vector, starts = self.shooting.split(unknowns)
        _, nodes = self._closed(vector, starts)
        self.nodes = nodes  # least squares asks for a Jacobian where it has arrived
        blocks = self.shooting.blocks(vector, nodes)
        return np.nan_to_num(self._condensed(blocks))

    def information(self, unknowns: Array) -> tuple[Array, Array, NDArray[np.intp]]:
        """What the data say about the parameters alone, the initial states eliminated.

        Returns
        -------
        slopes : ndarray of shape (n_residuals, n_parameters)
        residuals : ndarray of shape (n_residuals,)
        piece : ndarray of shape (n_residuals,)
            Number of the rollout of each residual.
        """
        p, n = self.shooting.n_parameters, self.shooting.maps.n_states
        whole = self.jacobian(unknowns)
        slopes, piece = whole[:, :p], self.piece[self.shooting.segment]
        for place, k in enumerate(self.piece[self.first]):
            rows = piece == k
            basis = _orthonormal(whole[rows, p + n * place : p + n * (place + 1)])
            slopes[rows] -= basis @ (basis.T @ slopes[rows])
        return slopes, self.residuals(unknowns), piece

    # -- continuity ------------------------------------------------------------------------

    def _closed(self, vector: Array, starts: Array) -> tuple[Array, Array]:
        """Readings along rollouts without defects, and where their segments begin."""
        if len(self.first) == len(self.piece):
            return self.shooting.outputs(vector[None], starts[None])[0][0], starts
        shooting, nodes = self.shooting, self.nodes.copy()
        bound, unit = shooting.units.bound, shooting.units.states
        for _ in range(shooting.settings.most_passes):
            read, ends, slopes = shooting.ends(vector, nodes)
            moves = np.zeros_like(nodes)
            moves[self.first] = starts - nodes[self.first]
            for k in self.follower:
                moves[k + 1] = ends[k] + slopes[k] @ moves[k] - nodes[k + 1]
            if not np.isfinite(moves).all() or (np.abs(nodes + moves) > bound).any():
                break
            nodes += moves
            if np.abs(moves / unit).max() < shooting.settings.closed:
                return read, nodes
        return self.uncut(vector, starts)

    def uncut(self, vector: Array, starts: Array) -> tuple[Array, Array]:
        """The same by one long integration."""
        segments = self.shooting.segments
        read, states = self.whole.whole_states(vector, starts)
        nodes = states[segments.first, segments.record]
        pieces = np.full(segments.y.shape, np.nan)
        for s, (first, count) in enumerate(zip(segments.first, segments.count, strict=True)):
            pieces[: count + 1, s] = read[first : first + count + 1, segments.record[s]]
        return pieces, nodes

    def _condensed(self, blocks: Blocks) -> Array:
        """The Jacobian with the inner states eliminated."""
        p, n = self.shooting.n_parameters, self.shooting.maps.n_states
        whole = np.zeros((len(blocks.residuals), p + n * len(self.first)))
        whole[:, :p] = blocks.by_parameters
        limits = np.searchsorted(self.shooting.segment, np.arange(len(self.piece) + 1))
        place = -1
        for s, (low, high) in enumerate(zip(limits[:-1], limits[1:], strict=True)):
            if place < 0 or self.piece[s] != self.piece[s - 1]:
                place, chain = place + 1, np.hstack([np.zeros((n, p)), np.eye(n)])
            rows = blocks.by_start[low:high] @ chain
            whole[low:high, :p] += rows[:, :p]
            whole[low:high, p + n * place : p + n * (place + 1)] = rows[:, p:]
            chain = blocks.end_by_start[s] @ chain
            chain[:, :p] += blocks.end_by_parameters[s]
        return whole


def _orthonormal(columns: Array) -> Array:
    """Orthonormal basis of the span of columns."""
    left, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    return left[:, sizes > 1e-10 * max(sizes.max(initial=0.0), 1e-300)]
