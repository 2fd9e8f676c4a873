"""What an identification takes for granted: sizes and limits that no user should have to choose."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["IdentificationSettings"]


@dataclass(frozen=True)
class IdentificationSettings:
    """Sizes and limits of a fit.

    Attributes
    ----------
    whole, sampled : int
        Data of at most `whole` rows are identified as a whole, of more a sample of `sampled` rows.
    deciding : int
        Starts are compared on so many rows, which decide between them as well as all rows do.
    random_starts : int
        Number of starts with ``init="random"``.
    different, open : float
        Partitions that differ on more than this share of the samples are different answers, and a
        gap of log likelihoods within so many nats leaves the choice between them open: dense gates
        on thousands of samples differ by hundreds where the samples decide.
    same : float
        Two runs found the same answer if they agree on this share of the samples.
    seldom : int
        An answer that at most one start in so many finds is no more than the best so far.
    another_book : float
        The mode-book is chosen anew when more than this share of the weight has changed its mode.
    most_choices : int
        Terms are chosen anew for the modes that the last choice led to, at most so often.
    larger : float
        Before all rows a larger sample is passed over: so many times the rows to the power 2/3.
    most_kept : int
        Rows that a pass keeps at most, over all outputs: they must fit into memory.
    fewer : int
        If a pass over all rows would keep more, passes over at least so many times fewer rows
        come before.
    wider, wider_margins : float
        Where a pass kept too few rows, residuals and margins reach so many times as far. Few rows
        are next to a margin, and what a surface does far from them is hard to foresee.
    most_tries : int
        How often a pass keeps more rows before it is given up.
    no_gain : float
        Gains of an objective below so many nats a row count as zero.
    most_surface_passes : int
        Passes for the surfaces alone, which follow where they are not coupled.
    """

    whole: int = 40_000
    sampled: int = 10_000
    deciding: int = 20_000
    random_starts: int = 10
    different: float = 0.02
    open: float = 20.0
    same: float = 0.995
    seldom: int = 32
    another_book: float = 0.02
    most_choices: int = 5
    larger: float = 4.0
    most_kept: int = 5_000_000
    fewer: int = 4
    wider: float = 2.0
    wider_margins: float = 8.0
    most_tries: int = 3
    no_gain: float = 1e-9
    most_surface_passes: int = 10
