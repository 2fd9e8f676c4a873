"""What an identification on stays says of its switches: when, from where, to where."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton_search.settings import SETTINGS
from swsysid._data.trajectories import AT_ONCE
from swsysid._results import Array
from swsysid._stays.flow import crossings_of
from swsysid._stays.identification import StayIdentification
from swsysid._stays.intervals import flow
from swsysid._stays.laws import Laws, Modes
from swsysid._stays.pieces import Pieces
from swsysid._stays.samples import modes_of, states_of

# Of an interval, within which an instant lies on a sample, or standard errors of it; chance at
# which all of them do.
_ON_SAMPLE, _SURELY, _CHANCE = 0.01, 5.0, 1e-9


@dataclass(frozen=True)
class Switches:
    """One row for each switch, in the order of recordings and times.

    A switch at which the state goes on has its instant from the identification. One at which it
    jumps has one somewhere between two samples: the state is known at the sample before and at the
    one after.
    """

    recording: NDArray[np.intp]
    source: Modes
    target: Modes
    entered: Array  # when the source was entered, NaN where a recording began in it
    times: Array
    errors: Array  # standard errors of the times
    jumped: NDArray[np.bool_]
    known: Array  # (n_switches, 2): times at which the states on both sides are known
    ends: Array  # (n_switches, n_states + n_inputs): at the first of these times
    starts: Array  # at the second
    slopes: Array  # (n_switches, n_inputs): of the inputs; of those that step, by interval
    piece: NDArray[np.intp]  # that begins after a jump, -1 where the state goes on
    in_steps: NDArray[np.bool_]  # told by the moment in which an input steps
    stay: NDArray[np.intp]  # number of the one that it ends, as of `Visits`

    def __len__(self) -> int:
        return len(self.times)

    def take(self, rows: NDArray) -> Switches:
        """Some of the switches."""
        return Switches(*(part[rows] for part in vars(self).values()))

    def moved(self, times: Array) -> Switches:
        """The same at other instants, those of jumps within their samples."""
        times = np.where(self.jumped, np.clip(times, *self.known.T), self.times)
        return replace(self, times=times)

    def asked_at_samples(self, interval: float) -> Switches:
        """The same where a guard that the state goes on at has risen since the sample before."""
        errors = np.where(self.jumped, self.errors, np.maximum(self.errors, even(interval)))
        return replace(self, errors=errors)

    def ramps(self, interval: float) -> Array:
        """Times around switches at steps at which their guard may be zero as well.

        A step is taken for a ramp of an interval. A guard that is zero at its very end tells
        nothing of the inputs that are held there.
        """
        return np.where(self.in_steps, (0.5 - SETTINGS.beyond) * interval, 0.0)

    def reach(self, interval: float) -> Array:
        """Times within which a guard that is zero rises at them."""
        return np.where(self.in_steps, 0.5, SETTINGS.near) * interval

    def before(self, laws: Laws) -> tuple[Array, Array]:
        """Columns at the instants in the old modes, and their rates.

        Columns are states, inputs, the time since the mode was entered, and the time.
        """
        n_states, slopes = len(laws.spread), self.slopes
        x = self._flown(laws, self.source, self.ends, self.times - self.known[:, 0])
        u = self.ends[:, n_states:] + (self.times - self.known[:, 0])[:, None] * slopes
        columns = np.column_stack([x, u, self.times - self.entered, self.times])
        velocities = laws.velocities(self.source, x, u)
        ones = np.ones((len(self), 2))
        return columns, np.hstack([velocities, slopes, ones])

    def after(self, laws: Laws) -> Array:
        """States at the instants in the new modes, (n_switches, n_states)."""
        return self._flown(laws, self.target, self.starts, self.times - self.known[:, 1])

    def _flown(self, laws: Laws, modes: Modes, columns: Array, durations: Array) -> Array:
        """States some time after known ones, by the laws of modes; the time may be negative."""
        n_states = len(laws.spread)
        x, u = columns[:, :n_states], columns[:, n_states:]
        after = u + durations[:, None] * self.slopes
        return flow(laws, modes, x, u, after, durations)


@dataclass(frozen=True)
class Visits:
    """All samples with the modes that they are in: what guards must not have fired at."""

    modes: Modes  # (n_samples,)
    columns: Array  # (n_samples, n_columns), as those of `Switches.before`
    rates: Array
    shares: Array  # (n_samples,): of the samples from one step of the inputs to the next
    stays: NDArray[np.intp]  # (n_samples,): number of the stay of each
    left: Array  # (n_samples,): time to the end of the stay, infinite where a recording ends

    def asked(self, interval: float) -> NDArray[np.bool_]:
        """Samples at which a stay goes on: the one at which it is entered or left is none."""
        dwell = self.columns[:, -2]
        return (self.left > 0.5 * interval) & ~(dwell < 0.5 * interval)


def switches_of(
    found: StayIdentification, pieces: Pieces, errors: Array, began: Array | None = None
) -> tuple[Switches, Visits]:
    """Switches within the pieces and between them, and the samples of the stays.

    `errors` are the standard errors of the instants within. `began` are instants at which pieces
    began, NaN for the first one of a recording; in the middle between two samples, if nobody knows
    better.
    """
    estimate = found.estimate
    recordings, stays = estimate.nodes.recordings, estimate.nodes.stays
    if began is None:
        began = _in_the_middle(recordings.times, pieces)
    done = crossings_of(estimate.laws, estimate.nodes, estimate.states)
    states = states_of(estimate)
    n_states, padded = states.shape[2], np.concatenate([states, recordings.u], axis=2)
    columns = [padded[: len(t), k] for k, t in enumerate(recordings.times)]
    begins = [np.append(first, own.instants) for first, own in zip(began, stays, strict=True)]
    counts = [len(one.instants) for one in stays]
    firsts = np.cumsum([0, *(count + 1 for count in counts)])
    own = np.repeat(np.arange(len(stays)), counts)
    instants = estimate.nodes.instants
    within = Switches(
        pieces.recording[own],
        done.old,
        done.new,
        np.concatenate([begin[:-1] for begin in begins]),
        instants,
        np.where(done.steps, even(recordings.interval), errors),
        np.zeros(len(own), dtype=bool),
        np.column_stack([instants, instants]),
        done.columns[:, :-2],
        done.columns[:, :-2],
        done.rates[:, n_states:-2],
        np.full(len(own), -1),
        done.steps,
        own + np.arange(len(own)),  # each course has one stay more than switches
    )
    later = np.flatnonzero(pieces.follows)
    known = np.array([
        (recordings.times[k - 1][-1], recordings.times[k][0]) for k in later
    ]).reshape(-1, 2)  # fmt: skip
    source = np.array([stays[k - 1].modes[-1] for k in later], dtype=np.intp)
    ends = np.array([columns[k - 1][-1] for k in later]).reshape(len(later), padded.shape[2])
    starts = np.array([columns[k][0] for k in later]).reshape(len(later), padded.shape[2])
    duration = np.ptp(known, axis=1)[:, None]
    between_errors = even(duration[:, 0])
    at_once = between_errors < AT_ONCE * recordings.interval
    between_errors[at_once] = _blurred(estimate.laws, source[at_once], ends[at_once], found.left)
    between = Switches(
        pieces.recording[later],
        source,
        np.array([stays[k].modes[0] for k in later], dtype=np.intp),
        np.array([begins[k - 1][-1] for k in later]),
        known.mean(axis=1),
        between_errors,
        np.ones(len(later), dtype=bool),
        known,
        ends,
        starts,
        ((starts - ends) / np.where(duration > 0.0, duration, np.inf))[:, n_states:],
        later,
        np.zeros(len(later), dtype=bool),
        firsts[later] - 1,
    )
    pairs = zip(vars(within).values(), vars(between).values(), strict=True)
    switches = Switches(*(np.concatenate(pair) for pair in pairs))
    ordered = switches.take(np.lexsort((switches.times, switches.recording)))
    return ordered, _visits(found, begins)


def even(duration: Array | float) -> Array:
    """Standard error of an instant that may be at any time of some duration."""
    return np.asarray(duration / np.sqrt(12.0))


def at_samples(found: StayIdentification, errors: Array) -> bool:
    """Whether all instants lie on samples, by more than chance: what decides may be asked there.

    Samples are even, and instants lie there within their standard errors, and these are small
    enough to tell. Those at steps of inputs lie there anyway.
    """
    nodes = found.estimate.nodes
    stays, recordings = nodes.stays, nodes.recordings
    of_samples = [t[places] for t, places in zip(recordings.times, recordings.sampled, strict=True)]
    if nodes.in_steps.all() or not all(_even(t, recordings.interval) for t in of_samples):
        return False
    off = np.concatenate(
        [_off_samples(own.instants, t) for own, t in zip(stays, of_samples, strict=True)]
    )
    free = ~nodes.in_steps
    off = off[free] / recordings.interval
    errors = errors[free] / recordings.interval
    near = (off <= np.maximum(_ON_SAMPLE, _SURELY * errors)).all()
    # by how much likelier they are on samples than anywhere
    errors = np.maximum(errors, 2.0 * _ON_SAMPLE / np.sqrt(2.0 * np.pi))
    nats = -0.5 * np.square(off / errors) - np.log(errors * np.sqrt(2.0 * np.pi))
    return bool(near and nats.sum() > -np.log(_CHANCE))


def _even(t: Array, interval: float) -> bool:
    """Whether times are whole numbers of intervals apart."""
    steps = (t - t[0]) / interval
    return bool((np.abs(steps - np.round(steps)) <= _ON_SAMPLE).all())


def _off_samples(instants: Array, t: Array) -> Array:
    """Times to the nearest sample."""
    after = np.clip(np.searchsorted(t, instants), 1, len(t) - 1)
    return np.minimum(np.abs(instants - t[after - 1]), np.abs(t[after] - instants))


def _blurred(laws: Laws, modes: Modes, columns: Array, noise: Array) -> Array:
    """Times within which the states are not told from those at known instants, (n_switches,).

    The instant of an event is known better than the states there, of which a guard is made.
    """
    x, u = np.split(columns, [len(noise)], axis=1)
    rates = np.abs(laws.velocities(modes, x, u))
    return np.asarray((noise / np.maximum(rates, np.finfo(float).tiny)).min(axis=1, initial=np.inf))


def _in_the_middle(times: tuple[Array, ...], pieces: Pieces) -> Array:
    """When pieces began that follow another one, roughly."""
    before = np.array([t[-1] for t in times])
    after = np.array([t[0] for t in times])
    return np.where(pieces.follows, 0.5 * (np.roll(before, 1) + after), np.nan)


def _shares_of_steps(u: Array, recording: NDArray[np.intp]) -> Array:
    """Of each sample, one by the number of those that follow each other at the same inputs."""
    held = np.column_stack([u, recording])
    run = np.cumsum(np.append(True, (held[1:] != held[:-1]).any(axis=1))) - 1
    return np.asarray(1.0 / np.bincount(run)[run])


def _visits(found: StayIdentification, begins: list[Array]) -> Visits:
    """The samples with their modes and the time since these were entered."""
    estimate = found.estimate
    recordings, stays = estimate.nodes.recordings, estimate.nodes.stays
    modes = modes_of(estimate)
    x, u = recordings.joined(states_of(estimate)), recordings.joined(recordings.u)
    sampled = [t[places] for t, places in zip(recordings.times, recordings.sampled, strict=True)]
    places = [np.searchsorted(own.instants, t) for t, own in zip(sampled, stays, strict=True)]
    dwells = [t - begin[own] for t, begin, own in zip(sampled, begins, places, strict=True)]
    left = [
        np.append(own.instants, np.inf)[place] - t
        for own, place, t in zip(stays, places, sampled, strict=True)
    ]
    firsts = np.cumsum([0, *map(len, begins)])
    numbers = np.concatenate([own + first for own, first in zip(places, firsts, strict=False)])
    slopes = np.concatenate([
        np.gradient(recordings.u[: len(t), k], t, axis=0)[places]
        for k, (t, places) in enumerate(zip(recordings.times, recordings.sampled, strict=True))
    ])  # fmt: skip
    columns = np.column_stack([x, u, np.concatenate(dwells), np.concatenate(sampled)])
    rates = np.hstack([estimate.laws.velocities(modes, x, u), slopes, np.ones((len(x), 2))])
    shares = _shares_of_steps(u, recordings.groups)
    return Visits(modes, columns, rates, shares, numbers, np.concatenate(left))
