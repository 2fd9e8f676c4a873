r"""Whether an input that is constant by pieces is on a line where it steps, or steps at an instant.

With V half the sum of squares that laws and states of highest likelihood leave of n values,

.. math:: \tfrac n2 \log V + \tfrac m2 \log n

is least for one of four: it is on a line between two rows, it keeps its value until the next row,
it has had its value since the row before, as what a logger writes at the end of an interval, or it
steps at instants between the rows, which are estimated with the laws and make up for whatever these
lack: only laws that then leave nothing but noise tell them. The m instants that no
row tells are these and those at which modes switch by themselves: a switch by an input that steps
is where it steps. Stays are as the first rounds have told them, or told anew.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from swsysid._checks.parameters import one_of, shown
from swsysid._data.recordings import Hold, staircases
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._rendering.printing import counted
from swsysid._stays.descent import Reached, most_likely
from swsysid._stays.given import Given, without_clipped
from swsysid._stays.identification import leaves_noise
from swsysid._stays.lifted import Estimate
from swsysid._stays.nodes import Nodes
from swsysid._stays.origin import Origin
from swsysid._stays.pieces import between_jumps, part_of
from swsysid._stays.recordings import Recordings
from swsysid._stays.samples import states_of
from swsysid._stays.search import Search
from swsysid._stays.settings import LIMITS, StaySettings


def hold_sentences(
    names: Sequence[str], holds: Sequence[str], given: Given, stepped: Given
) -> Iterator[str]:
    """What inputs do between two rows, in words; nothing of lines.

    `given` are the recordings as they are, `stepped` those with rows where inputs step.
    """
    n_steps = sum(0 if one.unknown is None else len(one.unknown) for one in stepped.records)
    names = names[-given.n_inputs :]
    if any(hold != Hold.LINE for hold in holds):
        yield from _level_sentences(names, holds, given)
    for name, hold in zip(names, holds, strict=False):
        if hold in (Hold.ROW, Hold.NEXT):
            yield Hold(hold).sentence([name])
        if hold == Hold.BETWEEN:
            yield (
                f"{name} keeps its value and steps between two rows: "
                f"{counted(n_steps, 'instant')} of its steps are estimated with the laws."
            )


def _level_sentences(names: Sequence[str], holds: Sequence[str], given: Given) -> Iterator[str]:
    """Inputs whose noise is left out."""
    levels = np.vstack(given.at_levels[0])
    noise = np.vstack([record.u for record in given.records]) - levels
    for name, hold, own, left in zip(names, holds, levels.T, noise.T, strict=False):
        if hold != Hold.LINE and left.any():
            listed = ", ".join(f"{level:.3g}" for level in np.unique(own))
            yield f"{name} has the levels {listed}; its noise of {left.std():.2g} is left out."


def holds_of(
    given: Given,
    estimator: SwitchingSystemRegressor,
    order: int,
    input_hold: object,
    settings: StaySettings,
) -> tuple[Hold, ...]:
    """What each input does between two rows, as a user says, or with "auto" the recordings.

    One law is tried first: where it leaves nothing but noise, steps are no switches of modes. Where
    laws lack a mode, an input makes up for it as it can: so many modes more are asked until they
    leave nothing but noise, or say the same as one mode fewer.
    """
    if input_hold != "auto":
        return told_holds(input_hold, given.n_inputs)
    lines = (Hold.LINE,) * given.n_inputs
    inputs, in_levels = given.at_levels
    pairs = [(record.t, u) for record, u in zip(given.records, inputs, strict=True)]
    # what steps often is a command all the same where it has few levels
    channels = dict.fromkeys(in_levels, (Hold.ROW,)) | staircases(pairs)
    if not channels:
        return lines
    with Search.quietly():
        given = without_clipped(between_jumps(given).given)
        given = Origin.of(given, estimator, order).counted(given)
        given = part_of(given, LIMITS.samples_of_holds) or given
        search = Search(estimator, given, order, None, settings, lambda: None)
        if search.is_exact:
            return lines
        told: list[tuple[Hold, ...]] = []
        for n_modes in dict.fromkeys((1, *search.counts)):
            best = _best(search, n_modes, channels)
            is_as_before = best.holds in told[-1:]
            told.append(best.holds)
            if is_as_before or leaves_noise(best.reached, search.base.noise):
                break
    return told[-1]


def told_holds(input_hold: object, n_inputs: int) -> tuple[Hold, ...]:
    """What each input does as a user says it."""
    if isinstance(input_hold, str):
        one_of("input_hold", input_hold, ("auto", *map(str, Hold)))
        return (Hold(input_hold),) * n_inputs
    told = [*input_hold] if isinstance(input_hold, Iterable) else None
    if told is None or len(told) != n_inputs:
        raise ValueError(
            f"input_hold={shown(input_hold)} must be 'auto', or say of each of {n_inputs} inputs "
            "whether it is 'linear', 'zero', 'next' or 'between'."
        )
    return tuple(Hold(one_of("input_hold", one, map(str, Hold))) for one in told)


def _best(search: Search, n_modes: int, channels: Mapping[int, tuple[Hold, ...]]) -> _Trial:
    """What inputs do at best in the first rounds with so many modes."""
    lines = (Hold.LINE,) * search.given.n_inputs
    best = _Trial.of(search, lines, search.begun(n_modes).estimate)
    for channel, holds in channels.items():
        for hold in holds:
            other = [*best.holds]
            other[channel] = hold
            tried = [_Trial.of(search, other, best.reached.estimate)]
            if n_modes > 1:
                begun = search.held(other).begun(n_modes).reached
                tried.append(_Trial(tuple(other), begun.with_noise(search.base.noise)))
            for one in tried:
                is_told = hold is not Hold.BETWEEN or leaves_noise(one.reached, search.base.noise)
                if is_told and one.nats < best.nats:
                    best = one
    return best


@dataclass(frozen=True)
class _Trial:
    """Most likely laws where inputs do this and that between two rows."""

    holds: tuple[Hold, ...]
    reached: Reached

    @classmethod
    def of(cls, search: Search, holds: Sequence[Hold], start: Estimate) -> _Trial:
        """That from an estimate where they do something else."""
        given = search.given.stepped(holds)
        known = start.nodes.recordings
        times = [t[places] for t, places in zip(known.times, known.sampled, strict=True)]
        lengths = np.cumsum([len(t) for t in times])[:-1]
        states = np.split(known.joined(states_of(start)), lengths)
        guess = [
            np.column_stack([np.interp(record.t, t, column) for column in own.T])
            for record, t, own in zip(given.records, times, states, strict=True)
        ]
        recordings = Recordings.of(given.records, guess).divided(known.per_sample)
        recordings = replace(recordings, first_step=known.first_step)
        nodes = Nodes(recordings, start.nodes.stays)
        estimate = Estimate(start.laws, nodes, recordings.in_a_row(recordings.guess))
        return cls(tuple(holds), most_likely(estimate, search.base.noise, search.settings))

    @property
    def left(self) -> float:
        """V above, whatever surfaces say."""
        return self.reached.objective.value(replace(self.reached.estimate, guards=None))

    @property
    def nats(self) -> float:
        """The measure above."""
        nodes = self.reached.estimate.nodes
        n_values = max(2, int(np.isfinite(nodes.y).sum()))
        misfit = np.log(max(self.left, np.finfo(float).tiny))
        return float(0.5 * n_values * misfit + 0.5 * self.n_instants * np.log(n_values))

    @property
    def n_instants(self) -> int:
        """Instants of steps and of switches that no row tells."""
        nodes = self.reached.estimate.nodes
        return sum(map(len, nodes.recordings.unknown)) + int((~nodes.in_steps).sum())
