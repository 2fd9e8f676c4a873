"""What a user gives a search, and what is said of it before anything is sought.

Rows with velocities, or recordings of states alone. Velocities may have been measured by nobody,
but made of the samples that they are given with; and declared laws may explain nothing of them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.signal import savgol_filter
from sklearn.base import BaseEstimator

from swsysid._checks.arrays import names_of, table
from swsysid._checks.estimators import column_names, rows_and_velocities, rows_of
from swsysid._checks.parameters import shown
from swsysid._data.records import Records, make_records
from swsysid._data.trajectories import label_text, trajectories
from swsysid._data.windows import Windows
from swsysid._effect_model.declared import Declared
from swsysid._effect_model.joint_fit import JointFit
from swsysid._effect_search.coloured_noise import Stretches
from swsysid._effect_search.folds import exact_states
from swsysid._effect_search.recording import Measured
from swsysid._effect_search.settings import SETTINGS
from swsysid._effect_search.words import rate
from swsysid._noise import robust_scale, root_mean_square
from swsysid._results import Array, Trajectory
from swsysid._stays.given import FEWEST_SAMPLES, check_channels, read_given
from swsysid._stays.start import named
from swsysid.differentiation import choose_smoothing
from swsysid.effects import Effect, all_effects

_EXPLAINS_NOTHING = 0.1  # of a velocity's variance: a declared model with less is none
_DIFFERENTIATED_ROWS = 500  # of one trajectory: a difference is one in all of its rows
_FEWEST_DIFFERENTIATED = 100  # rows: of fewer nobody says that they are differences
_LONGEST_DIFFERENTIATOR = 51  # samples of a moving polynomial
_ADDING_UP = 30  # steps over which the noise of measured velocities leads away from states
_TOO_CLOSE = 0.5  # share of that: velocities nearer to the states were made of them


@dataclass(frozen=True)
class Recorded:
    """Recordings one after the other, missing states filled in, and what they are called."""

    records: Records
    names: NDArray | None  # of the recordings; None if there is one without a name


def listed_effects(effects: object) -> list[Effect]:
    """The library of a search: 'all' or a list of effects."""
    if isinstance(effects, str) and effects == "all":
        return all_effects()
    listed = list(effects) if isinstance(effects, Iterable) else [None]
    library = [effect for effect in listed if isinstance(effect, Effect)]
    if isinstance(effects, str) or len(library) < len(listed):
        raise ValueError(
            f"effects={shown(effects)} must be 'all' or a list of swsysid.effects.Effect."
        )
    return library


def read_recordings(
    search: BaseEstimator,
    x: object,
    t: object,
    groups: object,
    signals: object,
    inputs: object,
    order: int = 1,
) -> Recorded:
    """Check recordings of measured states and inputs; `search` learns the columns of both.

    With order 2 positions are measured; speeds stand beside them as a filter makes them.
    """
    if t is None and not isinstance(x, (list, tuple, Mapping, Trajectory)):
        # It begins with the sentence that scikit-learn's own checks of estimators look for.
        raise ValueError(
            f"This {type(search).__name__} estimator requires y to be passed, but the target y is "
            "None; give velocities, or the times t of measured states."
        )
    given = read_given(x, t, groups, inputs)
    check_channels(given)
    x = np.vstack([record.filled for record in given.records])
    u = np.vstack([record.u for record in given.records])
    t = np.concatenate([record.t for record in given.records])
    labels = np.repeat(np.arange(len(given.records)), [len(record.t) for record in given.records])
    columns = (x, u) if order == 1 else (x, slopes_of(x, t, labels), u)
    given = given.with_rates(order)
    X = rows_of(search, named(np.hstack(columns), given.names), reset=True)
    logged = None if signals is None else _in_order(signals, np.concatenate(given.rows))
    records = make_records(
        X,
        given.n_channels,
        t=t,
        groups=labels,
        signals=logged,
        names=column_names(search),
        signal_names=None if logged is None else names_of(signals, logged.shape[1], "signal"),
    )
    records = replace(records, n_hidden=given.n_positions)
    if len(given.records) == 1 and groups is None:
        return Recorded(records, None)
    return Recorded(records, np.array([label_text(label) for label in given.labels]))


def slopes_of(x: Array, t: Array, groups: NDArray[np.intp]) -> Array:
    """Slopes at every sample, by parabolas as long as the noise asks, shorter at the ends."""
    chosen = choose_smoothing(x, t, groups, degree=2, too_short="drop", clipped="keep").window
    runs = [rows for _, rows in trajectories(groups)]
    windows = Windows(t, runs, (chosen or FEWEST_SAMPLES - 1) // 2)
    return np.asarray(windows.slopes @ x)


def read_rows(
    search: BaseEstimator,
    X: object,
    y: object,
    t: ArrayLike | None,
    groups: ArrayLike | None,
    signals: ArrayLike | None,
    inputs: object,
) -> tuple[Records, Array]:
    """Check rows of states and inputs, and their velocities; `search` learns the columns."""
    # inputs that come beside rows with velocities would be lost
    if inputs is not None:
        raise ValueError(
            "inputs are given beside velocities; make them the last columns of X, or leave the "
            "velocities out."
        )
    rows, velocities = rows_and_velocities(search, X, y, reset=True)
    n_states = velocities.shape[1] if velocities.ndim > 1 else 1
    names = column_names(search)
    records = make_records(rows, n_states, t=t, groups=groups, signals=signals, names=names)
    return records, velocities


def _in_order(signals: object, order: NDArray[np.intp]) -> Array:
    return table("signals", signals, len(order))[order]


def alarms(
    declared: Declared, fit: JointFit, measured: Measured, rows: NDArray[np.intp]
) -> tuple[str, ...]:
    """Sentences on velocities that nobody measured, and on laws that explain next to nothing."""
    return (*_of_differences(declared, measured), *_of_the_laws(declared, fit, measured, rows))


def _of_differences(declared: Declared, measured: Measured) -> tuple[str, ...]:
    """A sentence on velocities that are differences of the states beside them."""
    records = measured.records
    if measured.recorded is not None or declared.discrete_time:
        return ()
    made = states_differentiated(records, measured.targets)
    if not made:
        return ()
    names = ", ".join(f"{records.names[state]}'" for state in made)
    return (
        f"Nobody has measured {names}: these are slopes of neighbouring samples, which share their "
        "noise and smear what jumps; give the states and their times without velocities, fit(x, "
        "t=t, groups=groups, inputs=inputs), and the search makes them itself.",
    )


def _of_the_laws(
    declared: Declared, fit: JointFit, measured: Measured, rows: NDArray[np.intp]
) -> tuple[str, ...]:
    """A sentence for each equation of which the fit to some rows explains next to nothing."""
    if declared.known is not None:
        return ()  # laws are stated to be completed: what they lack may be nearly all there is
    records, targets = measured.records, measured.targets[rows]
    left = fit.residuals(records, rows, targets)
    exact, sentences = exact_states(left, targets), []
    features = fit.features(records, rows)
    for state in np.flatnonzero(~exact):
        share = _explained(left[:, state], targets[:, state])
        if share >= _EXPLAINS_NOTHING:
            continue
        squares = _explained(
            _least_squares(features, targets[:, state], fit.modes), targets[:, state]
        )
        advice = "check its terms, its units and the order of the columns"
        if squares >= _EXPLAINS_NOTHING:
            if not _mostly_rests(targets[:, state]):
                continue  # its terms are not the wrong ones: it lacks some
            advice = (
                f"least squares with the same terms explain {squares:.0%}, for most of the record "
                "is at rest: declare the model with loss='squared', or leave the samples at rest "
                "out"
            )
        law = rate(records.equations[state], fit.laws.discrete_time, records.static)
        sentences.append(
            f"The declared model explains {max(share, 0.0):.0%} of the variation of {law}; "
            f"{advice}."
        )
    return tuple(sentences)


def _explained(left: Array, targets: Array) -> float:
    """Share of the variance; all of it where there is none."""
    variance = float(np.var(targets))
    return 1.0 - float(np.mean(left**2)) / variance if variance > 0.0 else 1.0


def _mostly_rests(targets: Array) -> bool:
    """Whether the usual velocity is none beside those of a few rows."""
    usual = float(robust_scale(targets - np.median(targets)))
    return usual < _EXPLAINS_NOTHING * float(targets.std())


def _least_squares(features: Array, targets: Array, modes: NDArray[np.intp]) -> Array:
    """What a regression on the library in each mode leaves over."""
    left = targets.copy()
    for mode in np.unique(modes):
        rows = modes == mode
        coef = np.linalg.lstsq(features[rows], targets[rows], rcond=None)[0]
        left[rows] -= features[rows] @ coef
    return left


def states_differentiated(records: Records, targets: Array) -> list[int]:
    """States whose velocities are their own central differences, or slopes of a moving fit.

    What a sensor measures is no function of neighbouring samples of the state, not to rounding.
    Forward differences are left out: a plant that was simulated by Euler's steps has them. And so
    is a velocity that is a column of X itself, as in x' = v: it is exact, whoever has made v.
    """
    if not records.timed:
        return []
    assert records.t is not None
    rows = max(records.trajectories, key=len)[:_DIFFERENTIATED_ROWS]
    X, t, velocities = records.X[rows], records.t[rows], targets[rows]
    return [
        state
        for state in records.states
        if not (X == velocities[:, [state]]).all(axis=0).any()
        and _is_made_of(X[:, state], t, velocities[:, state])
    ]


def follow_the_states(records: Records, targets: Array, left: Array) -> bool:
    """Whether velocities keep to their states more closely than what laws leave of them allows.

    `left` are residuals, like `targets` of shape (n_samples, n_states). The noise of a velocity
    that a sensor has measured adds up along a trajectory, over n steps to the root of n times that
    of one, and to more where a filter has smeared it. That of a velocity made of the states cannot
    lead away from them by more than their own noise.
    """
    if not records.timed or records.static:
        return False
    order, series = Stretches.of(records, SETTINGS.gap_steps)
    n_steps = _ADDING_UP
    X, velocities, steps = records.X[order, : records.n_states], targets[order], series.waits[1:]
    waits = np.where(series.inside[1:], steps, 0.0)[:, None]
    slopes = 0.5 * (velocities[1:] + velocities[:-1])
    astray = np.cumsum(np.diff(X, axis=0) - waits * slopes, axis=0)
    together = series.stretch[1:][n_steps:] == series.stretch[:-1][:-n_steps]
    if not together.any():
        return False
    away = root_mean_square((astray[n_steps:] - astray[:-n_steps])[together])
    shared = np.array([series.smeared(column) for column in left[order].T])
    expected = robust_scale(left) * series.step * np.sqrt(n_steps * shared)
    return bool((away < _TOO_CLOSE * expected).any())


def _is_made_of(x: Array, t: Array, velocity: Array) -> bool:
    """Whether a velocity is a slope of the samples beside it, to rounding."""
    if len(x) < _FEWEST_DIFFERENTIATED or np.ptp(velocity) == 0.0:
        return False
    least = np.diff(t).min()
    rounding = 1e3 * np.finfo(float).eps * (np.abs(x).max() / least + np.abs(velocity).max())
    for degree, half, slope in _slopes(x, t):
        # of samples that are smoother than this every good slope is the true one
        if np.abs(np.diff(x, degree + 1)).max() / least < 1e2 * rounding:
            continue
        inner = slice(half, len(x) - half)
        if np.abs(velocity[inner] - slope[inner]).max() <= rounding:
            return True
    return False


def _slopes(x: Array, t: Array) -> Iterator[tuple[int, int, Array]]:
    """Slopes by usual means, exact up to a degree, and at how many samples of each end they differ.

    A moving polynomial of an odd degree has the slopes of the even degree before it.
    """
    yield 2, 1, np.gradient(x, t)
    steps = np.diff(t)
    if np.ptp(steps) > 1e-6 * steps.mean():
        return
    for window in range(5, _LONGEST_DIFFERENTIATOR + 1, 2):
        for degree in (2, 4):
            delta = float(steps.mean())
            yield degree, window // 2, savgol_filter(x, window, degree, deriv=1, delta=delta)
