"""Records cut into segments, and batched rollouts over them, smooth in the parameters."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swsysid._data.trajectories import Record, spread
from swsysid._results import Array
from swsysid.refinement._settings import SETTINGS
from swsysid.refinement._steps import cross_smoothly, switched_step
from swsysid.refinement._system import Maps, ParameterSets, RowSystem


class Segments:
    """Records cut into segments of `length` steps, padded to that length, side by side.

    A segment ends at the sample with which the next one begins; the last of a record is shorter.
    `linear` says that inputs are linear between samples, else they are held; there are `substeps`
    Runge-Kutta steps between two samples.
    """

    def __init__(self, records: list[Record], length: int, *, linear: bool, substeps: int):
        self.linear, self.substeps = linear, substeps
        # record, and sample of it, at which each segment begins
        self.places = [
            (k, first)
            for k, record in enumerate(records)
            for first in range(0, len(record.t) - 1, length)
        ]
        self.record, self.first = np.array(self.places).T
        ends = np.array([len(records[k].t) - 1 for k, _ in self.places])
        self.count = np.minimum(self.first + length, ends) - self.first  # steps of each
        self.follower = self.first + self.count < ends  # true if the next segment continues it
        longest, n = int(self.count.max()), len(self.places)
        self.steps = np.zeros((longest, n))  # durations, of zero where a segment has ended
        self.inputs = np.zeros((longest + 1, n, records[0].u.shape[1]))
        # measured values, NaN where there is none or where the next segment begins
        self.y = np.full((longest + 1, n, records[0].y.shape[1]), np.nan)
        for s, (k, first) in enumerate(self.places):
            stop = self.count[s] + 1
            rows = slice(first, first + stop)
            self.steps[: stop - 1, s] = np.diff(records[k].t[rows])
            self.inputs[:stop, s] = records[k].u[rows]
            self.inputs[stop:, s] = self.inputs[stop - 1, s]
            # the sample shared with the next segment counts there
            seen = stop - 1 if self.follower[s] else stop
            self.y[:seen, s] = records[k].y[rows][:seen]

    def __len__(self) -> int:
        return len(self.places)


def rollout(
    maps: Maps, sets: ParameterSets, segments: Segments, starts: Array, bound: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """States of every owner on every segment, and whether they stayed bounded.

    From starts (n_owners, n_segments, n_states) come states (n_steps + 1, n_owners, n_segments,
    n_states) and truth values (n_owners, n_segments); a diverging state is held at `bound`.
    """
    n_owners, n_rows, n_states = starts.shape
    system = RowSystem(maps, sets, np.repeat(np.arange(n_owners), n_rows))
    x, substeps = starts.reshape(-1, n_states), segments.substeps
    states = np.empty((len(segments.steps) + 1, *starts.shape))
    states[0], bounded = starts, np.ones(len(x), dtype=bool)
    modes = None
    with np.errstate(all="ignore"):  # a diverging trial is bounded below, not a warning
        for k, durations in enumerate(segments.steps):
            u = np.tile(segments.inputs[k], (n_owners, 1))
            later = np.tile(segments.inputs[k + 1], (n_owners, 1))
            change = later - u if segments.linear else np.zeros_like(u)
            duration = np.tile(durations, n_owners)[:, None]
            if modes is None or u.shape[1]:  # a jump of the inputs may have changed the mode
                modes = system.modes(x, u)
            if maps.discrete_time:
                x, modes = np.where(duration > 0.0, system.field(modes)(x, u), x), None
            else:
                change, step = change / substeps, duration / substeps
                for _ in range(substeps):
                    x, modes = switched_step(system, x, u, change, step, modes, cross_smoothly)
                    u = u + change
            escaped = ~(np.abs(x) <= bound).all(axis=1)
            if escaped.any():
                bounded &= ~escaped
                x = np.clip(np.where(np.isnan(x), bound, x), -bound, bound)
            states[k + 1] = x.reshape(starts.shape)
    return states, bounded.reshape(n_owners, n_rows)


def substeps_for(system: RowSystem, x: Array, u: Array, duration: float) -> int:
    """Runge-Kutta steps between samples that the fastest rate of the model asks for.

    The rate is the spectral radius of the field's Jacobian that nine of ten points stay below, in
    the fastest mode; a root or a kink may make it infinite at a few.
    """
    if system.maps.discrete_time:
        return 1
    size = spread(x)
    moves = np.diag(1e-5 * size)
    rate = 0.0
    for mode in range(system.maps.n_modes):
        field = system.field(np.full(len(x), mode))
        slopes = [(field(x + move, u) - field(x, u)) / 1e-5 / size for move in moves]
        radius = np.abs(np.linalg.eigvals(np.nan_to_num(np.stack(slopes, axis=2)))).max(axis=1)
        rate = max(rate, float(np.quantile(radius, 0.9)))
    return int(np.clip(np.ceil(duration * rate / SETTINGS.step_rate), 1, SETTINGS.most_substeps))


def guessed_states(
    maps: Maps,
    sets: ParameterSets,
    records: list[Record],
    starts: Array,
    measured: NDArray[np.intp],
    linear: bool,
) -> tuple[list[Array], Array]:
    """States of each record, (n_samples, n_states), and the bound of a state that has diverged.

    Where the initial states `starts` are NaN, `measured` states, those that the channels of the
    records are, start as measured and others at 0. Hidden states are carried by the given model,
    with the measured ones reset at every sample.
    """
    given = np.isfinite(starts)
    starts = np.where(given, starts, 0.0)
    largest = np.nanmax(np.abs(np.vstack([record.y for record in records])), axis=0)
    limit = np.maximum(np.abs(starts).max(axis=0), max(1.0, float(largest.max())))
    limit[measured] = np.maximum(largest[: len(measured)], np.abs(starts[:, measured]).max(axis=0))
    bound = SETTINGS.diverged * np.where(limit > 0.0, limit, 1.0)
    guess = []
    for record, start, known in zip(records, starts, given, strict=True):
        filled = record.filled[:, : len(measured)]
        start[measured] = np.where(known[measured], start[measured], filled[0])
        carried = np.tile(start, (len(record.t), 1))
        carried[1:, measured] = filled[1:]
        if len(measured) < maps.n_states:
            length = 1 if len(measured) else len(record.t) - 1
            for first in range(0, len(record.t) - 1, length):
                piece = Segments([record.part(first, length)], length, linear=linear, substeps=1)
                run, _ = rollout(maps, sets, piece, carried[None, [first]], bound)
                carried[first : first + length + 1] = run[:, 0, 0]
                carried[first + length, measured] = filled[first + length]
        guess.append(carried)
    return guess, bound
