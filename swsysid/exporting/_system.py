"""The one description of an identified system that every writer reads, a hybrid automaton.

Laws are formulas of states, inputs and time. Which law acts is told by `surfaces` (the state alone
tells it) or by `edges` (guards that rise to zero, so that modes have memory).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from swsysid._data.coordinates import Extent
from swsysid._results import Array
from swsysid.exporting._expressions import (
    ONE,
    Expression,
    NoFormulaError,
    evaluated,
    least,
    number,
)
from swsysid.exporting._features import columns_of

_PROBES, _ROUNDING = 16, 1e-9  # states at which formulas are compared with the model
_NEAR = 0.5  # spreads of the data from their centre at which these states lie


@dataclass(frozen=True)
class Edge:
    """A way out of a mode, taken where its guard rises to zero; of several the first.

    Attributes
    ----------
    source, target : int
        Numbers of the modes before and after.
    guard : Expression
    reset : tuple of Expression or None
        The state after it, from that before; None where the state goes on.
    """

    source: int
    target: int
    guard: Expression
    reset: tuple[Expression, ...] | None = None


@dataclass(frozen=True)
class Surfaces:
    """Functions whose signs tell the mode.

    Attributes
    ----------
    functions : tuple of Expression
        Values f of each surface, in units in which surfaces can be compared.
    book : tuple of tuple of int
        Sign of each surface in each mode, 0 where it does not matter.
    """

    functions: tuple[Expression, ...]
    book: tuple[tuple[int, ...], ...]

    @cached_property
    def decisions(self) -> tuple[Expression, ...]:
        """Of each mode the least of its signed surfaces: the largest is that of the active mode."""
        return tuple(
            least(
                *(number(sign) * f for sign, f in zip(signs, self.functions, strict=True) if sign)
            )
            for signs in self.book
        )

    def between(self, source: int, target: int) -> Expression:
        """What passes zero, upwards, where one mode is left for another."""
        if len(self.book) == 2 and len(self.functions) == 1:
            return self.decisions[target]
        return self.decisions[target] - self.decisions[source]

    def enters(self, target: int) -> Expression:
        """What is not negative where a mode is the active one."""
        others = [mode for mode in range(len(self.book)) if mode != target]
        return least(*(self.between(other, target) for other in others))


@dataclass(frozen=True)
class HybridSystem:
    """An identified system as formulas, for other tools.

    Every model of this package gives one (`to_hybrid_system`).

    Attributes
    ----------
    states, inputs : tuple of str
        Names.
    laws : tuple of tuple of Expression
        For each mode the rate of each state, in discrete time its next value.
    surfaces : Surfaces or None
        What tells the mode where the state does.
    edges : tuple of Edge
        What tells the mode where it has memory.
    discrete_time : bool
    labels : tuple of int
        The mode of the model that each mode is a part of: slides are modes of their own in
        `with_slides`.
    titles : tuple of str
        What each mode is, in words.
    starts : tuple of (int, Expression)
        Modes in which a rollout may start, each where its formula is not negative; the first is
        taken.
    origin : tuple of float
        A state to start from.
    sizes : tuple of float
        How large the states are.
    notes : tuple of str
        Laws and standard errors in words, for comments.

    Examples
    --------
    >>> from swsysid import HybridAutomaton
    >>> ball = HybridAutomaton.stated(
    ...     [{"h": "v", "v": "-9.81"}], [(0, 0, "h <= 0", {"v": "-0.8 v"})], states=["h", "v"]
    ... )
    >>> system = ball.to_hybrid_system()
    >>> system.states, len(system.laws), len(system.edges)
    (('h', 'v'), 1, 1)
    """

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    laws: tuple[tuple[Expression, ...], ...]
    surfaces: Surfaces | None = None
    edges: tuple[Edge, ...] = ()
    discrete_time: bool = False
    labels: tuple[int, ...] = ()
    titles: tuple[str, ...] = ()
    starts: tuple[tuple[int, Expression], ...] = ()
    origin: tuple[float, ...] = ()
    sizes: tuple[float, ...] = ()
    notes: tuple[str, ...] = ()

    def __post_init__(self):
        modes = range(len(self.laws))
        vars(self).update(
            labels=self.labels or tuple(modes),
            starts=self.starts or tuple((mode, ONE) for mode in modes),
            titles=self.titles or tuple(f"mode {mode}" for mode in modes),
            origin=self.origin or (0.0,) * len(self.states),
            sizes=self.sizes or (1.0,) * len(self.states),
        )

    @property
    def columns(self) -> list[Expression]:
        """Leaves for the states, then for the inputs."""
        return columns_of(len(self.states), len(self.inputs))

    def exits(self, mode: int) -> list[tuple[int, Edge]]:
        """The edges out of a mode, with their numbers."""
        return [(place, one) for place, one in enumerate(self.edges) if one.source == mode]

    def noted(self, report: object) -> HybridSystem:
        """With a report in words, standard errors and all, for comments."""
        return replace(self, notes=tuple(str(report).splitlines()))

    def known_by(self, extent: Extent | None) -> HybridSystem:
        """With the middle and the spread of the data as a start and as sizes of the states."""
        if extent is None:
            return self
        known = extent.first(len(self.states))
        sizes = tuple(np.where(known.spread > 0.0, known.spread, 1.0).tolist())
        return replace(self, origin=tuple(known.centre.tolist()), sizes=sizes)

    def checked(
        self,
        velocity: Callable[[Array, Array, int], Array],
        mode_at: Callable[[Array, Array], int] | None = None,
    ) -> HybridSystem:
        """Itself, where laws and modes are the model's at states near its data; else refused."""
        rng = np.random.default_rng(0)
        for _ in range(_PROBES):
            x = np.array(self.origin) + _NEAR * np.array(self.sizes) * rng.standard_normal(
                len(self.states)
            )
            u = _NEAR * rng.standard_normal(len(self.inputs))
            for mode, laws in enumerate(self.laws):
                own = np.array([evaluated(law, {"x": x, "u": u}) for law in laws])
                with np.errstate(all="ignore"):
                    wanted = np.asarray(velocity(x, u, mode), dtype=float)
                known = np.isfinite(own) & np.isfinite(wanted)
                size = np.abs(wanted[known]).max(initial=1e-300)
                if (np.abs(own - wanted)[known] > _ROUNDING * size).any():
                    raise _differing("a function of the laws")
            if self.surfaces is not None and mode_at is not None:
                values = [evaluated(one, {"x": x, "u": u}) for one in self.surfaces.decisions]
                if values[mode_at(x, u)] < max(values) - _ROUNDING * np.abs(values).max():
                    raise _differing("a function of the surface")
        return self


def _differing(what: str) -> NoFormulaError:
    return NoFormulaError(
        f"{what} is another one where it is given formulas instead of arrays, or learns from data; "
        "make it of arithmetic and functions of NumPy, element by element."
    )
