"""A rollout of an automaton from what a user gives: checked, begun in the right mode, run.

In discrete time: test the guards at a row, jump, make the next row.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike

from swsysid._automaton.columns import CLOCKS
from swsysid._automaton.continuous import PlainAutomaton, follow
from swsysid._automaton.parts import AutomatonParts, RunningMap, first_mode
from swsysid._automaton.transitions import AffineReset, Transition
from swsysid._checks.arrays import state, table
from swsysid._checks.parameters import whole
from swsysid._results import Array, Status, SwitchEvent, Trajectory
from swsysid._simulation.bands import with_band
from swsysid._simulation.events import History
from swsysid._simulation.inputs import Options, checked_options, checked_request, stretches
from swsysid._simulation.system import GuardedLaws

# Rows that a map goes ahead in one mode before its guards are tested at all of them: few after a
# transition, and more and more while none is taken.
_FEWEST_AHEAD, _MOST_AHEAD = 16, 512


def roll_out(
    automaton: AutomatonParts,
    x0: ArrayLike,
    t: ArrayLike,
    inputs: ArrayLike | None,
    mode: int | None,
    input_hold: str,
    options: Mapping[str, object],
) -> Trajectory:
    """A rollout; arguments as `HybridAutomaton.simulate` takes them."""
    checked = checked_options(options)
    begin = whole("mode", mode, least=0, most=automaton.n_modes - 1, also=(None,))
    rows = _first_rows(automaton, x0)
    widths = automaton.n_states, automaton.n_inputs
    newest, times, samples = checked_request(rows[-1], t, inputs, input_hold, widths)
    held = np.empty((len(times), 0)) if samples is None else samples
    if len(held) < len(rows):
        raise ValueError(
            f"t and inputs have {len(held)} rows; give at least the {len(rows)} of x0."
        )
    if begin is None:
        begin = _begin(automaton, rows, held, times[0])
    if automaton.discrete_time:
        done = iterate(automaton, begin, rows, times, held, checked)
    else:
        pieces = list(stretches(times, samples, input_hold))
        done = follow(PlainAutomaton(automaton, begin), newest, times, pieces, checked)
    return replace(done, names=tuple(automaton.state_names))


def band_of(
    automaton: AutomatonParts,
    covariance: Array | None,
    x0: ArrayLike,
    t: ArrayLike,
    inputs: ArrayLike | None,
    mode: int | None,
    options: Mapping[str, object],
) -> Trajectory:
    """A rollout with its band, if options ask for one; all begin in the mode of the first."""
    begins = mode

    def rolled(drawn: AutomatonParts, asked: dict[str, object]) -> Trajectory:
        nonlocal begins
        hold = str(asked.pop("input_hold", "zero"))
        done = roll_out(drawn, x0, t, inputs, begins, hold, asked)
        begins = int(done.modes[0]) if len(done.modes) else begins
        return done

    return with_band(automaton, covariance, options, rolled)


def _first_rows(automaton: AutomatonParts, x0: ArrayLike) -> Array:
    """The states that a rollout starts from, (lags + 1, n_states)."""
    if not automaton.lags:
        return state("x0", x0, automaton.n_states)[None]
    rows = table("x0", x0, n_columns=automaton.n_states)
    if len(rows) != automaton.lags + 1:
        raise ValueError(
            f"x0 has {len(rows)} rows; give the states at the first {automaton.lags + 1} times."
        )
    return rows


def _begin(automaton: AutomatonParts, rows: Array, inputs: Array, begin: float) -> int:
    """The mode at the start, as the guards or the recordings tell it."""
    lags = automaton.lags
    clocks = (0.0, lags if automaton.discrete_time else begin)
    lagged = rows[::-1].ravel()
    columns = np.concatenate([lagged, inputs[: lags + 1][::-1].ravel(), clocks])
    recorded = automaton.first_modes
    return first_mode(automaton.transitions, automaton.n_modes, columns, lagged, recorded)


def iterate(
    automaton: RunningMap,
    mode: int,
    rows: Array,
    t: Array,
    inputs: Array,
    options: Options,
) -> Trajectory:
    """Iterate a map with lags from its first rows on, (lags + 1, n_states), the oldest first.

    These are the states at the first of the times, so that the inputs beside them are known.
    Arguments as `HybridAutomaton.simulate` takes them, checked.
    """
    scales = options.scales(automaton.extent, rows[-1])
    laws = GuardedLaws(automaton, scales.repeated(automaton.lags + 1))
    n_lags, n_states = automaton.lags, automaton.n_states
    seen = _lagged_inputs(inputs, n_lags)
    done = History(t, states=list(rows[:-1]), modes=[mode] * n_lags)
    status = Status.COMPLETED if len(inputs) == len(t) else Status.INPUT_RANGE
    lagged = rows[::-1].ravel()  # x[k], x[k-1], ..., x[k-lags]
    k, entered, size = n_lags, n_lags, _FEWEST_AHEAD
    lately = np.full((n_states + automaton.n_inputs) * (n_lags + 1) + len(CLOCKS), np.nan)
    with np.errstate(all="ignore"):  # a diverging model is a status, not a warning
        while k < len(inputs):
            given = seen[k - n_lags : k - n_lags + size]
            ahead = _ahead(automaton, laws, lagged, given, mode)
            last = len(given)
            inside = int(laws.within(ahead[:last]).cumprod().sum())
            columns = _columns(automaton, ahead[:inside], given[:inside], k, entered)
            at, taken = _taken(automaton.transitions, mode, columns, lately)
            done.states.extend(ahead[:at, :n_states])
            done.modes.extend([mode] * at)
            if taken is None and inside < last:
                finite = bool(np.isfinite(ahead[inside]).all())
                status = Status.STATE_LIMIT if finite else Status.STEP_FAILURE
                break
            k += at
            if taken is None:
                lately, lagged = columns[-1], ahead[last]
                size = min(2 * size, _MOST_AHEAD)
                continue
            before = ahead[at, :n_states]
            done.events.append(SwitchEvent(float(t[k]), before, mode, taken.target, taken.kind))
            lagged, mode, entered = _jumped(ahead[at], taken.reset), taken.target, k
            done.states.append(lagged[:n_states])
            done.modes.append(mode)
            [lately] = _columns(automaton, lagged[None], given[at, None], k, entered)
            lagged = _followed(lagged, laws.velocity(lagged, given[at], mode))
            k, size = k + 1, _FEWEST_AHEAD
    return done.trajectory(status, n_states)


def _lagged_inputs(inputs: Array, n_lags: int) -> Array:
    """u[k], ..., u[k-lags] of every row from the first on that has them."""
    n = len(inputs) - n_lags
    return np.hstack([inputs[n_lags - age : n_lags - age + n] for age in range(n_lags + 1)])


def _columns(automaton: RunningMap, lagged: Array, given: Array, first: int, entered: int) -> Array:
    """Columns of guards at rows one after the other in one mode; laws may see further inputs."""
    rows = np.arange(first, first + len(lagged), dtype=float)
    seen = given[:, : automaton.n_inputs * (automaton.lags + 1)]
    return np.column_stack([lagged, seen, rows - entered, rows])


def _ahead(
    automaton: RunningMap, laws: GuardedLaws, lagged: Array, given: Array, mode: int
) -> Array:
    """The lagged state and those that follow it while no transition is taken, one row more."""
    size, n_states, n_rows = len(lagged), automaton.n_states, len(given)
    flat = np.empty(n_rows * n_states + size)  # the newest first: lagged states lie side by side
    flat[n_rows * n_states :] = lagged
    affine = automaton.affine_law(mode)
    if affine is not None:
        matrix, constant, by_inputs = affine
        added = given @ by_inputs.T + constant
    for k, newest in enumerate(range((n_rows - 1) * n_states, -1, -n_states)):
        x = flat[newest + n_states : newest + n_states + size]
        following = laws.velocity(x, given[k], mode) if affine is None else matrix @ x + added[k]
        flat[newest : newest + n_states] = following
    return sliding_window_view(flat, size)[::-n_states]


def _followed(lagged: Array, newest: Array) -> Array:
    return np.concatenate([newest, lagged])[: len(lagged)]


def _jumped(lagged: Array, reset: AffineReset | None) -> Array:
    """The lagged state after a reset of all of it, or of its newest part."""
    if reset is None:
        return lagged
    size = len(reset.offset)
    return np.concatenate([reset.applied(lagged[:size]), lagged[size:]])


def _taken(
    transitions: Sequence[Transition], mode: int, columns: Array, lately: Array
) -> tuple[int, Transition | None]:
    """The first row at which a transition out of a mode has a guard that is not negative.

    One back to the mode itself must have been negative a row before; `lately` is the row before
    the first one, unknown at the start.
    """
    first, taken = len(columns), None
    for one in transitions:
        if one.source != mode:
            continue
        holds = one.guard.values(columns[:first]) >= 0.0
        if one.target == mode:
            before = np.vstack([lately, columns])[: len(holds)]
            holds &= one.guard.values(before) < 0.0
        if holds.any():
            first, taken = int(holds.argmax()), one
    return first, taken
