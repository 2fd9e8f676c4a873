"""What recordings do not tell of an automaton, in a sentence each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import combinations

import numpy as np

from swsysid._automaton_search.answer import IdentifiedAutomaton
from swsysid._automaton_search.assembly import untold
from swsysid._automaton_search.found import FoundTransition
from swsysid._discrete_stays.identify import KindsOfNoise
from swsysid._results import Array
from swsysid._simulation.model import law_equations

# Samples of a stay that show the law of its mode: fewer are a slope, and two make up any curve.
_FEW = 10
# Of the noise, what free rollouts of the recordings that a model was made from may leave of one, or
# of a stretch of it from where they surely leave it to their next switch.
_FAR = 3.0

ASKED_AT_SAMPLES = (
    "All switches where states go on lie on samples: what decides is asked there. The guards rise "
    "between the last sample before and the first after, and rollouts ask them every so often."
)


def imitates(found: IdentifiedAutomaton) -> bool:
    """Whether modes that nothing tells alternate so fast that they make up any curve."""
    return bool(untold(found.verdicts)) and _usual_stay(found) < _FEW


def _usual_stay(found: IdentifiedAutomaton) -> int:
    """Samples of a stay: their median."""
    ends = [np.flatnonzero(np.diff(own, prepend=-1, append=-1)) for own in found.modes]
    return int(np.median(np.concatenate([np.diff(own) for own in ends])))


def untold_switches(found: IdentifiedAutomaton) -> str:
    """What is said of switches that no guard explains, "" if there are none."""
    if not imitates(found):
        return untold(found.verdicts)
    return (
        "Nothing in the recordings tells when modes change, and half of the stays have "
        f"{_usual_stay(found)} "
        "samples at most: modes that alternate so fast make up for something gradual, such as a "
        "lag or a hidden state. Search for effects of one law (EffectSearchCV), or record the "
        "signal that triggers them, at a higher rate."
    )


def strays(found: IdentifiedAutomaton) -> str:
    """What is said of an automaton that leaves its own recordings by itself, "" if it does not.

    Where there is less noise than rollouts may be off by, and instants are known, any that surely
    leaves a recording is far from it. Where it does so as a motion does whose start is not known,
    or that noise drives, that is no proof against it.
    """
    rollouts = found.rollouts
    noises = found.noises
    driven = noises is not None and noises.drives and not noises.goes_on
    stretches = [one.leaves for one in rollouts.breaks]  # without one, by a few outliers
    exact = not rollouts.in_noise and ASKED_AT_SAMPLES not in found.shared_exits
    far = exact or bool(np.max([rollouts.left_of_each.max(), *stretches]) > _FAR)
    if driven or rollouts.hangs_on_start or not (stretches and far):
        return ""
    return f"By itself the automaton leaves {rollouts.strays}; report_ says more."


def doubts_of(found: IdentifiedAutomaton, asked: int | str, most: int) -> Iterator[str]:
    """Of modes, guards, samples and noise."""
    yield from _of_modes(found.automaton.n_modes, asked, most)
    for verdict in found.verdicts:
        if verdict.is_told and not verdict.is_determined:
            yield verdict.advice()
        elif verdict.is_told and verdict.rivals:
            rivals = " or ".join(f"`{one}`" for one in verdict.rivals)
            yield (
                f"The switches {verdict.source} -> {verdict.target} are told as well by {rivals}: "
                "recordings that start elsewhere would tell which."
            )
    yield from found.shared_exits
    if found.n_unexplained:
        n = sum(len(own) for own in found.modes)
        yield (
            f"{found.n_unexplained:,} of {n:,} samples follow none of the laws and have the mode "
            "of their neighbours."
        )
    if found.noises is not None:
        yield _of_noise(found, found.noises)


def _of_modes(n_found: int, asked: int | str, most: int) -> Iterator[str]:
    if asked == "auto" and n_found == most > 1:
        yield (
            f"{n_found} modes are the most that were tried (max_modes): there may be more; raise "
            "max_modes."
        )
    if asked != "auto" and n_found < int(asked):
        which = "was" if n_found == 1 else "were"
        yield (
            f"{n_found} of the {asked} modes asked for {which} found: the recordings tell no more "
            "of them apart; give a smaller n_modes, or record what the others do."
        )


def _of_noise(found: IdentifiedAutomaton, noises: KindsOfNoise) -> str:
    """Which of both noises there is, or both answers where nothing tells."""
    if noises.drives:
        only = "" if noises.senses else ", none of it the sensor's that is seen"
        return (
            f"There is noise in the equation{only}: that of the sensor alone is "
            f"{noises.sensor_alone:.3g} nats less likely."
        )
    if noises.senses:
        return (
            "The noise is the sensor's: that of the equation alone is "
            f"{noises.equation_alone:.3g} nats less likely."
        )
    laws = [
        f" The {whose} alone: "
        + "; ".join(
            law_equations(
                coef,
                found.automaton.feature_map,
                3,
                "text",
                discrete_time=True,
                states=found.automaton.state_names,
            )
        )
        + "."
        for whose, coef in (
            ("sensor's", noises.laws_of_sensor),
            ("equation's", noises.laws_of_equation),
        )
        if coef.size  # in continuous time they are not known
    ]
    return (
        "The recordings do not tell noise of the sensor from noise in the equation."
        f"{''.join(laws)} A longer recording, or an input that moves the states far beyond the "
        "noise, tells."
    )


def shared_exits(
    found: Sequence[FoundTransition],
    rises: Callable[[FoundTransition, FoundTransition], float],
    rows: Callable[[FoundTransition], Array],
    names: Sequence[int],
    columns: Sequence[str],
) -> Iterator[str]:
    """One sentence for each pair; `names` are those of the modes in the answer.

    ``rises(one, other)`` is the part of the switches of the other at which the guard of the one
    rises as well; of two that are asked one after the other that of the first one matters.
    ``rows(one)`` are columns at its switches. A column tells two transitions apart where it is
    below a threshold at all switches of the one and above it at all others.
    """
    told = [one for one in found if one.guard is not None and one.source != one.target]

    def goes_on(one: FoundTransition, other: FoundTransition) -> bool:
        """Whether from the target of the one it is left at once for that of the other."""
        way = one.target, other.target
        return any((on.source, on.target) == way and rises(on, other) > 0.5 for on in told)

    for one, other in combinations(told, 2):
        if one.source != other.source or one.target == other.target:
            continue
        asked = sorted((one, other), key=lambda way: way.rank)
        both = [asked] if one.rank != other.rank else [asked, asked[::-1]]
        if not any(rises(*ways) > 0.5 and not goes_on(*ways) for ways in both):
            continue
        first, second = sorted((one, other), key=lambda way: names[way.target])
        source, ways = names[one.source], (names[first.target], names[second.target])
        which = "nothing that was recorded tells which; record what does and give it as an input."
        apart = _telling(rows(first), rows(second), columns)
        if apart is not None:
            name, low, level = apart
            which = (
                f"{name} may tell which (mode {ways[0 if low else 1]} below {level:.3g}), but so "
                "few switches agree by chance too: record more of them, from other states."
            )
        yield (
            f"Mode {source} is left for mode {ways[0]} and for mode {ways[1]} where the same guard "
            f"rises, and the model always goes one way: {which}"
        )


def _telling(first: Array, second: Array, columns: Sequence[str]) -> tuple[str, bool, float] | None:
    """The column that tells two sets of rows apart best, whether the first is below, and where."""
    best: tuple[float, str, bool, float] | None = None
    for name, own, other in zip(columns, first.T, second.T, strict=True):
        spread = np.std(np.append(own, other))
        if not spread > 0.0:  # NaN: a clock that is not known
            continue
        for low, below, above in ((True, own, other), (False, other, own)):
            gap = float((above.min() - below.max()) / spread)
            if gap > 0.0 and (best is None or gap > best[0]):
                best = gap, name, low, 0.5 * float(above.min() + below.max())
    return None if best is None else best[1:]
