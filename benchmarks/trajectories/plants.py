"""Plants of which states are recorded: laws and guards by their terms, and how they are excited.

A term is a product of columns, written ``x*v``, or ``1``. With one guard, mode 0 is where it is
negative and mode 1 where it is positive; a mode book gives the signs where there are several.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sklearn.preprocessing import PolynomialFeatures

from swsysid.refinement import StatedModel, StatedSurface

__all__ = ["PLANTS", "Plant"]

Array = NDArray[np.float64]
Terms = Mapping[str, float]


@dataclass(frozen=True)
class Plant:
    """A switching system and the experiment in which it is recorded.

    Attributes
    ----------
    laws : sequence, for each mode, of the terms of each state's velocity
    guards : sequence of terms
    degree, guard_degree : int
        Of the polynomials that the identification is told to use.
    period : float
        Time in s to which the number of samples in a period refers.
    duration : float
        Of one recording, in periods.
    order : {1, 2}
        2: only the first half of the states, positions, is measured.
    start : callable
        Initial state from a random generator.
    inputs : callable or None
        Inputs (n_times, n_inputs) from a generator and times; linear between samples.
    """

    name: str
    states: Sequence[str]
    laws: Sequence[Sequence[Terms]]
    guards: Sequence[Terms]
    period: float
    duration: float
    start: Callable[[np.random.Generator], Array]
    degree: int = 1
    guard_degree: int = 1
    input_names: Sequence[str] = ()
    inputs: Callable[[np.random.Generator, Array], Array] | None = None
    mode_book: Sequence[Sequence[int]] | None = None
    order: int = 1

    @property
    def n_measured(self) -> int:
        """Number of states that are measured."""
        return len(self.states) // self.order

    @property
    def n_modes(self) -> int:
        """Number of modes."""
        return len(self.laws)

    def truth(self) -> StatedModel:
        """The plant as a model with every coefficient free, the start of the oracle."""
        columns = [*self.states, *self.input_names]
        laws = [[_coefficients(law, columns, self.degree) for law in mode] for mode in self.laws]
        surface = None
        if self.guards:
            guards = [_coefficients(guard, columns, self.guard_degree) for guard in self.guards]
            surface = StatedSurface(guards, self.guard_degree, self.mode_book)
        return StatedModel(
            self.degree,
            laws,
            states=self.states,
            inputs=self.input_names,
            surface=surface,
            free=np.ones(np.shape(laws), dtype=bool),
        )


def _coefficients(terms: Terms, columns: Sequence[str], degree: int) -> Array:
    """Coefficients of scikit-learn's monomials."""
    powers = PolynomialFeatures(degree).fit(np.zeros((1, len(columns)))).powers_.tolist()
    coefficients = np.zeros(len(powers))
    for term, value in terms.items():
        factors = [] if term == "1" else term.split("*")
        coefficients[powers.index([factors.count(name) for name in columns])] = value
    return coefficients


# -- excitation ------------------------------------------------------------------------------


def _box(*half_widths: float, centre: float = 0.0):
    """Starts drawn uniformly from a box."""
    widths = np.array(half_widths)
    return lambda rng: centre + rng.uniform(-widths, widths)


def _waves(amplitude: float, *frequencies: float, offset: float = 0.0):
    """A sum of sines of random phases; frequencies in Hz."""

    def inputs(rng: np.random.Generator, t: Array) -> Array:
        phases = rng.uniform(0.0, 2.0 * np.pi, len(frequencies))
        angles = 2.0 * np.pi * np.outer(t, frequencies) + phases
        return offset + amplitude * np.sin(angles).sum(axis=1, keepdims=True)

    return inputs


def _side_by_side(*columns: Callable[[np.random.Generator, Array], Array]):
    """Several inputs."""
    return lambda rng, t: np.hstack([column(rng, t) for column in columns])


# -- plants ----------------------------------------------------------------------------------

_SPRING = {"x": -1.0, "v": -0.1}
_CUBIC = {"x": -1.0, "x*x*x": -0.3, "y*y*y": -0.1}
_PLANTS = (
    Plant(  # the paper's linear example
        "linear oscillator",
        states=("x", "v"),
        laws=[[{"v": 1.0}, {"x": -1.0, "v": -damping}] for damping in (0.1, 0.5)],
        guards=[{"x": -1.0}],
        period=2.0 * np.pi,
        duration=2,
        start=_box(5.0, 5.0),
    ),
    Plant(  # the paper's polynomial example
        "quartic oscillator",
        states=("x", "y"),
        laws=[
            [{"y": 1.0}, {**_CUBIC, "1": -0.1, "x*x": 0.2, "x*y": 0.3}],
            [{"y": 1.0}, {**_CUBIC, "y": -0.1, "x*x": 0.1, "x*y": 0.1}],
        ],
        guards=[{"1": -3.0, "x*x": 0.5, "y*y": 0.5, "x*x*x*x": 0.075}],
        period=4.0,
        duration=2,
        start=_box(4.5, 4.5),
        degree=3,
        guard_degree=4,
    ),
    Plant(
        "dry friction, forced",
        states=("x", "v"),
        laws=[[{"v": 1.0}, {**_SPRING, "u": 1.0, "1": friction}] for friction in (0.4, -0.4)],
        guards=[{"v": 1.0}],
        period=2.0 * np.pi,
        duration=3,
        start=_box(2.0, 2.0),
        input_names=("u",),
        inputs=_waves(1.5, 0.21, 0.13),
    ),
    Plant(  # a mass that falls on a spring
        "contact",
        states=("x", "v"),
        laws=[
            [{"v": 1.0}, {"1": -1.0, "v": -0.1}],
            [{"v": 1.0}, {"1": -1.0, "x": -40.0, "v": -1.0}],
        ],
        guards=[{"x": -1.0}],
        period=2.5,
        duration=4,
        start=_box(0.5, 0.5, centre=1.0),
    ),
    Plant(
        "tank with overflow",
        states=("h1", "h2"),
        laws=[
            [{"u": 1.0, "h1": -0.5}, {"h1": 0.5, "h2": -0.4}],
            [{"u": 1.0, "h1": -2.5, "1": 2.0}, {"h1": 0.5, "h2": -0.4}],
        ],
        guards=[{"h1": 1.0, "1": -1.0}],
        period=6.0,
        duration=4,
        start=_box(0.5, 0.5, centre=0.8),
        input_names=("u",),
        inputs=_waves(0.25, 1.0 / 6.0, 1.0 / 9.0, offset=0.55),
    ),
    Plant(  # a gap of a half on both sides, then a spring
        "backlash, three modes",
        states=("x", "v"),
        laws=[
            [{"v": 1.0}, {"v": -0.2, "u": 1.0}],
            [{"v": 1.0}, {"x": -8.0, "v": -0.6, "u": 1.0, "1": 4.0}],
            [{"v": 1.0}, {"x": -8.0, "v": -0.6, "u": 1.0, "1": -4.0}],
        ],
        guards=[{"x": 1.0, "1": -0.5}, {"x": -1.0, "1": -0.5}],
        mode_book=[[-1, -1], [1, -1], [-1, 1]],
        period=3.0,
        duration=4,
        start=_box(1.0, 1.0),
        input_names=("u",),
        inputs=_waves(0.8, 0.3, 0.47),
    ),
    Plant(  # a converter that its input switches
        "switched by the input",
        states=("i", "v"),
        laws=[
            [{"i": -0.2, "v": -1.0, "1": source}, {"i": 1.0, "v": -0.5}] for source in (1.5, -0.5)
        ],
        guards=[{"d": 1.0}],
        period=6.0,
        duration=3,
        start=_box(1.0, 1.0),
        input_names=("d",),
        inputs=_waves(1.0, 0.23, 0.11),
    ),
    Plant(
        "two masses, four states",
        states=("p", "v", "q", "w"),
        laws=[
            [{"v": 1.0}, {**stop, "q": 0.5}, {"w": 1.0}, {"q": -1.0, "w": -0.1, "p": 0.5}]
            for stop in ({"p": -2.0, "v": -0.1}, {"p": -8.0, "v": -0.6})
        ],
        guards=[{"p": 1.0}],
        period=5.0,
        duration=3,
        start=_box(2.0, 2.0, 2.0, 2.0),
    ),
    Plant(  # predators that live on something else where prey is rare
        "predator and prey",
        states=("x", "y"),
        laws=[
            [{"x": 1.0, "x*y": -1.0}, {"y": -1.0, "x*y": 1.0}],
            [{"x": 1.0, "x*y": -1.0}, {"y": -0.3, "x*y": 0.3}],
        ],
        guards=[{"x": -1.0, "1": 0.9}],
        period=6.0,
        duration=3,
        start=_box(0.8, 0.8, centre=1.2),
        degree=2,
    ),
    Plant(  # each node is driven: neighbours that follow each other say nothing of who drives whom
        "network of three nodes",
        states=("a", "b", "c"),
        laws=[
            [{"a": -1.1, "b": 1.0, "u": 1.0}, {"b": -1.1, "c": 1.0, "v": 1.0},
             {"c": -1.1, "a": 1.0, "w": 1.0}],
            [{"a": -2.1, "b": 1.0, "c": 1.0, "u": 1.0}, {"b": -2.1, "a": 1.0, "c": 1.0, "v": 1.0},
             {"c": -2.1, "a": 1.0, "b": 1.0, "w": 1.0}],
        ],
        guards=[{"1": 1.2, "a*a": -1.0, "b*b": -1.0, "c*c": -1.0}],
        period=3.0,
        duration=4,
        start=_box(2.0, 2.0, 2.0),
        guard_degree=2,
        input_names=("u", "v", "w"),
        inputs=_side_by_side(
            _waves(2.0, 0.21, 0.47), _waves(2.0, 0.33, 0.61), _waves(2.0, 0.17, 0.53)
        ),
    ),
    Plant(  # an encoder on a mass that meets a bumper
        "positions only",
        states=("x", "v"),
        laws=[[{"v": 1.0}, _SPRING], [{"v": 1.0}, {"x": -9.0, "v": -0.5, "1": -4.0}]],
        guards=[{"x": -1.0, "1": -0.5}],
        period=2.0 * np.pi,
        duration=3,
        start=_box(2.0, 2.0),
        order=2,
    ),
    Plant(
        "one mode, cubic spring",
        states=("x", "v"),
        laws=[[{"v": 1.0}, {**_SPRING, "x*x*x": -0.3}]],
        guards=[],
        period=5.0,
        duration=3,
        start=_box(3.0, 3.0),
        degree=3,
    ),
    Plant(
        "one mode, linear",
        states=("x", "v"),
        laws=[[{"v": 1.0}, {"x": -1.0, "v": -0.2}]],
        guards=[],
        period=2.0 * np.pi,
        duration=3,
        start=_box(3.0, 3.0),
    ),
)  # fmt: skip
PLANTS = {plant.name: plant for plant in _PLANTS}
