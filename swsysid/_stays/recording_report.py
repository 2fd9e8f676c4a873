"""What an identification from recordings has to say, as text."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._free_rollouts.breaks import Break
from swsysid._free_rollouts.judge import FreeRollouts
from swsysid._known.checks import KnownCheck, blamed
from swsysid._rendering.printing import counted, determined, sum_with_errors
from swsysid._results import Array
from swsysid._stays.certainty import Certainty
from swsysid._stays.doubts import FitLeft, mode_doubts, surface_doubts
from swsysid._stays.free import judged
from swsysid._stays.identification import StayIdentification
from swsysid._stays.origin import Origin
from swsysid._stays.search import Search
from swsysid._stays.settings import LIMITS
from swsysid._stays.walk import Walk
from swsysid._surfaces.surface import has_equations


@dataclass(frozen=True, repr=False)
class RecordingReport:
    """Laws with their standard errors, modes, noise, and what the rollouts leave over.

    Attributes
    ----------
    n_recordings, n_samples, n_switches : int
    laws : tuple of str
        One line for each mode and state, with the standard error of every coefficient.
    surfaces : tuple of str
    shares : ndarray of shape (n_modes,)
        Part of the samples in each mode.
    channels : tuple of str
    noise : ndarray of shape (n_channels,)
        What the rollouts leave of each channel, without samples that follow no law: the noise, if
        the laws are right.
    noise_of_differences : ndarray of shape (n_channels,)
        The noise that neighbouring samples show, whatever the laws are.
    samples_that_count_as_one : float
        1 where what is left is white.
    excess : ndarray of shape (n_channels,)
        What the rollouts leave in units of the noise of each sample, without samples that follow
        no law.
    rollouts : FreeRollouts
        What rollouts by the surface alone leave, and which of the switches they make.
    doubts : tuple of str
        What the recordings do not tell, or tell otherwise than asked: a sentence each.
    advice : str
        What to do about it.
    known : tuple of KnownCheck
        What the recordings would rather have, for each thing that was known.
    """

    n_recordings: int
    n_samples: int
    n_switches: int
    laws: tuple[str, ...]
    surfaces: tuple[str, ...]
    shares: Array
    channels: tuple[str, ...]
    noise: Array
    noise_of_differences: Array
    samples_that_count_as_one: float
    excess: Array
    rollouts: FreeRollouts
    doubts: tuple[str, ...]
    advice: str
    known: tuple[KnownCheck, ...] = ()

    def __str__(self) -> str:
        n_modes = len(self.shares)
        head = (
            f"{counted(self.n_recordings, 'recording')}, {self.n_samples} samples: "
            f"{counted(n_modes, 'mode')}, {counted(self.n_switches, 'switch')}."
        )
        lived = ", ".join(f"mode {k} {share:.0%}" for k, share in enumerate(self.shares))
        noise = ", ".join(
            f"{name} {left:.3g} (neighbours show {near:.3g})"
            for name, left, near in zip(
                self.channels, self.noise, self.noise_of_differences, strict=True
            )
        )
        lines = [head, *self.laws, *self.surfaces]
        if n_modes > 1:
            lines.append(f"Samples: {lived}.")
        lines += [f"Known: {one}." for one in self.known]
        lines += [f"Rollouts leave: {noise}.", self.rollouts.sentence(), *self.doubts]
        return "\n".join([*lines, self.advice])

    __repr__ = __str__


def advice_of(
    excess: Array, channels: tuple[str, ...], together: float, rollouts: FreeRollouts, *,
    walks: bool = False,
) -> str:  # fmt: skip
    """One sentence on what the rollouts leave, `excess` times the noise where switches are told."""
    worst, broken = int(np.argmax(excess)), rollouts.first_break
    if excess[worst] > 1.3:
        return (
            f"The rollouts of {channels[worst]} leave {excess[worst]:.2g} times its noise: a term, "
            "a mode, an effect or a jump of a state is missing; try a larger library or more "
            "modes, search for effects, or use HybridAutomatonRegressor."
        )
    if walks:
        return (
            "The laws leave nothing but noise, one sample ahead; noise in the equation leads free "
            "rollouts away from any recording, which is no proof against the laws."
        )
    if not rollouts.holds:
        told = "Told when to switch" if rollouts.n_switches else "Stretch by stretch"
        return f"{told}, the laws leave nothing but noise; {_by_itself(rollouts, broken)}"
    if together > 2.0:
        return (
            f"The misfit is as small as the noise, but {together:.2g} neighbouring samples of it "
            "count as one; a weak term may be missing."
        )
    return "The rollouts leave nothing but noise."


def _by_itself(rollouts: FreeRollouts, broken: Break | None) -> str:
    """What that says of the model by itself."""
    if rollouts.hangs_on_start:
        return (
            "free rollouts hang on how well their start is known, as where a motion is chaotic: "
            "judge them over stretches (refine=False)."
        )
    if broken is not None and broken.cause:
        return (
            "the surface alone does not tell all switches: give it a higher degree or another "
            "column, or, if the modes have a memory, use HybridAutomatonRegressor."
        )
    return "rolled out freely they leave it: a law is a little off, or a weak term is missing."


def reported(
    search: Search,
    found: StayIdentification,
    sure: Certainty,
    modes: NDArray[np.intp],
    origin: Origin,
    held: Iterable[str] = (),
    known: tuple[KnownCheck, ...] = (),
    walk: Walk | None = None,
) -> RecordingReport:
    """What was found, with how certain it is, and what free rollouts say of it.

    The estimate counts its columns from the `origin`, the model those of the user; `held` is what
    inputs do between two samples.
    """
    given, n_modes = search.given, len(found.estimate.laws.coef)
    n_channels, names = given.n_channels, found.model.switching_model.feature_map.names_in
    channels, together = tuple(names[:n_channels]), sure.samples_that_count_as_one
    least = LIMITS.exactly * found.estimate.laws.spread[:n_channels]
    near = np.maximum(search.base.noise[:n_channels], least)
    rollouts, noise = judged(found, origin, given.labels, near, channels, together, search.stretch)
    left = FitLeft.of(found, origin, noise, given)
    doubts = [
        *surface_doubts(found, origin, names),
        *mode_doubts(n_modes, search.estimator.n_modes, search.counts[-1]),
        *noise.sentences(channels),
        *left.sentences(),
        *([] if walk is None else walk.sentences(names)),
        *held,
    ]
    has_surfaces = n_modes > 1 and has_equations(found.model.surface_)
    return RecordingReport(
        n_recordings=given.n_recordings,
        n_samples=given.n_samples,
        n_switches=len(found.estimate.nodes.instants),
        laws=tuple(_laws(found, sure, names)),
        surfaces=tuple(found.model.surface_equations()) if has_surfaces else (),
        shares=np.bincount(modes, minlength=n_modes) / len(modes),
        channels=channels,
        noise=np.maximum(left.size, least) if walk is None else walk.sensor[:n_channels],
        noise_of_differences=search.base.noise[:n_channels],
        samples_that_count_as_one=together,
        excess=left.excess,
        rollouts=rollouts,
        doubts=tuple(doubts),
        advice=blamed(known)
        or advice_of(left.excess, channels, together, rollouts, walks=walk is not None),
        known=known,
    )


def _laws(found: StayIdentification, sure: Certainty, names: Sequence[str]) -> list[str]:
    """The laws with their standard errors."""
    system = found.model.switching_model
    features = list(system.feature_map.names_out)
    errors = determined(system.coef, sure.coef, system.feature_map.sizes)
    return [
        f"mode {mode}: {names[state]}' = "
        + sum_with_errors(system.coef[mode, state].tolist(), own.tolist(), features)
        for mode, of_states in enumerate(errors)
        for state, own in enumerate(of_states)
    ]
