"""What is said before any search: velocities that nobody measured, laws that explain nothing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swsysid._effect_model.declared import Declared
from swsysid._effect_model.joint_fit import JointFit
from swsysid._effect_search.differences import states_differentiated
from swsysid._effect_search.folds import exact_states
from swsysid._effect_search.recording import Measured
from swsysid._effect_search.settings import SETTINGS
from swsysid._noise import robust_scale
from swsysid._results import Array


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
    exact, told = exact_states(left, targets), []
    features = fit.features(records, rows)
    for state in np.flatnonzero(~exact):
        share = _explained(left[:, state], targets[:, state])
        if share >= SETTINGS.explains_nothing:
            continue
        squares = _explained(
            _least_squares(features, targets[:, state], fit.modes), targets[:, state]
        )
        advice = "check its terms, its units and the order of the columns"
        if squares >= SETTINGS.explains_nothing:
            if not _mostly_rests(targets[:, state]):
                continue  # its terms are not the wrong ones: it lacks some
            advice = (
                f"least squares with the same terms explain {squares:.0%}, for most of the record "
                "is at rest: declare the model with loss='squared', or leave the samples at rest "
                "out"
            )
        name = records.names[state]
        law = f"the next {name}" if fit.laws.discrete_time else f"{name}'"
        told.append(
            f"The declared model explains {max(share, 0.0):.0%} of the variation of {law}; "
            f"{advice}."
        )
    return tuple(told)


def _explained(left: Array, targets: Array) -> float:
    """Share of the variance; all of it where there is none."""
    variance = float(np.var(targets))
    return 1.0 - float(np.mean(left**2)) / variance if variance > 0.0 else 1.0


def _mostly_rests(targets: Array) -> bool:
    """Whether the usual velocity is none beside those of a few rows."""
    usual = float(robust_scale(targets - np.median(targets)))
    return usual < SETTINGS.explains_nothing * float(targets.std())


def _least_squares(features: Array, targets: Array, modes: NDArray[np.intp]) -> Array:
    """What a regression on the library in each mode leaves over."""
    left = targets.copy()
    for mode in np.unique(modes):
        rows = modes == mode
        coef = np.linalg.lstsq(features[rows], targets[rows], rcond=None)[0]
        left[rows] -= features[rows] @ coef
    return left
