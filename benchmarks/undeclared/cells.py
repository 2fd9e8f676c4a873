"""One cell of the benchmark of undeclared effects: make the record, search, compare to the truth.

A found effect is right if its kind, its state equation and (where it has one) its channel are the
planted ones. Where two kinds are the same function of the data the benchmark accepts either, if
the other is named as a rival; these equivalences are those of docs/effects.md.
"""

from __future__ import annotations

import time
import warnings
from typing import NamedTuple

import numpy as np
from sklearn.base import clone

from swsysid import EffectSearchCV, PolynomialSurfaceClassifier
from swsysid.datasets import make_undeclared
from swsysid.effects import all_effects, special_effects

__all__ = ["Cell", "effects_found", "run_cell", "states_difference"]

# Degree of the plants' guards where it is not 1.
GUARD_DEGREE = {"quartic": 2}
# Names of a planted parameter that the search calls otherwise.
NAMES = {"coulomb": "friction", "gain": "coefficient"}


# Noise on each state of a recording, relative to its spread.
RECORDED_NOISE = 0.01


class Cell(NamedTuple):
    """What is planted where; as noise "states" a recording of noisy states without velocities."""

    system: str
    kinds: tuple[str, ...]
    noise: str
    seed: int

    @classmethod
    def of(cls, record: dict) -> Cell:
        """The cell of a record."""
        system, kinds, noise, seed = record["cell"]
        return cls(system, tuple(kinds), noise, seed)


def run_cell(cell: Cell) -> list[dict]:
    """The record of one search for what was planted."""
    effect = None if not cell.kinds else cell.kinds[0] if len(cell.kinds) == 1 else cell.kinds
    is_recording = cell.noise == "states"
    kind = "gaussian" if is_recording else cell.noise
    data = make_undeclared(effect, system=cell.system, noise_kind=kind, random_state=cell.seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        start = time.process_time()
        clone(data.estimator).fit(data.X, data.Xdot)
        fit_seconds, start = time.process_time() - start, time.process_time()
        special = [effect for effect in special_effects() if effect.kind in cell.kinds]
        search = EffectSearchCV(data.estimator, effects=[*all_effects(), *special])
        known = {"t": data.t, "groups": data.groups, "signals": data.signals}
        if is_recording:
            x, inputs = recorded(data, cell.seed)
            search.fit(x, inputs=inputs, **known)
        else:
            search.fit(data.X, data.Xdot, **known)
        seconds = time.process_time() - start
        ratio, trimmed = error_ratios(search, data, GUARD_DEGREE.get(cell.system, 1))
    record = {
        "cell": [cell.system, list(cell.kinds), cell.noise, cell.seed],
        "found": [effect.kind for effect in search.effects_],
        "rivals": [[rival.kind for rival in effect.rivals] for effect in search.effects_],
        "right": [is_right(effect, data) for effect in search.effects_],
        "among_rivals": [rival_is_right(effect, data) for effect in search.effects_],
        "ratio": ratio,
        "trimmed_ratio": trimmed,
        "covered": coverage(search, data),
        "effects": effects_found(search),
        "fit_seconds": fit_seconds,
        "seconds": seconds,
    }
    return [record]


def effects_found(search) -> list[dict]:
    """Names, p-values, numbers and intervals of all effects found."""
    return [
        {
            "name": f"{effect.kind} of {effect.place}",
            "p_value": effect.p_value,
            "parameters": {name: effect.parameters[name] for name in effect.intervals},
            "intervals": {name: list(pair) for name, pair in effect.intervals.items()},
        }
        for effect in search.effects_
    ]


def recorded(data, seed: int, noise: float = RECORDED_NOISE) -> list[np.ndarray]:
    """States with noise, and the inputs."""
    x, inputs = np.split(data.X, [data.Xdot.shape[1]], axis=1)
    drawn = np.random.default_rng(1000 + seed).standard_normal(x.shape)
    return [x + noise * x.std(axis=0) * drawn, inputs]


def states_difference(system: str) -> float:
    """Largest difference of the states between a record without noise and one with 2 %."""
    clean, noisy = (make_undeclared(system=system, noise=n, random_state=0) for n in (0.0, 0.02))
    return float(np.abs(clean.X - noisy.X).max())


def is_right(effect, data) -> bool:
    """True if an effect found is one of those planted."""
    return any(
        effect.kind == planted.kind and _same_place(effect, planted) for planted in data.effects
    )


def rival_is_right(effect, data) -> bool:
    """True if a rival named for it is one of those planted, in the right equation."""
    return any(
        rival.kind == planted.kind and rival.target == planted.target
        for rival in effect.rivals
        for planted in data.effects
    )


def _same_place(effect, planted) -> bool:
    """Where a guard has a band or a region is new, there is no one equation to name."""
    if planted.kind in ("extra_mode", "guard_hysteresis"):
        return True
    return effect.target == planted.target


def error_ratios(search, data, guard_degree: int) -> list[float]:
    """Held-out error over that of the true structure, fitted to the same rows.

    Of all rows, and without the hundredth with the largest errors of each of the two: next to the
    guard a single row on the wrong side of either surface can decide the first.

    The true structure gets the true features and modes; next to the surface it has the margin LP
    of the true modes in the guard's own degree, as the search has its own.
    """
    test = data.test
    mine = search.predict(test.X, t=test.t, groups=test.groups, signals=test.signals)
    modes = test.modes
    if np.unique(data.modes).size > 1 and not any(
        effect.kind in ("guard_hysteresis", "extra_mode") for effect in data.effects
    ):
        surface = PolynomialSurfaceClassifier(guard_degree).fit(data.X, data.modes)
        modes = surface.predict(test.X)
    truth = np.empty_like(test.Xdot)
    for mode in np.unique(modes):
        rows, here = data.modes == mode, modes == mode
        coef = np.linalg.lstsq(data.structure[rows], data.Xdot[rows], rcond=None)[0]
        truth[here] = test.structure[here] @ coef
    scale = data.Xdot.std(axis=0)
    errors = [np.sort(np.mean(((test.Xdot - one) / scale) ** 2, axis=1)) for one in (mine, truth)]
    kept = len(test.X) - len(test.X) // 100
    return [
        float(np.sqrt(errors[0][:count].mean() / errors[1][:count].mean()))
        for count in (len(test.X), kept)
    ]


def coverage(search, data) -> list[bool]:
    """For each parameter planted and found: whether the truth is inside the interval."""
    inside = []
    for effect in search.effects_:
        for planted in data.effects:
            if effect.kind != planted.kind or effect.target != planted.target:
                continue
            for name, value in planted.parameters.items():
                own = NAMES.get(name, name)
                if own in effect.intervals and isinstance(value, (int, float)):
                    low, high = effect.intervals[own]
                    # an amplitude has no sign, its phase has
                    size = abs(value) if name == "amplitude" else value
                    if name == "phase":  # whole turns are nothing
                        size += 2 * np.pi * np.round(((low + high) / 2 - size) / (2 * np.pi))
                    inside.append(bool(low <= size <= high))
    return inside
