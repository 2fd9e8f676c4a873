"""The paper's three systems, generated with their exact derivatives, modes and coefficients.

They have polynomial vector fields and a polynomial guard, and are known exactly. Velocities get
noise and gross errors.
"""

from __future__ import annotations

import inspect
from collections.abc import Sequence

import numpy as np
from numpy.random import RandomState
from numpy.typing import ArrayLike, NDArray
from sklearn.utils import Bunch

from swsysid._checks.parameters import one_of, random_numbers, real, whole
from swsysid._results import Array
from swsysid._stays.recordings import Recordings
from swsysid._stays.rollouts import rolled_out
from swsysid.refinement import StatedModel, StatedSurface
from swsysid.refinement._parameters import ParametrizedPlant

# Gigabytes of rows: more are no data set to try something on.
MOST_ROWS = 10**8


def make_damped_oscillator(
    n_samples: int | None = 2000,
    *,
    noise: float = 0.0,
    outliers: float = 0.0,
    n_trajectories: int = 200,
    t_end: float = 10.0,
    time_step: float = 0.01,
    random_state=None,
    return_X_y: bool = False,
):
    r"""Mass on a spring whose damping depends on the side (the paper's linear example).

    .. math:: \dot x = v, \qquad \dot v = -x - \gamma v, \\
        \gamma = 0.1 \text{ where } x \ge 0 \text{ (mode 0)}, \; 0.5 \text{ where } x < 0
        \text{ (mode 1)}.

    Trajectories start uniformly in [-5, 5]^2 and are known every `time_step` on a fixed grid.
    The samples are drawn from all of these points together, without replacement; the instants of
    the switches are never among them unless they fall on the grid.

    Parameters
    ----------
    n_samples : int or None, default=2000
        Number of samples; None takes every point of every trajectory.
    noise : float, default=0.0
        Standard deviation of Gaussian noise on each column of Xdot, relative to that column's.
    outliers : float, default=0.0
        Fraction of the rows of Xdot to which gross errors are added: Gaussian with five times
        the standard deviation of each column.
    n_trajectories : int, default=200
    t_end : float, default=10.0
        Length of each trajectory in s.
    time_step : float, default=0.01
        Spacing of the grid in s.
    random_state : int, RandomState or None, default=None
        The same number gives the same X whatever the noise and the outliers.
    return_X_y : bool, default=False
        Return ``(X, Xdot)`` in place of the Bunch.

    Returns
    -------
    Bunch
        ``X`` (n_samples, n_states) and ``Xdot``, also as ``data`` and ``target``;
        ``Xdot_clean`` without noise; ``is_outlier`` (n_samples,); ``t`` in s, ``groups``
        (the trajectory of each row; rows of one are in time order) and true ``modes``, each
        (n_samples,); ``feature_names``, ``target_names``; ``x0`` (n_trajectories, n_states);
        the truth as ``coef`` (2, n_states, n_features) for the features
        ``feature_library=library_degree`` (None: the states themselves), ``guard`` (a function
        X -> values, positive in mode 1), ``guard_coef`` for all monomials up to
        ``guard_degree``, and ``system`` with ``system.simulate(x0, t)`` for true rollouts;
        ``DESCR``.

    Examples
    --------
    >>> from swsysid.datasets import make_damped_oscillator
    >>> data = make_damped_oscillator(500, random_state=0)
    >>> data.X.shape, data.coef[:, 1].tolist()
    ((500, 2), [[-1.0, -0.1], [-1.0, -0.5]])
    """
    return _make(
        make_damped_oscillator,
        _damped_oscillator(),
        box=5.0,
        grid=(n_trajectories, t_end, time_step),
        sampling=(n_samples, noise, outliers, random_state),
        return_X_y=return_X_y,
    )


def make_quartic_oscillator(
    n_samples: int | None = 2000,
    *,
    variant: str = "paper",
    noise: float = 0.0,
    outliers: float = 0.0,
    n_trajectories: int = 300,
    t_end: float = 20.0,
    time_step: float = 0.01,
    random_state=None,
    return_X_y: bool = False,
):
    r"""Quartic oscillator that changes its law with its energy (the paper's polynomial example).

    .. math:: \dot x = y, \qquad \dot y = -x - 0.3 x^3 - 0.1 y^3 + h(x, y)

    with :math:`h_1 = -0.1 + 0.2 x^2 + 0.3 xy` and :math:`h_2 = 0.1 xy + 0.1 x^2 - 0.1 y`. The
    guard is :math:`E - 3` with the energy
    :math:`E = \tfrac12 y^2 + \tfrac12 x^2 + \tfrac{0.3}{4} x^4`. In the paper's text h_1 acts
    in mode 0, E <= 3, and h_2 in mode 1, E > 3; the code its authors published has them
    exchanged. Trajectories start uniformly in [-4.5, 4.5]^2 and settle at low energy: about
    4.5 % of their points are in mode 1 (9 % with ``t_end=10``), so look at balanced accuracies.

    Parameters
    ----------
    variant : {"paper", "code"}, default="paper"
        Which field acts where.
    n_samples, noise, outliers, n_trajectories, t_end, time_step, random_state, return_X_y
        As in `make_damped_oscillator`.

    Returns
    -------
    Bunch
        With the fields of `make_damped_oscillator`; the laws have degree 3, the guard degree 4.

    Examples
    --------
    >>> from swsysid.datasets import make_quartic_oscillator
    >>> data = make_quartic_oscillator(500, n_trajectories=20, random_state=0)
    >>> data.library_degree, data.guard_degree, data.guard([[0.0, 2.0]])
    (3, 4, array([-1.]))
    """
    one_of("variant", variant, ("paper", "code"))
    return _make(
        make_quartic_oscillator,
        _quartic_oscillator(exchanged=variant == "code"),
        box=4.5,
        grid=(n_trajectories, t_end, time_step),
        sampling=(n_samples, noise, outliers, random_state),
        return_X_y=return_X_y,
    )


def make_switching_network(
    n_samples: int | None = 2000,
    *,
    noise: float = 0.0,
    outliers: float = 0.0,
    n_trajectories: int = 200,
    t_end: float = 3.0,
    time_step: float = 0.01,
    random_state=None,
    return_X_y: bool = False,
):
    r"""Three coupled nodes that lose links far from rest (in the code that goes with the paper).

    .. math:: \dot x = -0.1 x + 0.01 x^2 - L_q x, \qquad L_q = D_q - A_q

    with squares taken elementwise and D_q the row sums of A_q. Inside the sphere
    :math:`\|x\|^2 = 9` (mode 0) every node sees both others; outside (mode 1) only the next one
    in a ring. Trajectories start uniformly in [-4, 4]^3.

    Parameters
    ----------
    n_samples, noise, outliers, n_trajectories, t_end, time_step, random_state, return_X_y
        As in `make_damped_oscillator`.

    Returns
    -------
    Bunch
        With the fields of `make_damped_oscillator`; the laws and the guard have degree 2.

    Examples
    --------
    >>> from swsysid.datasets import make_switching_network
    >>> data = make_switching_network(500, random_state=0)
    >>> data.X.shape, data.guard([[0.0, 0.0, 4.0]])
    ((500, 3), array([7.]))
    """
    return _make(
        make_switching_network,
        _switching_network(),
        box=4.0,
        grid=(n_trajectories, t_end, time_step),
        sampling=(n_samples, noise, outliers, random_state),
        return_X_y=return_X_y,
    )


def _damped_oscillator() -> PolynomialSwitchingSystem:
    fields = [[[0.0, 1.0], [-1.0, -damping]] for damping in (0.1, 0.5)]
    # monomials 1, x, v; positive where x < 0
    return PolynomialSwitchingSystem(fields, None, [0.0, -1.0, 0.0], 1, ["x", "v"])


def _quartic_oscillator(exchanged: bool) -> PolynomialSwitchingSystem:
    # monomials  1   x   y  xx   xy  yy   xxx xxy xyy   yyy
    velocity = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    first = [-0.1, -1.0, 0.0, 0.2, 0.3, 0.0, -0.3, 0.0, 0.0, -0.1]
    second = [0.0, -1.0, -0.1, 0.1, 0.1, 0.0, -0.3, 0.0, 0.0, -0.1]
    laws = (second, first) if exchanged else (first, second)
    energy = np.zeros(15)  # monomials up to degree 4: xxxx comes after the ten above
    energy[[0, 3, 5, 10]] = -3.0, 0.5, 0.5, 0.3 / 4
    fields = [[velocity, law] for law in laws]
    return PolynomialSwitchingSystem(fields, 3, energy, 4, ["x", "y"])


def _switching_network() -> PolynomialSwitchingSystem:
    complete = np.array([[0.0, 1.0, 1.0], [1.0, 0.0, 1.0], [1.0, 1.0, 0.0]])
    ring = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    # monomials 1, x1, x2, x3, x1x1, x1x2, x1x3, x2x2, x2x3, x3x3
    squares = [4, 7, 9]
    coef = np.zeros((2, 3, 10))
    for mode, adjacency in enumerate((complete, ring)):
        laplacian = np.diag(adjacency.sum(axis=1)) - adjacency
        coef[mode, :, 1:4] = -0.1 * np.eye(3) - laplacian
        coef[mode, range(3), squares] = 0.01
    sphere = np.zeros(10)
    sphere[[0, *squares]] = -9.0, 1.0, 1.0, 1.0
    return PolynomialSwitchingSystem(coef, 2, sphere, 2, ["x1", "x2", "x3"])


def _make(
    function,
    system: PolynomialSwitchingSystem,
    *,
    box: float,
    grid: tuple[int, float, float],
    sampling: tuple[int | None, float, float, object],
    return_X_y: bool,
):
    n_trajectories, t_end, time_step = grid
    n_samples, noise, outliers, random_state = sampling
    whole("n_trajectories", n_trajectories)
    whole("n_samples", n_samples, also=(None,))
    check_disturbance(noise, outliers)
    n_steps = round(real("t_end", t_end, above=0) / real("time_step", time_step, above=0))
    if n_steps < 1:
        raise ValueError("give at least one trajectory, longer than one time_step.")
    available = n_trajectories * (n_steps + 1)
    if available > MOST_ROWS:
        raise ValueError(
            f"{n_trajectories} trajectories of {n_steps} steps have more than {MOST_ROWS:.0e} "
            "points; reduce n_trajectories or t_end, or choose a longer time_step."
        )
    if n_samples is not None and n_samples > available:
        raise ValueError(
            f"n_samples={n_samples}, but the trajectories have {available} points; increase "
            "n_trajectories or t_end, or shorten time_step."
        )
    rng, names = random_numbers(random_state), system.feature_map.names_in
    x0 = rng.uniform(-box, box, size=(n_trajectories, len(names)))
    states = integrate_grid(system, x0, n_steps, time_step).reshape(-1, len(names))
    rows = np.arange(len(states))
    if n_samples is not None:
        # sorted: by trajectory, and in time order within each
        rows = np.sort(rng.choice(len(states), n_samples, replace=False))
    X, groups, t = states[rows], rows // (n_steps + 1), rows % (n_steps + 1) * time_step
    clean = system.velocities(X)
    Xdot, is_outlier = disturbed(clean, noise, outliers, rng)
    if return_X_y:
        return X, Xdot
    return Bunch(
        X=X,
        Xdot=Xdot,
        data=X,
        target=Xdot,
        Xdot_clean=clean,
        is_outlier=is_outlier,
        t=t,
        groups=groups,
        modes=system.modes(X),
        x0=x0,
        feature_names=list(names),
        target_names=[f"{name}'" for name in names],
        DESCR=inspect.getdoc(function),
        system=system,
        coef=system.coef_,
        library_degree=system.degree,
        guard=system.guard,
        guard_coef=system.guard_coef,
        guard_degree=system.guard_degree,
    )


class PolynomialSwitchingSystem(StatedModel):
    """Two polynomial vector fields: mode 1 where the guard is positive, else mode 0.

    Coefficients are in the order of scikit-learn's `PolynomialFeatures`; `degree` None means the
    states themselves, without a constant.

    Examples
    --------
    A ball on a floor of stiff springs, x' = v and v' = -1 - 100 min(x, 0):

    >>> import numpy as np
    >>> from swsysid.datasets._generated import PolynomialSwitchingSystem
    >>> air, floor = [[0, 0, 1], [-1, 0, 0]], [[0, 0, 1], [-1, -100, 0]]
    >>> ball = PolynomialSwitchingSystem([air, floor], 1, [0, -1, 0], 1, ["x", "v"])
    >>> ball.velocities([[0.5, 0.0], [-0.5, 0.0]])
    array([[ 0., -1.],
           [ 0., 49.]])
    >>> round(ball.simulate([0.5, 0.0], [0.0, 1.5]).events[0].time, 6)
    1.0
    """

    def __init__(
        self,
        coef: ArrayLike,
        degree: int | None,
        guard_coef: ArrayLike,
        guard_degree: int,
        states: Sequence[str],
    ):
        surface = StatedSurface(guard_coef, guard_degree)
        super().__init__(degree, coef, states=states, surface=surface)
        self.degree, self.guard_degree, self.guard_coef = degree, guard_degree, surface.coef_[0]
        self._guard = surface.linear_form(len(states))

    def guard(self, X: ArrayLike) -> Array:
        """Values of the guard, (..., n_states) -> (...)."""
        X = np.asarray(X, dtype=float)
        rows = X.reshape(-1, X.shape[-1])
        return (self._guard.features(rows) @ self.guard_coef).reshape(X.shape[:-1])

    def modes(self, X: ArrayLike) -> NDArray[np.intp]:
        """Mode of every sample."""
        return self.predict_modes(X)

    def velocities(self, X: ArrayLike, modes: NDArray[np.intp] | None = None) -> Array:
        """Velocity of every sample in its mode, or in given modes."""
        X = np.asarray(X, dtype=float)
        active = self.modes(X) if modes is None else modes
        return self.switching_model.velocities(X)[active, np.arange(len(active))]


def integrate_grid(model: StatedModel, x0: Array, n_steps: int, step: float) -> Array:
    """States (n_trajectories, n_steps + 1, n_states) at the times 0, step, ..., n_steps * step.

    Steps in which the guard changes sign are cut there; the cut itself is no sample.
    """
    n_trajectories, n_states = x0.shape
    times, shape = step * np.arange(n_steps + 1), (n_steps + 1, n_trajectories)
    nothing = np.broadcast_to(np.nan, (*shape, n_states))
    grid = Recordings(
        times=(times,) * n_trajectories,
        sampled=(np.arange(len(times)),) * n_trajectories,
        steps=np.broadcast_to(step, (n_steps, n_trajectories)),
        y=nothing,
        u=np.empty((*shape, 0)),
        guess=nothing,
        first_step=1.0,
    )
    plant = ParametrizedPlant.known(model.switching_model, np.ones(n_states))
    laws, guards, _ = plant.parts(np.zeros(0))
    return np.stack([run.states for run in rolled_out(laws, guards, grid, x0)])


def check_disturbance(noise: float, outliers: float, kind: str = "gaussian") -> None:
    """Refuse what is no noise."""
    real("noise", noise, least=0)
    real("outliers", outliers, least=0, most=1)
    one_of("noise_kind", kind, ("gaussian", "student"))


def disturbed(
    clean: Array, noise: float, outliers: float, rng: RandomState, kind: str = "gaussian"
) -> tuple[Array, NDArray[np.bool_]]:
    """Velocities with noise and gross errors, and which rows have the latter.

    Both are relative to the standard deviation of each column; ``"student"`` is t-distributed
    with 3 degrees of freedom.
    """
    spread = clean.std(axis=0)
    student = kind == "student"
    drawn = rng.standard_t(3, clean.shape) if student else rng.standard_normal(clean.shape)
    hit = np.zeros(len(clean), dtype=bool)
    hit[rng.permutation(len(clean))[: round(outliers * len(clean))]] = True
    gross = 5.0 * spread * rng.standard_normal(clean.shape)  # as the docstrings of users say
    return clean + noise * spread * drawn + np.where(hit[:, np.newaxis], gross, 0.0), hit
