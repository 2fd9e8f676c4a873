"""What recordings do not tell of an answer: surfaces of few switches, modes, samples of no law."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from swsysid._data.trajectories import label_text
from swsysid._free_rollouts.sample_noise import SampleNoise
from swsysid._rendering.printing import counted
from swsysid._results import Array
from swsysid._stays.given import Given
from swsysid._stays.identification import StayIdentification
from swsysid._stays.laws import slopes_of
from swsysid._stays.lifted import Estimate
from swsysid._stays.origin import Origin
from swsysid._stays.samples import Samples, left_over, states_of

# Samples that follow no law: chance of one among all of noise alone, and the share of them above
# which they are no outliers but what a law lacks.
_BY_CHANCE, _MOST_APART = 1e-3, 0.05


def surface_doubts(
    found: StayIdentification, origin: Origin, names: Sequence[str]
) -> Iterator[str]:
    """On how many switches each surface rests, and what tells them as well.

    Each switch is one equation of its surface; with no more of them than it has coefficients
    beside its scale some surface goes through all of them, whatever its columns.
    """
    estimate, guards = found.estimate, found.estimate.guards
    if guards is None:
        return
    book, samples = guards.mode_book, Samples.of(estimate)
    values, slopes = slopes_of(guards.features, samples.columns, samples.spread)
    beside = samples.modes < len(book)
    columns = np.column_stack([samples.columns + origin.offset, _times(estimate)])
    for surface, coef in enumerate(guards.coef):
        # the level of a surface is free even where it was found to be zero
        n_free = int(((coef != 0.0) & (np.ptp(values, axis=0) > 0.0)).sum())
        crossed = _crossings(estimate, book[:, surface])
        used = np.append((np.einsum("f,nfc->nc", coef, slopes) != 0.0).any(axis=0), False)
        sides = book[samples.modes[beside], surface] > 0
        rivals = thresholds(columns[beside], sides, [*names, "time"])
        if used.sum() == 1:  # its own threshold is no rival
            rivals.pop([*names, "time"][int(np.argmax(used))], None)
        told = f"f{surface} rests on {counted(crossed, 'switch')}"
        if crossed <= n_free:
            told += f" and has {counted(n_free, 'free coefficient')}: it is not determined"
        if rivals:
            told += f"; as good on these recordings: {' or '.join(rivals.values())}"
        yield f"{told}." if crossed > n_free else f"{told}. Record more switches."


def _crossings(estimate: Estimate, signs: NDArray[np.int64]) -> int:
    """Switches from one side of a surface to the other; slides are on it."""
    count = 0
    for stays in estimate.nodes.stays:
        old, new = stays.modes[:-1], stays.modes[1:]
        beside = (old < len(signs)) & (new < len(signs))
        count += int((signs[old[beside]] != signs[new[beside]]).sum())
    return count


def _times(estimate: Estimate) -> Array:
    recordings = estimate.nodes.recordings
    pairs = zip(recordings.times, recordings.sampled, strict=True)
    return np.concatenate([t[places] for t, places in pairs])


def thresholds(columns: Array, sides: NDArray[np.bool_], names: Sequence[str]) -> dict[str, str]:
    """Columns of which one threshold has all samples of one side above it, all others below."""
    if sides.all() or not sides.any():
        return {}
    found = {}
    for values, name in zip(columns.T, names, strict=True):
        for above in (sides, ~sides):
            low, high = values[~above].max(), values[above].min()
            if low < high:
                digits = int(np.ceil(np.log10(max(abs(low), abs(high)) / (high - low)))) + 1
                found[name] = f"{name} >= {0.5 * (low + high):.{max(2, digits)}g}"
    return found


def mode_doubts(n_found: int, asked: int | str, most: int) -> Iterator[str]:
    """Where another number of modes was found than was asked for, or as many as were tried."""
    if asked == "auto" and n_found == most > 1:
        yield (
            f"{n_found} modes are the most that were tried (max_modes): there may be more; raise "
            "max_modes."
        )
    if asked != "auto" and n_found < int(asked):
        yield (
            f"The trajectories show {n_found} of the {asked} modes asked for. No surface of these "
            "columns tells another; if the modes have a memory, use HybridAutomatonRegressor "
            "(--automaton)."
        )


@dataclass(frozen=True)
class FitLeft:
    """What a fit leaves of the samples, without those that follow no law."""

    size: Array  # (n_channels,): root mean squares
    excess: Array  # (n_channels,): the same in units of the noise of each sample
    n_apart: int  # samples further from the rollouts than noise brings them
    n_samples: int
    first: tuple[str, float]  # recording and time of the first of them

    @classmethod
    def of(
        cls, found: StayIdentification, origin: Origin, noise: SampleNoise, given: Given
    ) -> FitLeft:
        """Samples that are few and far are outliers; more of them are no outliers any more."""
        estimate, n_channels = found.estimate, given.n_channels
        recordings = estimate.nodes.recordings
        left, states = left_over(estimate), origin.states(states_of(estimate))
        samples, sigmas = [], []
        for k, (places, label) in enumerate(
            zip(recordings.sampled, map(label_text, given.labels), strict=True)
        ):
            samples.append(left[places, k, :n_channels])
            sigmas.append(noise.at(states[places, k, :n_channels], label))
        off = np.vstack(samples)
        sizes = np.abs(off) / np.vstack(sigmas)
        n_values = max(1, int(np.isfinite(sizes).sum()))
        far = np.nan_to_num(sizes) > norm.isf(_BY_CHANCE / (2.0 * n_values))
        n_samples = int(np.isfinite(sizes).any(axis=1).sum())  # rows of inputs alone are none
        places = np.flatnonzero(far.any(axis=1))
        if len(places) > _MOST_APART * n_samples:
            places = places[:0]
        sizes[places] = off[places] = np.nan
        count = np.maximum(1, np.isfinite(sizes).sum(axis=0))
        freedom = max(0.1, 1.0 - found.reached.n_unknowns / max(1, count.sum()))
        size, excess = (
            np.sqrt(np.nansum(np.square(one), axis=0) / count / freedom) for one in (off, sizes)
        )
        first = ("", 0.0)
        if len(places):
            owner = np.repeat(np.arange(len(samples)), [len(one) for one in samples])[places[0]]
            first = label_text(given.labels[owner]), float(_times(estimate)[places[0]])
        return cls(size, excess, len(places), n_samples, first)

    def sentences(self) -> Iterator[str]:
        """How many samples follow no law, and where the first is."""
        if self.n_apart:
            label, time = self.first
            yield (
                f"{counted(self.n_apart, 'sample')} of {self.n_samples:,} "
                f"follow{'s' if self.n_apart == 1 else ''} no law "
                f"({self.n_apart / self.n_samples:.1%}; the first in recording {label} at "
                f"t = {time:.4g}): outliers, or a mode of few samples; they have the mode of their "
                "neighbours. Give gross errors as NaN."
            )
