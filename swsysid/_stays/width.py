r"""How far instants and surfaces may be off where the laws nearly agree at a switch.

The derivative of a rollout by a switch instant is the jump of the velocity there. Where that jump
vanishes, as at a contact, the derivatives at the estimate say nothing of it, and a rollout of which
a switch is off by s still differs by the order of :math:`s^2`. Gauss and Newton's matrix is
therefore asked at instants that are later and sooner by the standard error s that it gives itself,

.. math:: s^2 = \sigma^2(\tau \pm s),

all crossings of a surface to one side of it. Where the laws differ at the switch the matrix is the
same everywhere near, and so are its errors: where the derivatives by the instants are nearly the
same on both sides it is not asked again.

Samples on the wrong side of a surface push it, and say nothing of how far it may be pushed back:
crossings alone tell how certain it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import LinAlgError

from swsysid._results import Array
from swsysid._stays.descent import Reached
from swsysid._stays.equations import Covariance
from swsysid._stays.flow import switching
from swsysid._stays.lifted import Estimate

# Part of the stays beside it by which an instant is moved at most; the factor within which errors
# are those that they were asked with, and moves that are tried. Laws that agree at a contact take
# four to six (`tests/stays/test_errors_at_contacts.py`).
_OF_STAY, _SAME, _MOST = 0.4, 1.1, 6


@dataclass(frozen=True)
class Width:
    """Variances of instants (n_switches,), covariance of laws, guards and resets."""

    of_instants: Array
    of_shared: Array


def width(reached: Reached, together: float) -> Width:
    """That of an estimate; `together` samples count as one."""
    if reached.estimate.guards is not None:
        guards = replace(reached.estimate.guards, sides=None)
        reached = replace(reached, estimate=replace(reached.estimate, guards=guards))
    at = _of(reached.covariance, together)
    nodes = reached.estimate.nodes
    if not len(nodes.instants):
        return at
    most, towards = _farthest(reached.estimate), _towards(reached.estimate)
    size = np.minimum(np.sqrt(at.of_instants[: len(most)]), most)
    if _is_steady(reached.estimate, size):
        return at
    for _ in range(_MOST):
        sides = [_moved(reached, sign * size * towards, together) for sign in (1.0, -1.0)]
        both = [one for one in sides if one is not None]
        if not both:
            return at
        at = both[0] if len(both) == 1 else _between(*both)
        found = np.minimum(np.sqrt(at.of_instants[: len(most)]), most)
        if (np.abs(np.log(found / size)) < np.log(_SAME)).all():
            break
        size = np.sqrt(found * size)
    return at


def _is_steady(estimate: Estimate, moves: Array) -> bool:
    """Whether rollouts change by instants that are sooner or later as they do at the estimate.

    Up to the part within which errors are the same.
    """
    nodes = estimate.nodes
    here, *there = (
        switching(estimate.motion, moved, estimate.states, estimate.resets).by_instant
        for moved in (nodes, *(nodes.moved(nodes.instants + sign * moves) for sign in (1.0, -1.0)))
    )
    off = [one.shape == here.shape and np.linalg.norm(one - here, axis=1) for one in there]
    return all((one < (_SAME - 1.0) * np.linalg.norm(here, axis=1)).all() for one in off)


def _of(covariance: Covariance, together: float) -> Width:
    variances = np.clip(covariance.variances_of_instants, 0.0, np.inf)
    return Width(together * variances, together * covariance.of_shared)


def _between(one: Width, other: Width) -> Width:
    """The inverse of the mean of what both tell."""
    variances = 2.0 / (1.0 / one.of_instants + 1.0 / other.of_instants)
    first, second = one.of_shared, other.of_shared
    told = np.isfinite(np.diag(first)) & np.isfinite(np.diag(second))
    # what one of them does not tell is not told
    shared = np.where(np.isfinite(np.diag(first)), second, first)
    own = np.ix_(told, told)
    shared[own] = 2.0 * first[own] @ np.linalg.pinv(first[own] + second[own]) @ second[own]
    return Width(variances, 0.5 * (shared + shared.T))


def _moved(reached: Reached, later: Array, together: float) -> Width | None:
    """What is told where instants are later; None where that cannot be."""
    nodes = reached.estimate.nodes
    moved = nodes.moved(nodes.instants + later)
    # a switch that enters the moment of a step, or leaves it, makes other unknowns
    if (len(moved.at), len(moved.stepping)) != (len(nodes.at), len(nodes.stepping)):
        return None
    try:
        there = replace(reached, estimate=replace(reached.estimate, nodes=moved))
        return _of(there.covariance, together)
    except LinAlgError:
        return None


def _farthest(estimate: Estimate) -> Array:
    """By how much instants may be moved, and their stays still be there."""
    parts = []
    for stays, t in zip(estimate.nodes.stays, estimate.nodes.recordings.times, strict=True):
        lasting = np.diff(np.concatenate([t[:1], stays.instants, t[-1:]]))
        parts.append(_OF_STAY * np.minimum(lasting[:-1], lasting[1:]))
    return np.concatenate(parts)


def _towards(estimate: Estimate) -> Array:
    """Whether a later instant is beyond its surface, 1, or before it, -1."""
    towards = np.ones(len(estimate.nodes.instants))
    if estimate.guards is not None:
        misses = estimate.guards.misses(estimate.crossings)
        towards[misses.switches] = np.where(misses.by_instants < 0.0, -1.0, 1.0)
    return towards
