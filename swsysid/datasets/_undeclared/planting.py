"""Records of one plant, whatever it is, with effects in it that the declared model lacks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray
from sklearn.utils import Bunch

from swsysid._checks.parameters import one_of, random_numbers, real, shown, whole
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._results import Array
from swsysid.datasets._disturbance import MOST_ROWS, check_disturbance, disturbed
from swsysid.datasets._undeclared.kinds import KINDS
from swsysid.datasets._undeclared.records import SETTINGS, Plant, PlantedEffect
from swsysid.datasets._undeclared.simulation import Run, campaign
from swsysid.datasets._undeclared.sizing import Planted, Sizing
from swsysid.datasets._undeclared.unlisted import UNLISTED, UnlistedEffect, channels_of, strange

Rows = NDArray[np.intp]


def planted_record(
    plant: Plant,
    effect: str | Sequence[str] | None = None,
    *,
    unlisted: str | None = None,
    n_samples: int = 2000,
    n_trajectories: int = 8,
    noise: float = 0.02,
    noise_kind: str = "gaussian",
    outliers: float = 0.0,
    mode: int | None = None,
    magnitude: float = 1.0,
    target: int | None = None,
    random_state=None,
) -> Bunch:
    """What `make_undeclared` returns, of a plant that is given."""
    kinds = _kinds(effect)
    whole("n_trajectories", n_trajectories)
    if whole("n_samples", n_samples, most=MOST_ROWS) < 2 * n_trajectories:
        raise ValueError("give at least one trajectory, and two samples for each.")
    check_disturbance(noise, outliers, noise_kind)
    real("magnitude", magnitude, above=0)
    targets = [_target(plant, kind, mode, target) for kind in kinds]
    if len(set(kinds)) < len(kinds):
        raise ValueError(f"effect={effect!r} names a kind twice; name each once.")
    where = None if unlisted is None else _unlisted_target(plant, unlisted, mode, target)
    # the three streams keep X the same whatever the effect's size and the noise
    streams = random_numbers(random_state).randint(2**31 - 1, size=3)
    runs_rng, effects_rng, noise_rng = (np.random.RandomState(seed) for seed in streams)
    clock = _clock(plant, n_samples, n_trajectories)

    def size(place: int) -> Sizing:
        return Sizing(plant, effects_rng, magnitude, place, mode, float(clock.max()))

    planted = [KINDS[kind].make(size(place)) for kind, place in zip(kinds, targets, strict=True)]
    further = None if unlisted is None or where is None else strange(size(where), unlisted)
    mechanisms = [*(one.mechanism for one in planted), *([] if further is None else [further])]
    done = campaign(plant, mechanisms, clock, runs_rng)
    disturb = partial(disturbed, noise=noise, outliers=outliers, rng=noise_rng, kind=noise_kind)
    data, data.test = (
        Bunch(groups=groups, **_part(plant, done, clock, rows, disturb, "input_coupling" in kinds))
        for groups, rows in _halves(n_samples, n_trajectories)
    )
    for part in (data, data.test):
        part.unlisted = None
        if unlisted is not None and further is not None:
            values = further.coefficients[0] * part.structure[:, -1]
            channels = channels_of(plant, unlisted, further.target)
            part.unlisted = UnlistedEffect(unlisted, further.target, mode, channels, values)
    data.update(effects=_told(kinds, targets, mode, planted), **_declared(plant))
    return data


def _clock(plant: Plant, n_samples: int, n_trajectories: int) -> Array:
    """Times of trajectories one after another, all on one clock: (n_times, 2 n_trajectories)."""
    n_times = -(-n_samples // n_trajectories)
    begins = (n_times + SETTINGS.gap) * np.arange(2 * n_trajectories)
    return plant.time_step * np.add.outer(np.arange(n_times, dtype=float), begins)


def _halves(n_samples: int, n_trajectories: int) -> list[tuple[Rows, tuple[Rows, Rows]]]:
    """Groups of the rows, and where they are in a run: every other trajectory is for the test."""
    groups = np.arange(n_samples) * n_trajectories // n_samples
    times = np.concatenate([np.arange(n) for n in np.bincount(groups)])  # the last may be shorter
    return [(groups, (times, 2 * groups + first)) for first in (0, 1)]


def _told(
    kinds: Sequence[str], targets: Sequence[int], mode: int | None, planted: Sequence[Planted]
) -> tuple[PlantedEffect, ...]:
    """The effects as the caller is told of them."""
    return tuple(
        PlantedEffect(kind, place, mode, one.channel, dict(one.parameters))
        for kind, place, one in zip(kinds, targets, planted, strict=True)
    )


def _declared(plant: Plant) -> dict:
    """The declared model and the words for a record."""
    return dict(
        system=plant.name,
        estimator=SwitchingSystemRegressor(
            n_modes=plant.n_modes,
            feature_library=plant.library,
            discrete_time=plant.discrete,
            random_state=0,
        ),
        feature_names=plant.columns,
        target_names=[f"{name}{'+' if plant.discrete else chr(39)}" for name in plant.states],
        time_step=plant.time_step,
        input_hold="linear",
        description=(
            f"{plant.description} Samples every {plant.time_step:g} s; the input is a multisine "
            f"with random steps, {'known' if plant.discrete else 'linear between samples'}, and "
            "constant before the first sample of a trajectory."
        ),
    )


def _part(
    plant: Plant, done: Run, clock: Array, rows: tuple, disturb: Callable, logged: bool
) -> dict:
    """What is recorded at some samples, and what is true there."""
    clean = done.velocities[rows]
    Xdot, is_outlier = disturb(clean)
    return dict(
        X=np.column_stack([done.recorded[rows], done.u[rows]]),
        Xdot=Xdot,
        Xdot_clean=clean,
        is_outlier=is_outlier,
        t=clock[rows],
        modes=done.modes[rows],
        declared_modes=plant.modes(done.x[rows]),
        structure=done.structure[rows],
        signals=done.signals[rows] if logged else None,
    )


# -- refusals ----------------------------------------------------------------------------------


def _kinds(effect: object) -> tuple[str, ...]:
    """Kinds of effects, as names."""
    if effect is None or isinstance(effect, str):
        return () if effect is None else (effect,)
    if not isinstance(effect, Sequence) or not all(isinstance(kind, str) for kind in effect):
        raise TypeError(f"effect={shown(effect)} must be None, a name or a list of names.")
    return tuple(effect)


def _target(plant: Plant, kind: str, mode: int | None, target: int | None) -> int:
    if kind not in plant.kinds:
        raise ValueError(
            f"effect {kind!r} does not exist on {plant.name!r}; choose from "
            f"{', '.join(plant.kinds)}."
        )
    known = KINDS[kind]
    whole("mode", mode, least=0, also=(None,))
    if mode is not None and not known.in_one_mode:
        raise ValueError(f"effect {kind!r} has no mode of its own; leave mode=None.")
    _check_place(plant, kind, mode, target, known.targets(plant))
    return plant.target_of(kind) if target is None else target


def _unlisted_target(plant: Plant, kind: object, mode: int | None, target: int | None) -> int:
    name = one_of("unlisted", kind, UNLISTED)
    _check_place(plant, name, mode, target, tuple(plant.equations))
    return plant.target if target is None else target


def _check_place(
    plant: Plant, kind: str, mode: int | None, target: int | None, targets: tuple[int, ...]
) -> None:
    whole("mode", mode, least=0, also=(None,))
    whole("target", target, least=0, also=(None,))
    if mode is not None and mode not in range(plant.n_modes):
        raise ValueError(
            f"mode={shown(mode)} does not exist on {plant.name!r}; give a number below "
            f"{plant.n_modes}."
        )
    if target is not None and target not in targets:
        allowed = ", ".join(map(str, targets))
        raise ValueError(
            f"effect {kind!r} on {plant.name!r} cannot have "
            f"target={shown(target)}; choose from {allowed}."
        )
