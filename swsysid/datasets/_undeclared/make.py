"""Plants with effects in them that the declared model lacks, and their records."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray
from sklearn.utils import Bunch

from swsysid._checks.parameters import one_of, random_numbers, real, shown, whole
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._results import Array
from swsysid.datasets._generated import MOST_ROWS, check_disturbance, disturbed
from swsysid.datasets._undeclared.kinds import KINDS
from swsysid.datasets._undeclared.plants import (
    PLANTS,
    UNLISTED,
    UnlistedEffect,
    channels_of,
    strange,
)
from swsysid.datasets._undeclared.records import Plant, PlantedEffect
from swsysid.datasets._undeclared.simulation import Planted, Run, Sizing, campaign

_GAP = 10  # samples from the end of a trajectory to the begin of the next

Rows = NDArray[np.intp]


def undeclared_kinds(system: str = "oscillator") -> tuple[str, ...]:
    """Kinds of effects that `make_undeclared` can plant in a system.

    Parameters
    ----------
    system : {"oscillator", "quartic", "two_mass", "pendulum", "tanks", "discrete"}

    Returns
    -------
    tuple of str

    Examples
    --------
    >>> from swsysid.datasets import undeclared_kinds
    >>> "overflow" in undeclared_kinds("tanks"), "overflow" in undeclared_kinds("pendulum")
    (True, False)
    """
    return PLANTS[one_of("system", system, PLANTS)].kinds


def unlisted_kinds() -> tuple[str, ...]:
    """Shapes and disturbances of no listed kind that `make_undeclared` can plant in any system.

    Returns
    -------
    tuple of str

    Examples
    --------
    >>> from swsysid.datasets import unlisted_kinds
    >>> unlisted_kinds()[:2], unlisted_kinds()[-1]
    (('rational', 'steep_tanh'), 'intermittent_disturbance')
    """
    return UNLISTED


def make_undeclared(
    effect: str | Sequence[str] | None = None,
    *,
    unlisted: str | None = None,
    system: str = "oscillator",
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
    """Data of a plant with an effect in it, and a declared model that lacks the effect.

    The plant's input `u` is a multisine with random steps, known at the samples, linear between
    them (``input_hold="linear"``) and constant before the first sample of each trajectory;
    filter and play of an actuator start in equilibrium there. A lagging state sensor shows the
    first state until the state's own history reaches it. Trajectories are recorded one after
    another, on one clock, those of `test` in turn with the others. Velocities are the true law
    at the recorded instant; friction at rest is not treated apart: the velocity then chatters
    about zero. X and the true parameters do not depend on `noise` and `outliers`, nor do inputs
    and initial states depend on the effect.

    Parameters
    ----------
    effect : str, sequence of str or None, default=None
        Kinds of effects, of those in `undeclared_kinds`; None is the declared system itself.
    unlisted : str or None, default=None
        A shape or a disturbance that no effect of the library is, of those in `unlisted_kinds`;
        `target`, `mode` and `magnitude` hold for it too.
    system : {"oscillator", "quartic", "two_mass", "pendulum", "tanks", "discrete"}
    n_samples : int, default=2000
        Number of rows of all trajectories together; `test` has as many.
    n_trajectories : int, default=8
    noise : float, default=0.02
        Scale of the noise on each column of Xdot, relative to that column's standard deviation.
    noise_kind : {"gaussian", "student"}, default="gaussian"
        ``"student"`` is t-distributed with 3 degrees of freedom and the same scale (its
        standard deviation is the square root of 3 times as large).
    outliers : float, default=0.0
        Fraction of the rows of Xdot to which gross errors are added: Gaussian with five times
        the standard deviation of each column.
    mode : int or None, default=None
        Mode in which the effect acts; None is all. For terms of the law and for actuators.
    magnitude : float, default=1.0
        With 1 the effect contributes 20 to 30 % of the standard deviation of the velocity it
        acts in (in the mode it acts in), as far as its parameter can reach that.
    target : int or None, default=None
        State equation in which it acts, or state that is recorded wrongly; None: a natural one.
    random_state : int, RandomState or None, default=None

    Returns
    -------
    Bunch
        ``X`` (n_samples, n_states + 1), states then the input, as recorded; ``Xdot`` (next
        states for ``system="discrete"``) and ``Xdot_clean``; ``is_outlier``; ``t`` in s;
        ``groups``; ``signals`` (n_samples, 3) for `input_coupling`, else None; the true
        ``modes``, and ``declared_modes``, those of the declared guard at the true states;
        ``structure`` (n_samples, n_true_features), the features of the true law at every row:
        the declared ones at true states and received inputs, then those of the effects, zero in
        a mode where they do not act. Least squares of Xdot on them, mode by mode, is the
        oracle. ``effects``, a tuple of `PlantedEffect`; ``unlisted``, an `UnlistedEffect` or None,
        with its values on every row; ``estimator``, the declared model,
        unfitted; ``system``, ``feature_names``, ``target_names``, ``time_step``,
        ``description``; and ``test``, a Bunch of fresh trajectories of the same plant with all
        that is an array here.

    Examples
    --------
    >>> from swsysid.datasets import make_undeclared
    >>> data = make_undeclared("coulomb_friction", random_state=0)
    >>> data.X.shape, data.effects[0].kind, data.effects[0].target
    ((2000, 3), 'coulomb_friction', 1)
    >>> data.estimator.fit(data.X, data.Xdot).n_modes_
    2
    """
    return planted_record(
        PLANTS[one_of("system", system, PLANTS)],
        effect,
        unlisted=unlisted,
        n_samples=n_samples,
        n_trajectories=n_trajectories,
        noise=noise,
        noise_kind=noise_kind,
        outliers=outliers,
        mode=mode,
        magnitude=magnitude,
        target=target,
        random_state=random_state,
    )


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
    data.update(effects=_planted_effects(kinds, targets, mode, planted), **_declared(plant))
    return data


def _clock(plant: Plant, n_samples: int, n_trajectories: int) -> Array:
    """Times of trajectories one after another, all on one clock: (n_times, 2 n_trajectories)."""
    n_times = -(-n_samples // n_trajectories)
    begins = (n_times + _GAP) * np.arange(2 * n_trajectories)
    return plant.time_step * np.add.outer(np.arange(n_times, dtype=float), begins)


def _halves(n_samples: int, n_trajectories: int) -> list[tuple[Rows, tuple[Rows, Rows]]]:
    """Groups of the rows, and where they are in a run: every other trajectory is for the test."""
    groups = np.arange(n_samples) * n_trajectories // n_samples
    times = np.concatenate([np.arange(n) for n in np.bincount(groups)])  # the last may be shorter
    return [(groups, (times, 2 * groups + first)) for first in (0, 1)]


def _planted_effects(
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
