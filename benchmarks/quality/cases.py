"""The systems of the quality benchmark, and how their velocities are spoilt.

Every case draws its states either from trajectories on a fixed time grid (never at the instants
of switches, where labels are coin flips) or, for systems without dynamics worth following, from
a box. Held-out states come from other trajectories and carry no noise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from sklearn.preprocessing import PolynomialFeatures

from swsysid.datasets import make_damped_oscillator, make_quartic_oscillator, make_switching_network

__all__ = ["CASES", "MAIN", "N_TEST", "STRESS", "Case", "Data", "Scenario", "make_data"]

# Held-out samples come in sets from different trajectories. One of 2000 samples is worth 0.007 of
# balanced accuracy where a mode holds four per cent of them (SPS): too coarse for gaps of 0.005.
N_TEST, N_TEST_SETS = 2000, 10
# A sample is near a guard if its mode changes within this fraction of the states' spread.
_NEAR = 0.02


@dataclass(frozen=True)
class System:
    """Fields, the mode in which each acts, and where states are met."""

    fields: list[Callable]
    modes: Callable
    states: Callable  # (random generator, number) -> states

    def velocities(self, X):
        """Velocity of every sample in its mode."""
        modes = self.modes(X)
        every = np.array([law(X) for law in self.fields])
        return every[modes, np.arange(len(X))]


@dataclass(frozen=True)
class Case:
    """A system with what every method is told: modes, degree of the library, of the surface.

    ``library=None`` is Phi(x) = x. ``make(rng)`` draws the system, the same for fit and test.
    """

    name: str
    n_modes: int
    library: int | None
    surface: int
    make: Callable


@dataclass(frozen=True)
class Scenario:
    """How the training data are spoilt, and how close to the oracle an answer must come.

    `median` and `worst` bound the loss of balanced mode accuracy against the oracle; `told` says
    in a title what `name`, the key of the records, may leave out.
    """

    name: str
    spoil: Callable = field(default=lambda clean, rng: clean)
    n_samples: int = 2000
    extra_library: int = 0
    extra_surface: int = 0
    median: float = 0.005
    worst: float = 0.015
    title: str = ""

    @property
    def told(self) -> str:
        """What is done to the data, in a few words."""
        return self.title or self.name


@dataclass(frozen=True)
class Data:
    """What a method may see, and behind it the truth."""

    case: Case
    X: np.ndarray
    Xdot: np.ndarray
    modes: np.ndarray
    X_test: np.ndarray
    Xdot_test: np.ndarray
    modes_test: np.ndarray
    away: np.ndarray  # test samples that are not near a guard


def make_data(case: Case, scenario: Scenario, seed: int) -> Data:
    """Training and held-out samples of a case, the former spoilt."""
    clean = _clean_data(case.name, scenario.n_samples, seed)
    told = replace(
        case,
        library=(case.library or 1) + scenario.extra_library
        if scenario.extra_library
        else case.library,
        surface=case.surface + scenario.extra_surface,
    )
    Xdot = scenario.spoil(clean.Xdot, np.random.default_rng([seed, 2]))
    return replace(clean, case=told, Xdot=Xdot)


@lru_cache(maxsize=4)
def _clean_data(name: str, n_samples: int, seed: int) -> Data:
    case = CASES[name]
    system = case.make(np.random.default_rng([seed, 0]))
    X = system.states(np.random.default_rng([seed, 1]), n_samples)
    held_out = np.random.default_rng([seed, 3])
    X_test = np.concatenate([system.states(held_out, N_TEST) for _ in range(N_TEST_SETS)])
    modes_test = system.modes(X_test)
    directions = np.random.default_rng(0).standard_normal((32, X.shape[1]))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    around = [system.modes(X_test + _NEAR * X.std(axis=0) * step) for step in directions]
    return Data(
        case=case,
        X=X,
        Xdot=system.velocities(X),
        modes=system.modes(X),
        X_test=X_test,
        Xdot_test=system.velocities(X_test),
        modes_test=modes_test,
        away=(np.array(around) == modes_test).all(axis=0),
    )


# -- where states are met --------------------------------------------------------------------


def _from_box(half_width: float, n_states: int) -> Callable:
    return lambda rng, number: rng.uniform(-half_width, half_width, (number, n_states))


def _from_trajectories(velocities, starts, t_end: float, step: float, substeps: int) -> Callable:
    """Samples drawn without replacement from the grid points of trajectories together."""

    def draw(rng, number):
        X = starts(rng)
        grid, small = [X], step / substeps
        for _ in range(round(t_end / step)):
            for _ in range(substeps):
                first = velocities(X)
                second = velocities(X + small / 2 * first)
                third = velocities(X + small / 2 * second)
                fourth = velocities(X + small * third)
                X = X + small / 6 * (first + 2 * second + 2 * third + fourth)
            grid.append(X)
        return _choose(np.concatenate(grid), rng, number)

    return draw


def _choose(X, rng, number: int):
    return X[rng.choice(len(X), number, replace=False)]


def _packaged(make: Callable) -> Callable:
    """A system of `swsysid.datasets`."""

    def of_package(rng):
        system = make(n_samples=1, random_state=0).system
        fields = [
            lambda X, mode=mode: system.velocities(X, np.full(len(X), mode)) for mode in (0, 1)
        ]

        def states(rng, number):
            return make(n_samples=number, random_state=int(rng.integers(2**31))).X

        return System(fields, system.modes, states)

    return of_package


# -- the systems -----------------------------------------------------------------------------


def _hopper(rng) -> System:
    """A hopping leg: a stiff spring on the ground, free fall above it."""
    fields = [
        lambda X: np.column_stack([X[:, 1], 1 - 10 * (X[:, 0] - 1)]),
        lambda X: np.column_stack([X[:, 1], -np.ones(len(X))]),
    ]
    system = System(fields, lambda X: (X[:, 0] > 1).astype(int), None)
    starts = lambda rng: np.array([0.8, -0.1]) + 0.02 * rng.standard_normal((16, 2))  # noqa: E731
    return replace(system, states=_from_trajectories(system.velocities, starts, 5.0, 0.033, 8))


def _lv_sphere(rng) -> System:
    """Predator and prey that slow down within a circle round their equilibrium."""

    def field(a, b):
        return lambda X: np.column_stack([a * X[:, 0] * (1 - X[:, 1]), b * X[:, 1] * (X[:, 0] - 1)])

    def inside(X):
        return (np.square(X - 1).sum(axis=1) < 0.161**2).astype(int)

    system = System([field(3, 1), field(2, 0.5)], inside, None)
    starts = lambda rng: np.column_stack([rng.uniform(0.8, 1.4, 60), rng.uniform(0.8, 1.2, 60)])  # noqa: E731
    return replace(system, states=_from_trajectories(system.velocities, starts, 10.0, 0.01, 1))


def _track(rng) -> System:
    """The four-mode track of recurrent switching linear systems; velocity is x(k+1) - x(k)."""

    def turn(angle, centre):
        cos, sin = np.cos(angle), np.sin(angle)
        rotation = np.array([[cos, -sin], [sin, cos]])
        return lambda X: (X - centre) @ rotation.T + centre - X

    def straight(step):
        return lambda X: np.tile([step, 0.0], (len(X), 1))

    def modes(X):
        on_side = [X[:, 0] > 2, X[:, 0] < -2, X[:, 1] > 0]
        return np.select(on_side, [0, 1, 2], 3)

    fields = [
        turn(-np.pi / 24, np.array([2.0, 0.0])),
        turn(-np.pi / 48, np.array([-2.0, 0.0])),
        straight(0.1),
        straight(-0.35),
    ]
    system = System(fields, modes, None)

    def states(rng, number):
        X, grid = np.array([0.0, 1.0]) + 0.05 * rng.standard_normal((8, 2)), []
        for _ in range(1 + 2 * number // 8):
            grid.append(X)
            X = X + system.velocities(X) + 0.01 * rng.standard_normal(X.shape)
        return _choose(np.concatenate(grid), rng, number)

    return replace(system, states=states)


def _random_fields(modes: Callable, n_modes: int, n_states: int, degree: int) -> Callable:
    """Polynomial fields with standard normal coefficients; `modes` may be drawn as well."""

    def make(rng):
        monomials = PolynomialFeatures(degree).fit(np.zeros((1, n_states)))
        coef = rng.standard_normal((n_modes, n_states, monomials.n_output_features_))
        fields = [lambda X, rows=rows: monomials.transform(X) @ rows.T for rows in coef]
        return System(fields, modes(rng), _from_box(2.0, n_states))

    return make


def _sectors(rng) -> Callable:
    return lambda X: np.digitize(np.arctan2(X[:, 1], X[:, 0]), [-np.pi / 3, np.pi / 3])


def _quadrants(rng) -> Callable:
    return lambda X: 2 * (X[:, 0] > 0) + (X[:, 1] > 0)


def _rings(n_modes: int, n_states: int = 2) -> Callable:
    """Nested balls that hold the same number of samples each."""
    states = np.random.default_rng(0).uniform(-2, 2, (100_000, n_states))
    edges = np.quantile(np.square(states).sum(axis=1), np.arange(1, n_modes) / n_modes)
    return lambda rng: lambda X: np.digitize(np.square(X).sum(axis=1), edges)


def _cones(n_modes: int, n_states: int) -> Callable:
    """Mode of the largest of random linear functions."""

    def draw(rng):
        directions = rng.standard_normal((n_modes, n_states))
        return lambda X: (X @ directions.T).argmax(axis=1)

    return draw


def _line(slope: float, intercept: float) -> Callable:
    return lambda X: slope * X + intercept


def _band_map(rng) -> System:
    """A static map of an input with one law in the middle and another on both sides."""
    return System(
        [_line(1, 0.2), _line(-1, 2)],
        lambda X: ((X[:, 0] > -1) & (X[:, 0] < 2)).astype(int),
        _from_box(4.0, 1),
    )


def _five_pieces(rng) -> System:
    """A static map of an input in five pieces."""
    return System(
        [_line(1, 0.2), _line(-1, 2), _line(1, -1), _line(0, 2), _line(2, -10)],
        lambda X: np.digitize(X[:, 0], [-1, 2, 4, 6]),
        lambda rng, number: rng.uniform(-4, 8, (number, 1)),
    )


def _band_arx(rng) -> System:
    """y(k+1) = 0.6 y + 0.3 u, with the other sign while |u| < 0.8 + 0.2 y; columns y, u."""

    def law(sign):
        return lambda X: sign * (0.6 * X[:, :1] + 0.3 * X[:, 1:])

    def modes(X):
        return (np.abs(X[:, 1]) < 0.8 + 0.2 * X[:, 0]).astype(int)

    system = System([law(1.0), law(-1.0)], modes, None)

    def states(rng, number):
        inputs, y = rng.uniform(-2, 2, number + 100), np.array([[0.5]])
        grid = []
        for u in inputs:
            grid.append([y[0, 0], u])
            y = system.velocities(np.array(grid[-1:]))
        return np.array(grid)[100:]

    return replace(system, states=states)


CASES = {
    case.name: case
    for case in (
        Case("SLS", 2, None, 2, _packaged(make_damped_oscillator)),
        Case("SPS", 2, 3, 4, _packaged(make_quartic_oscillator)),
        Case("network", 2, 2, 2, _packaged(make_switching_network)),
        Case("hopper", 2, 1, 1, _hopper),
        Case("lv_sphere", 2, 2, 2, _lv_sphere),
        Case("sectors", 3, 1, 1, _random_fields(_sectors, 3, 2, 1)),
        Case("quadrants", 4, 1, 1, _random_fields(_quadrants, 4, 2, 1)),
        Case("rings3", 3, 2, 2, _random_fields(_rings(3), 3, 2, 2)),
        Case("rings5", 5, 2, 2, _random_fields(_rings(5), 5, 2, 2)),
        Case("track", 4, 1, 1, _track),
        Case("n4_ball", 2, 1, 2, _random_fields(_rings(2, 4), 2, 4, 1)),
        Case("n4_cubic", 2, 3, 1, _random_fields(_cones(2, 4), 2, 4, 3)),
        Case("n4_cones", 3, 1, 1, _random_fields(_cones(3, 4), 3, 4, 1)),
        Case("n4_balls", 3, 2, 2, _random_fields(_rings(3, 4), 3, 4, 2)),
        Case("pwarx_band", 2, 1, 2, _band_map),
        Case("pwarx_five", 5, 1, 1, _five_pieces),
        Case("pwarx_arx", 2, 1, 2, _band_arx),
    )
}


# -- how velocities are spoilt ---------------------------------------------------------------


def _noise(level: float) -> Callable:
    return lambda clean, rng: clean + level * clean.std(axis=0) * rng.standard_normal(clean.shape)


def _outliers(clean, rng):
    hit = rng.random((len(clean), 1)) < 0.05
    return clean + hit * 5 * clean.std(axis=0) * rng.standard_normal(clean.shape)


def _one_sided(clean, rng):
    hit = rng.random((len(clean), 1)) < 0.2
    return clean + hit * 50 * clean.std(axis=0) * (1 + 0.1 * rng.standard_normal(clean.shape))


def _uneven(clean, rng):
    """Ten times the noise in the first column; a single column has the larger one."""
    level = np.where(np.arange(clean.shape[1]) == 0, 0.1, 0.01)
    return clean + level * clean.std(axis=0) * rng.standard_normal(clean.shape)


MAIN = (
    Scenario("clean"),
    Scenario("noise 5 %", _noise(0.05), title="5 % Gaussian noise"),
    Scenario("outliers 5 %", _outliers, title="5 % of the rows outliers"),
)
_HARD = {"median": 0.02, "worst": np.inf}
STRESS = (
    Scenario("noise 15 %", _noise(0.15), title="15 % Gaussian noise", **_HARD),
    Scenario("one-sided 20 %", _one_sided, title="20 % one-sided outliers of 50 std", **_HARD),
    Scenario("N = 400", _noise(0.05), n_samples=400, title="N = 400, 5 % noise", **_HARD),
    Scenario(
        "degrees too high",
        _noise(0.05),
        extra_library=1,
        extra_surface=2,
        title="degrees + 1 and + 2, 5 % noise",
        **_HARD,
    ),
    Scenario("uneven noise", _uneven, title="noise 10 % and 1 %", **_HARD),
)
