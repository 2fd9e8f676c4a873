"""Small fits and searches that print all they say; among their candidates are exact ties."""

import warnings

import numpy as np

from swsysid import (
    EffectSearchCV,
    HybridAutomaton,
    HybridAutomatonRegressor,
    PolynomialSurfaceClassifier,
    SwitchingSystemRegressor,
    TrajectoryIdentifier,
)
from swsysid.datasets import make_damped_oscillator, make_switching_network, make_undeclared
from swsysid.effects import (
    Bias,
    CoulombFriction,
    InputCoupling,
    LoadFriction,
    Polynomial,
    SensorOffset,
)


def rows():
    """Laws, surface and certificates of rows with noise, and of rows without, with symmetries."""
    for make, noise in ((make_damped_oscillator, 0.05), (make_switching_network, 0.0)):
        data = make(300, noise=noise, random_state=0)
        n_modes = len(np.unique(data.modes))
        model = SwitchingSystemRegressor(n_modes, random_state=0).fit(data.X, data.Xdot)
        print(*model.equations(), *model.surface_.equations(), sep="\n")
        print(f"{model.objective_:.6g}", model.n_iter_, np.bincount(model.modes_))


def surfaces():
    """Classes in the four quarters of a grid: every monomial but one may be left out or not."""
    side = np.linspace(-1.0, 1.0, 10)
    points = np.array([(x, y) for x in side for y in side])
    labels = (points.prod(axis=1) > 0).astype(int)
    print(*PolynomialSurfaceClassifier(degree=2).fit(points, labels).equations(), sep="\n")


def effects():
    """A load that never changes, and a signal that is logged twice: candidates that are equal."""
    loads = [Bias(), CoulombFriction(), LoadFriction(), Polynomial(), SensorOffset()]
    for kind, library in (("coulomb_friction", loads), ("input_coupling", [InputCoupling()])):
        data = make_undeclared(kind, system="pendulum", random_state=3)
        signals = np.full((len(data.X), 1), 2.5)
        if data.signals is not None:
            signals = np.column_stack([data.signals, 3.0 * data.signals, data.signals])
        search = EffectSearchCV(data.estimator, effects=library, max_effects=2)
        search.fit(data.X, data.Xdot, t=data.t, groups=data.groups, signals=signals)
        print(search.report_)


def recordings():
    """A thermostat, and a plant with a surface, as sampled with noise."""
    plant = HybridAutomaton.stated(
        [{"T": "-0.1 (T - 30)"}, {"T": "-0.1 (T - 10)"}],
        [(0, 1, "T >= 22"), (1, 0, "T <= 18")],
        states=["T"],
    )
    t, noise = np.arange(0.0, 20.0, 0.1), np.random.default_rng(0)
    runs = [plant.simulate([start], t, mode=0).x for start in (15.0, 17.0)]
    noisy = [{"t": t, "x": x + 0.01 * noise.standard_normal(x.shape)} for x in runs]
    automaton = HybridAutomatonRegressor(random_state=0).fit(noisy)
    print(*automaton.equations(), automaton.report_, sep="\n")
    found = TrajectoryIdentifier(SwitchingSystemRegressor(1, feature_library=1)).fit(noisy[:1])
    print(*found.estimator_.equations(), np.round(found.noise_, 6))


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    for part in (rows, surfaces, effects, recordings):
        print(f"-- {part.__name__}")
        part()
