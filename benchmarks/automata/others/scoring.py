"""Model in, figures out: how well a method finds an automaton that others published.

Anything can be scored that makes a `Model` of recordings: `score` gives it the nine of the
training, and rolls what it made out from the first samples of six that it has not seen.
"""

from __future__ import annotations

import re
import time
import warnings
from collections.abc import Callable, Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from benchmarks.automata.figures import matched
from benchmarks.automata.others.dainarx import Recorded
from benchmarks.automata.plant import Array

__all__ = ["Model", "score"]

NEAR, AT_GUARD = 2, 0.01  # samples; ranges of the columns of a guard
_NAMED = re.compile(r"mode \d|\d -> \d")


class Published(Protocol):
    """An automaton that others published.

    Attributes
    ----------
    name, features, kernel : str
        Further terms of its laws, and of which kind its guards are, as `dainarx.Published` says.
    order : int
    is_flow : bool
        Whether its laws give velocities, whatever their terms.
    numbers : dict of int to int
        Of its modes; those of the same laws have the same, as nothing tells them apart but history.
    """

    name: str
    features: str
    kernel: str
    order: int
    is_flow: bool

    @property
    def numbers(self) -> Mapping[int, int]:
        """Of the modes."""

    def training(self) -> list[Recorded]:
        """Recordings for a fit."""

    def unseen(self) -> list[Recorded]:
        """Recordings for the figures."""


class Model(Protocol):
    """What is scored.

    Attributes
    ----------
    n_modes : int
    modes : ndarray of shape (n_rows,), int
        Mode of every sample of the training, recording after recording.
    n_first : int
        Samples that a rollout is given.
    doubts : bool
        Whether the method itself says that something is not right.
    """

    n_modes: int
    modes: NDArray[np.intp]
    n_first: int
    doubts: bool

    def rollout(self, seen: Recorded, mode: int) -> tuple[Array, NDArray[np.intp]]:
        """States and modes from the last of the first samples on, in a mode of the model."""

    def passed(self, seen: list[Recorded], source: int, target: int) -> Array:
        """Signed distance beyond the guard of a transition at all samples, (n_rows,).

        In ranges of its columns in these recordings; NaN where it has none. Modes are the model's.
        """


def score(
    method: Callable[[list[Recorded], Published], Model],
    automaton: Published,
    noise: float = 0.0,
    seed: int = 0,
) -> dict[str, float | str]:
    """Figures of a method on one automaton.

    Parameters
    ----------
    method : callable
        Makes a `Model` of recordings; of the automaton it may look at what its own tool is told:
        `order`, `features`, `kernel`, `is_flow`, never at laws, edges or modes.
    automaton : Published
    noise : float
        Standard deviation of white noise on the states of the training, as a fraction of the
        spread of each.
    seed : int
        Of the noise.

    Returns
    -------
    dict
        ``modes`` beyond those of different laws in the training, ``labels`` the share of training
        samples in their mode, ``guards`` the share of the training's switches at which the true
        states (those without noise) pass the guard found, or are within 1 % of the ranges of its
        columns, ``mean`` and ``largest`` deviation of the unseen rollouts, each state in units of
        its largest value there (as DAINARX counts; infinite where a rollout ends early),
        ``switches`` the share of unseen switches that the rollouts make within two samples, and no
        others, ``doubts`` whether the method said so, ``warns`` its warnings that name a mode or a
        transition, CPU ``seconds``; or ``refused`` and why.
    """
    training, unseen = automaton.training(), automaton.unseen()
    spread = np.std(np.vstack([one.x for one in training]), axis=0)
    rng = np.random.default_rng(seed)
    noisy = [
        Recorded(one.t, one.x + noise * spread * rng.standard_normal(one.x.shape), one.u, one.modes)
        for one in training
    ]
    began = time.process_time()
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        try:
            model = method(noisy, automaton)
        except (ValueError, TypeError, TimeoutError) as refusal:
            return {"refused": str(refusal), "seconds": time.process_time() - began}
    seconds = time.process_time() - began
    numbers = automaton.numbers
    true = np.concatenate([[numbers[mode] for mode in one.modes.tolist()] for one in training])
    order = matched(true, model.modes, max(numbers.values()) + 1, model.n_modes)
    every = [_of_rollout(model, one, order, numbers) for one in unseen]
    hits, of = (sum(one[k] for one in every) for k in (2, 3))
    return {
        "modes": float(model.n_modes - len(np.unique(true))),
        "labels": float(np.mean(order[true] == model.modes)),
        "guards": _at_guards(model, training, true, order),
        "mean": float(np.mean([one[0] for one in every])),
        "largest": float(np.max([one[1] for one in every])),
        "switches": hits / of if of else 1.0,
        "doubts": float(model.doubts),
        "warns": " ".join(str(one.message) for one in said if _NAMED.search(str(one.message))),
        "seconds": seconds,
    }


def _at_guards(
    model: Model, training: list[Recorded], true: NDArray[np.intp], order: NDArray[np.intp]
) -> float:
    """Share of the switches whose states are at the guard that the model has for them.

    A guard is passed from the last sample before a switch to the next, or where states would have
    been then, had they gone on: after a jump they are elsewhere. One transition is taken at a
    sample: a mode that is entered at one and left at the next may be entered beyond its guard.
    """
    starts = np.cumsum([0, *(len(one.t) for one in training)])
    places = np.setdiff1d(np.flatnonzero(np.diff(true)) + 1, starts)
    ways, which = np.unique([true[places - 1], true[places]], axis=1, return_inverse=True)
    off = np.full(len(places), np.nan)
    for number, (source, target) in enumerate(ways.T):
        passed = model.passed(training, int(order[source]), int(order[target]))
        own = places[np.ravel(which) == number]
        before, after = passed[own - 1], passed[own]
        first = np.isin(own - 1, starts)
        gone_on = np.where(first, after, 2.0 * before - passed[own - 2])
        entered = first | (true[own - 1] != true[own - 2])
        passes = ((before < 0.0) | entered) & (np.maximum(after, gone_on) >= 0.0)
        apart = np.minimum(np.abs(before), np.abs(after))
        off[np.ravel(which) == number] = np.where(passes, 0.0, apart)
    return float(np.mean(off <= AT_GUARD)) if len(off) else 1.0


def _of_rollout(
    model: Model, seen: Recorded, order: NDArray[np.intp], numbers: Mapping[int, int]
) -> tuple[float, float, int, int]:
    """Mean and largest deviation, switches that both make, and that either does."""
    at = model.n_first - 1
    modes = order[[numbers[mode] for mode in seen.modes.tolist()]][at:]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        x, made = model.rollout(seen, int(modes[0]))
    true = seen.x[at:]
    if len(x) < len(true):
        return np.inf, np.inf, 0, int(np.count_nonzero(np.diff(modes)))
    largest = np.abs(seen.x).max(axis=0)
    apart = np.abs(x - true) / np.where(largest > 0.0, largest, 1.0)
    n_here, n_there = _made_by(modes, made), _made_by(made, modes)
    extra = np.count_nonzero(np.diff(made)) - n_there
    return (
        float(apart.mean()),
        float(apart.max()),
        n_here,
        int(np.count_nonzero(np.diff(modes)) + extra),
    )


def _made_by(modes: NDArray[np.intp], others: NDArray[np.intp]) -> int:
    """Changes of the modes that the others make too, to the same mode and within two samples."""
    places, theirs = np.flatnonzero(np.diff(modes)), np.flatnonzero(np.diff(others))
    same = modes[places + 1][:, None] == others[theirs + 1]
    near = np.abs(np.subtract.outer(places, theirs)) <= NEAR
    return int(np.count_nonzero((same & near).any(axis=1)))
