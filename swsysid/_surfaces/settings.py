"""How surfaces are fitted, sampled and chosen: the numbers, and the reason for each."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class MarginSettings:
    """Margin programs and mode-books. The time depends on them; optima are proved in any case."""

    small: int = 200  # rows up to which a program is solved whole: HiGHS is faster than a start
    together: int = 50  # small programs solved as one
    max_rounds: int = 100  # in which a working set grows; a handful is usual
    tight: float = 1e-9  # relative duality gap below which nothing is left to do
    accepted: float = 1e-6  # relative duality gap above which a fit is not called optimal
    large: int = 10_000  # rows above which a start is found on some of them ...
    coarsening: int = 8  # ... this many times fewer
    descended: float = 1e-4  # promise of a Newton step, of the value, that ends a smoothing width
    newton_steps: int = 10  # for each smoothing width
    secant_steps: int = 15  # of a line search
    deciding: int = 1000  # rows that decide between starts and between mode-books
    all_books: int = 4  # modes up to which all mode-books are tried (three of them)
    screened_books: int = 4  # fitted of the others, those of the least misfit
    book_starts: int = 10  # random starts of their search


@dataclass(frozen=True)
class PosteriorSettings:
    """Surfaces that the data allow, drawn by hit-and-run."""

    chains: int = 24  # in two halves, each of which takes its directions from the other one
    burn_in: int = 10  # steps before a surface is kept ...
    burn_in_a_coefficient: int = 6  # ... and more for each coefficient
    first_steps: int = 10  # along fresh directions only, until the chains have spread
    kept: int = 4  # surfaces of each chain ...
    every: int = 5  # ... at this distance
    near: int = 400  # rows near a surface that can stop it, ...
    anywhere: int = 200  # ... and others
    met: int = 64  # of these, the rows that one step looks at
    digits: int = 8  # of numbers about one: far from rounding errors, and below what data tell
    longest: float = 30.0  # step, in standard deviations, if no row stops it
    farthest: float = 1e3  # factor of the fitted coefficients beyond which nothing is drawn
    certain: float = 4.0  # log odds below which a row on the wrong side is no error
    most_rows: int = 20_000  # that can stop a surface; those far away do not
    misfits: int = 2000  # rows that tell the share of errors at a distance
    at_once: int = 2000  # rows that are voted on at once


@dataclass(frozen=True)
class RelevanceSettings:
    """Evidence of the monomials of a surface."""

    prior: float = 100.0  # deviation of a coefficient: from no trend to a jump within 1 % of spread
    certain: float = 60.0  # log ratios beyond this are certain
    beam: int = 8  # subsets that go on to the next size
    first_additions: int = 20  # tried for each of them up to the second, ...
    additions: int = 6  # ... and from the third on
    largest: int = 12  # subset
    patience: int = 2  # sizes without a better subset after which the search stops
    negligible: float = 0.05  # probability below which a feature is left out
    near: int = 4000  # rows next to the surface, ...
    far: int = 1000  # ... and spread over the others, where there are more
    newton_steps: int = 30
    halvings: int = 12  # of a Newton step
    tolerance: float = 1e-3  # in nats


MARGIN, POSTERIOR, RELEVANCE = MarginSettings(), PosteriorSettings(), RelevanceSettings()
