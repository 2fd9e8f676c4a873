"""Plants with effects in them that the declared model lacks."""

from __future__ import annotations

from collections.abc import Sequence

from sklearn.utils import Bunch

from swsysid._checks.parameters import one_of
from swsysid.datasets._undeclared.planting import planted_record
from swsysid.datasets._undeclared.plants import PLANTS
from swsysid.datasets._undeclared.unlisted import UNLISTED


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
