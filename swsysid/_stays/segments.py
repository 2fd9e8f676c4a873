r"""Intervals of one mode that follow each other, their inner nodes eliminated in pairs.

What an interval says of the nodes a and b at its ends and of the corner z is a quadratic form. Two
intervals that meet in a node k become one: with :math:`L L^\top` the block of k,
:math:`E_k, C, D` its rows in the columns of the corner, a and b, and :math:`Y = L^{-1} E_k` and so
on, the border of a loses :math:`C^\top L^{-\top} Y`, the corner :math:`Y^\top Y`. All pairs of all
segments are worked at once, in as many turns as a segment's length can be halved.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError

from swsysid._results import Array
from swsysid._stays.nodes import Rows


class Eliminated(NamedTuple):
    """Nodes that were eliminated, (n_pairs, n_segments), and what tells them from the others."""

    nodes: Rows
    before: Rows
    after: Rows
    root: Array  # L, its diagonal inverted, (n_states, n_states, ...)
    border: Array  # Y of the corner and of what is right, (n_columns + 1, n_states, ...)
    by_before: Array  # (n_states, n_states, ...): entries by the first index of the second
    by_after: Array

    def told(self, states: Array, corner: Array) -> None:
        """Put the solution into `states` (n_states, n_nodes), from that of the other nodes."""
        left = np.tensordot(np.append(-corner, 1.0), self.border, 1)
        left -= np.einsum("akps,aps->kps", self.by_before, states[:, self.before])
        left -= np.einsum("bkps,bps->kps", self.by_after, states[:, self.after])
        for row in reversed(range(len(left))):
            left[row] -= np.einsum("kps,kps->ps", self.root[row + 1 :, row], left[row + 1 :])
            left[row] *= self.root[row, row]
        states[:, self.nodes] = left


@dataclass(frozen=True)
class Ties:
    """Forms of intervals, n_pairs of them joined in each segment; what is right is a last column.

    Entries of two nodes stand by the first index for `before`, by the second for `after`; those
    that are the same for all intervals, as of a linear law, are kept once, (n_states, n_states, 1,
    1).
    """

    columns: NDArray[np.intp]  # of the corner
    before: Rows  # (n_pairs, n_segments): node where each begins, and ends
    after: Rows
    of_before: Array  # border, (n_columns + 1, n_states, n_pairs, n_segments)
    of_after: Array
    before_before: Array  # (n_states, n_states, n_pairs, n_segments)
    before_after: Array
    after_after: Array
    corner: Array  # (n_columns + 1, n_columns + 1)

    @classmethod
    def of(cls, columns: NDArray[np.intp], first: Rows, F: Array, H: Array, weight: Array) -> Ties:
        """From gaps, weight (n_states, n_rows) times the states after and F, H times the others.

        F are minus derivatives by the state before, H by the corner, and minus the gap; rows last,
        the first ones of all segments first.
        """
        corner = H.reshape(len(H), -1)
        corner = corner @ corner.T
        F, H, weight = (
            one.reshape(*one.shape[:-1], *(first.shape if one.shape[-1] > 1 else (1, 1)))
            for one in (F, H, weight)
        )
        square, every = np.zeros_like(F), np.arange(len(F))
        square[every, every] = np.square(weight)
        return cls(
            columns, first, first + 1,
            _product(F.swapaxes(0, 1), H),
            -weight * H,
            np.einsum("akps,bkps->abps", F, F),
            -weight * F,
            square,
            corner,
        )  # fmt: skip

    def joined(self, diagonal: Array, right: Array) -> tuple[Ties, list[Eliminated]]:
        """Each segment as one form; nodes have a diagonal (n_states, n_nodes) of their own."""
        ties, turns = self, []
        while len(ties.before) > 1:
            ties, eliminated = ties.paired(diagonal, right)
            turns.append(eliminated)
        return ties, turns

    def paired(self, diagonal: Array, right: Array) -> tuple[Ties, Eliminated]:
        """Every two neighbours of a segment as one, the nodes in which they meet eliminated."""
        first, second = (
            [part[:, :, side::2] if part.shape[2] > 1 else part for part in (
                self.of_before, self.of_after, self.before_before, self.before_after,
                self.after_after,
            )]
            for side in (0, 1)
        )  # fmt: skip
        nodes = self.after[0::2]
        block, every = first[4] + second[2], np.arange(len(diagonal))
        own = diagonal[:, nodes]
        if block.shape[2:] == (1, 1) and (own.max(axis=(1, 2)) == own.min(axis=(1, 2))).all():
            own = own[:, :1, :1]
        elif block.shape[2:] == (1, 1):
            block = np.tile(block, (1, 1, *nodes.shape))
        block[every, every] += own
        root = _cholesky(block)
        border = first[1] + second[0]
        border[-1] += right[:, nodes]
        border = _solved(root, border)
        by_before, by_after = (
            _solved(root, np.broadcast_to(one, (*one.shape[:2], *root.shape[2:])).copy())
            for one in (first[3], second[3].swapaxes(0, 1))
        )
        flat = border.reshape(len(border), -1)
        eliminated = Eliminated(
            nodes, self.before[0::2], self.after[1::2], root, border, by_before, by_after
        )
        ties = Ties(
            self.columns, eliminated.before, eliminated.after,
            first[0] - _product(by_before.swapaxes(0, 1), border),
            second[1] - _product(by_after.swapaxes(0, 1), border),
            first[2] - np.einsum("akps,bkps->abps", by_before, by_before),
            -np.einsum("akps,bkps->abps", by_before, by_after),
            second[4] - np.einsum("akps,bkps->abps", by_after, by_after),
            self.corner - flat @ flat.T,
        )  # fmt: skip
        return ties, eliminated


def _cholesky(blocks: Array) -> Array:
    """Lower factors of blocks (n, n, ...), their diagonals inverted."""
    for column in range(len(blocks)):
        own = blocks[column, :column]
        pivot = blocks[column, column] - np.square(own).sum(axis=0)
        if not (pivot > 0.0).all():
            raise LinAlgError("a node is not held")
        blocks[column, column] = 1.0 / np.sqrt(pivot)
        for row in range(column + 1, len(blocks)):
            left = blocks[row, column] - (blocks[row, :column] * own).sum(axis=0)
            blocks[row, column] = left * blocks[column, column]
    return blocks


def _solved(root: Array, right: Array) -> Array:
    """L^-1 times columns (n_columns, n, ...), in their place."""
    for row in range(len(root)):
        for k in range(row):
            right[:, row] -= root[row, k] * right[:, k]
        right[:, row] *= root[row, row]
    return right


def _product(matrix: Array, vectors: Array) -> Array:
    """Vectors (n_vectors, n, ...) times a matrix (n, m, ...), (n_vectors, m, ...)."""
    if matrix.shape[2:] == (1, 1):
        flat = vectors.reshape(*vectors.shape[:2], -1)
        return np.matmul(matrix[:, :, 0, 0].T, flat).reshape(-1, len(matrix), *vectors.shape[2:])
    return np.einsum("kaps,qkps->qaps", matrix, vectors)
