r"""How many modes: the least Bayesian information criterion in the domain of the measurements.

.. math:: \sum_c n_c \log \frac{\hat\sigma_c}{s_c} + \tfrac12 k \log n

with the misfit of every channel in units of its spread, and k coefficients of laws and surfaces,
states in which recordings begin, and times at which they do. Noise on the samples is white where
the laws are right, which residuals of derivatives never are.

Where no surface says so, every switch has an instant of its own and enters any mode:
:math:`n_{ij}` switches from mode i to mode j cost :math:`\log (n_i! / \prod_j n_{ij}!)` more, what
it takes to say in which order, and so does the mode in which each recording begins. A mode that is
split in two gets its own laws for that, not for nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError
from scipy.special import gammaln

from swsysid._results import Array
from swsysid._stays.identification import StayIdentification, counted_as_one
from swsysid._stays.samples import misfits, modes_of
from swsysid._stays.settings import LIMITS
from swsysid._stays.stays import Stays
from swsysid._ties import first_least


@dataclass(frozen=True)
class CountCandidate:
    """One number of modes, and what the recordings say of it.

    Attributes
    ----------
    n_modes : int
        That were asked for; a mode in which no sample is left is gone from the answer.
    criterion : float
        The least is chosen.
    n_coefficients : int
        Of laws and surfaces, and what says where and when recordings begin.
    n_switches : int
    """

    n_modes: int
    criterion: float
    n_coefficients: int
    n_switches: int


def criterion(n_modes: int, found: StayIdentification, as_one: float = 1.0) -> CountCandidate:
    """The criterion of one identification, of so many modes asked for.

    So many samples count as one.
    """
    estimate, left = found.estimate, misfits(found.estimate)
    count, misfit = _misfit(found)
    n_switches = len(estimate.nodes.instants)
    n_guards = n_switches if estimate.guards is None else estimate.guards.n_free
    k = estimate.laws.n_told + (n_guards if len(estimate.laws.coef) > 1 else 0)
    k += left.shape[1] * (left.shape[2] + 1)  # where and when recordings begin
    value = misfit / as_one + 0.5 * k * float(np.log(max(2.0, count / as_one)))
    if estimate.guards is None:
        value += order_of_switches(estimate.nodes.stays)
        if not _are_told(found):
            value = np.inf
    return CountCandidate(n_modes, value, k, n_switches)


def _are_told(found: StayIdentification) -> bool:
    """Whether every mode of several has a measured value more than its law has coefficients.

    Where no surface says so it would else have any law, and explain any jump.
    """
    laws = found.estimate.laws
    values = np.isfinite(misfits(found.estimate)).sum(axis=2)
    recordings = found.estimate.nodes.recordings
    counts = np.bincount(
        modes_of(found.estimate), recordings.joined(values[:, :, None])[:, 0], len(laws.coef)
    )
    return len(laws.coef) == 1 or bool((counts > laws.free.sum(axis=(1, 2))).all())


def _misfit(found: StayIdentification) -> tuple[float, float]:
    """Samples, and their half logarithmic squares, in units of the spread.

    So those that follow no law, and are in no piece of a recording, count as known by that alone.
    """
    left, spread = misfits(found.estimate), found.estimate.laws.spread
    count = np.isfinite(left).sum(axis=(0, 1))
    squares = found.reached.squares.sum(axis=0) / np.maximum(count, 1)
    shares = np.maximum(squares / np.square(spread), LIMITS.exactly**2)
    nats = 0.5 * float((count * np.log(shares))[count > 0].sum())
    return float(count.sum()), nats


def criteria(counts: Sequence[int], found: Sequence[StayIdentification]) -> list[CountCandidate]:
    """Those of several identifications, by the samples of the one that leaves least."""
    best = int(first_least([_misfit(one)[1] for one in found]))
    as_one = counted_as_one(found[best].reached)
    return [criterion(n, one, as_one) for n, one in zip(counts, found, strict=True)]


def order_of_switches(stays: Sequence[Stays]) -> float:
    """Nats that say which mode every switch enters, given how often each follows each.

    And in which one every recording begins, given in how many it does.
    """
    outside = 1 + max(int(one.modes.max()) for one in stays)
    before = np.concatenate([np.append(outside, one.modes[:-1]) for one in stays])
    pairs = np.stack([before, np.concatenate([one.modes for one in stays])])
    often = np.zeros((outside + 1, outside + 1))
    np.add.at(often, tuple(pairs), 1.0)
    return float(gammaln(often.sum(axis=1) + 1.0).sum() - gammaln(often + 1.0).sum())


def surprise_of_switches(stays: Sequence[Stays]) -> Array:
    """Nats that say which mode a switch enters, (n_modes, n_modes): rare ones cost more.

    Half a switch of each kind is taken to have been seen before.
    """
    n_modes = 1 + max(int(one.modes.max()) for one in stays)
    often = np.full((n_modes, n_modes), 0.5)
    for one in stays:
        np.add.at(often, (one.modes[:-1], one.modes[1:]), 1.0)
    return np.asarray(np.log(often.sum(axis=1, keepdims=True) / often))


def is_exact(found: StayIdentification) -> bool:
    """True if the rollouts leave nothing that another mode could explain."""
    return bool((found.left <= LIMITS.nearly_exactly * found.estimate.laws.spread).all())


def fewest_modes(
    identified: Callable[[int, StayIdentification | None], StayIdentification],
    merged: Callable[[StayIdentification], StayIdentification | None],
    counts: Sequence[int],
    enough: Callable[[StayIdentification], bool] = is_exact,
) -> tuple[StayIdentification, list[CountCandidate]]:
    """The number at which another mode no longer pays, and one fewer does not either.

    One more is tried while one might pay; an answer whose nodes no descent has joined says nothing
    of that, as that with three modes of the four that two heaters have. Then two modes become one
    as long as that is better: the answer with too many may have parted what one with fewer has not
    found. `identified` is given a number and the answer of the number before, `merged` an answer.
    A number whose equations have no solution ends the search with those before it, and one that
    explains `enough` asks for no further one. Two are always tried: one law in the place of two
    that differ by little may leave no more than noise in any stretch.
    """
    found: list[StayIdentification] = []
    asked: list[int] = []
    candidates: list[CountCandidate] = []
    for n_modes in counts:
        if found and (is_exact(found[-1]) or (n_modes > 2 and enough(found[-1]))):
            break
        try:
            found.append(identified(n_modes, found[-1] if found else None))
        except LinAlgError:  # laws of so many modes that some are told by next to nothing
            if not found:
                raise
            break
        asked.append(n_modes)
        candidates = criteria(asked, found)
        gone = len(found[-1].estimate.laws.coef) < n_modes
        worse = candidates[-1].criterion > min(
            (one.criterion for one in candidates[:-1]), default=np.inf
        )
        if n_modes > 2 and (gone or worse) and found[-1].reached.is_joined:
            break
    while True:
        best = int(first_least([one.criterion for one in candidates]))
        n_modes = len(found[best].estimate.laws.coef)
        fewer = merged(found[best]) if n_modes > 2 and not is_exact(found[best]) else None
        if fewer is None:
            return found[best], candidates
        found.append(fewer)
        asked.append(n_modes - 1)
        candidates = criteria(asked, found)
        if candidates[-1].criterion > candidates[best].criterion:
            return found[best], candidates
