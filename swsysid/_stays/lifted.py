r"""Lifted shooting with given stays: laws, states and switch instants of highest likelihood.

Every sample has a node, a state :math:`x_k` of its own. With the modes of the stays given, their
instants :math:`\tau` are numbers like any others, and with the flow :math:`\varphi` of an interval

.. math:: \tfrac12 \sum_k \Big\| \frac{y_k - x_k}{\sigma} \Big\|^2
          + \tfrac12 \sum_k \Big\| \frac{x_{k+1} - \varphi_k(x_k, \tau; C)}
                                        {\delta \sigma \sqrt{h_k}} \Big\|^2

is a smooth function of all of them, with durations h in usual intervals: no surface is asked, no
event is looked for, and nothing steps through time. With :math:`\delta` falling the nodes of a
recording become one rollout; until then they are a trajectory that is disturbed a little.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil
from typing import Self

import numpy as np

from swsysid._results import Array
from swsysid._stays.equations import NodeEquations
from swsysid._stays.flow import Legs, crossings_of, ends_of, steady_legs, switching
from swsysid._stays.guards import Crossings, Guards, Misses
from swsysid._stays.laws import Laws
from swsysid._stays.nodes import Nodes, Rows
from swsysid._stays.resets import Resets
from swsysid._stays.settings import LIMITS
from swsysid._stays.sliding import SlidingLaws, with_slides

# Intervals that an instant may move at once, and by which a crossing may miss its surface and is on
# it.
_FARTHEST_MOVE, _ON_SURFACE = 2.0, 0.25
# Ties, in units of the noise, from which pairs are eliminated: at 1e-5 rounding takes 1.5e-6 of
# what a step promises, one interval after the other half of that. At 5.5e-5, with which automata
# end, steps differ by 1.6e-7 of the largest move.
_TIGHTLY = 5e-5


@dataclass(frozen=True)
class Estimate:
    """Laws, nodes with their instants, the states of the nodes, and surfaces and resets if any."""

    laws: Laws
    nodes: Nodes
    states: Array  # (n_nodes, n_states)
    guards: Guards | None = None
    resets: Resets | None = None

    @property
    def motion(self) -> Laws:
        """The laws, those of slides included if there is one."""
        if self.guards is None or not self.slides:
            return self.laws
        return SlidingLaws.of(self.laws, self.guards)

    @property
    def slides(self) -> bool:
        """True if a recording slides along a surface."""
        return any((stays.modes >= len(self.laws.coef)).any() for stays in self.nodes.stays)

    @property
    def beyond(self) -> int:
        """Number of samples whose mode must have been left: none, since surfaces have sides."""
        return 0

    def renamed(self, order: Rows) -> Estimate:
        """The same with mode ``order[k]`` called k."""
        names = with_slides(np.argsort(order))
        nodes = self.nodes.with_stays(
            [replace(one, modes=names[one.modes]) for one in self.nodes.stays]
        )
        guards = self.guards
        if guards is not None:
            guards = replace(guards, mode_book=guards.mode_book[order])
        return replace(self, laws=self.laws.taken(order), nodes=nodes, guards=guards)

    def only(self, modes: Rows) -> Estimate:
        """The same with some of the modes."""
        nodes = self.nodes.with_stays([stays.only(modes) for stays in self.nodes.stays])
        return Estimate(self.laws.taken(modes), nodes, self.states)

    @property
    def crossings(self) -> Crossings:
        """Where recordings switch."""
        return crossings_of(self.motion, self.nodes, self.states)

    def pivoted(self) -> Self:
        """The same, the scale of its surfaces held by what is crossed most surely."""
        if self.guards is None:
            return self
        return replace(self, guards=self.guards.pivoted(self.crossings))

    def snapped(self) -> Estimate:
        """The same with instants at which the states are on the surfaces."""
        if self.guards is None:
            return self
        misses = self.guards.misses(self.crossings)
        instants = self.nodes.instants.copy()
        interval = self.nodes.recordings.interval
        if (np.abs(misses.times) < _ON_SURFACE * interval).all():
            return self
        farthest = _FARTHEST_MOVE * interval
        move = -misses.times * np.sign(misses.by_instants)
        instants[misses.switches] += np.clip(move, -farthest, farthest)
        return replace(self, nodes=self.nodes.moved(instants))

    def ends(self, rows: Rows | None = None) -> Array:
        """Where intervals lead, all by default, (n_intervals, n_states)."""
        return ends_of(self.motion, self.nodes, self.states, rows, self.resets)

    def moved(self, step: Array) -> Self:
        """Another estimate: laws, states, instants, surfaces and resets, in this order."""
        n_free, size, n_instants = self.laws.n_free, self.states.size, len(self.nodes.instants)
        n_steps = len(self.nodes.stepping)
        n_guards = 0 if self.guards is None else self.guards.n_free
        of_laws, of_states, of_instants, of_steps, of_guards, of_resets = np.split(
            step, np.cumsum([n_free, size, n_instants, n_steps, n_guards])
        )
        farthest = _FARTHEST_MOVE * self.nodes.recordings.interval
        nodes, later = self.nodes.stepped(of_steps)
        nodes = nodes.moved(nodes.instants + np.clip(of_instants, -farthest, farthest))
        moved = replace(
            self,
            laws=self.laws.moved(of_laws),
            nodes=nodes,
            states=self.states + of_states.reshape(self.states.shape) + self._going_on(later),
            guards=None if self.guards is None else self.guards.moved(of_guards),
            resets=None if self.resets is None else self.resets.moved(of_resets),
        )
        return moved.flown_to(np.flatnonzero(nodes.names != self.nodes.names))

    def _going_on(self, later: Array) -> Array:
        """What the states of nodes change by that are later, where an input steps later."""
        change, rows = np.zeros_like(self.states), np.flatnonzero(later)
        if rows.size:
            before = self.nodes.before_steps(rows)
            u, modes = self.nodes.u[before], self.nodes.modes[before]
            own = self.motion.velocities(modes, self.states[rows], u, np.zeros_like(u))
            change[rows] = own * later[rows, None]
        return change

    def flown_to(self, rows: Rows) -> Self:
        """The same with some nodes where the flow from the node before leads.

        A step takes an instant that passes a node on by the flow that it had before, and that node
        with it: behind the instant the other law leads there, and to all nodes beyond as before.
        """
        rows = rows[np.isin(rows - 1, self.nodes.begins)]
        if not rows.size:
            return self
        flown, depth = replace(self, states=self.states.copy()), rows - np.arange(len(rows))
        run = np.arange(len(rows)) - np.searchsorted(depth, depth)  # place among neighbours
        farthest = ceil(_FARTHEST_MOVE * self.nodes.recordings.per_sample)
        for place in range(min(int(run.max()) + 1, farthest)):
            own = rows[run == place]
            flown.states[own] = flown.ends(np.searchsorted(self.nodes.begins, own - 1))
        return flown


def recombined(chosen: Sequence[Estimate]) -> Estimate:
    """Each recording, k, as in the k-th of these estimates of the same recordings."""
    first = chosen[0]
    times = [one.nodes.recordings.step_times for one in chosen]
    own = [of_all[k] for k, of_all in enumerate(times) if of_all]
    recordings = first.nodes.recordings.with_step_times(own)
    nodes = Nodes(recordings, [one.nodes.stays[k] for k, one in enumerate(chosen)])
    states = np.stack([one.states for one in chosen])
    return Estimate(first.laws, nodes, states[nodes.recording, np.arange(len(nodes))])


@dataclass(frozen=True)
class Objective:
    """The sum of squares above; `noise` are standard deviations (n_states,), `tie` is delta."""

    noise: Array
    tie: float
    guard_time: float = 1.0  # by which a crossing may miss its surface
    most_beyond: int = 0  # samples whose mode must have been left: with more, modes are others

    def with_noise(self, noise: Array) -> Objective:
        """The same for other noise."""
        return replace(self, noise=noise)

    def n_states_told(self, nodes: Nodes) -> float:
        r"""Numbers that the states of the nodes are worth.

        One start a recording, and what loose ties leave free: :math:`\delta / \sqrt{4 + \delta^2}`
        a sample, the trace of the smoother of a random walk.
        """
        loose = self._looseness(nodes)
        of_nodes = (loose / np.sqrt(4.0 + loose**2)).sum()
        of_nodes *= len(nodes) / nodes.recordings.per_sample
        return float(len(self.noise) * len(nodes.recordings) + of_nodes)

    def allows(self, estimate: Estimate) -> bool:
        """True of an estimate that a step may lead to."""
        return estimate.beyond <= self.most_beyond

    def value(self, estimate: Estimate) -> float:
        """Half the sum of squares; infinite where the estimate is not allowed."""
        return float(self.by_recording(estimate).sum()) if self.allows(estimate) else np.inf

    def by_recording(self, estimate: Estimate) -> Array:
        """What each recording adds to the value, (n_recordings,)."""
        nodes, guards = estimate.nodes, estimate.guards
        misfit, _ = self._misfit(estimate)
        of_nodes = 0.5 * np.square(misfit).sum(axis=1)
        of_nodes[nodes.begins] += 0.5 * np.square(self.gaps(estimate)).sum(axis=1)
        if guards is not None:
            misses = guards.misses(estimate.crossings)
            far = _far(misses.times / self._sizes(misses, nodes))
            np.add.at(of_nodes, nodes.begins[nodes.at[misses.switches]], far)
        values = nodes.by_recording(of_nodes)
        if guards is not None and guards.sides is not None:
            wrong = 0.5 * np.square(guards.wrong_sides()).sum(axis=0)
            np.add.at(values, nodes.recordings.groups, wrong)
        return values

    def gaps(self, estimate: Estimate) -> Array:
        """From where flows lead to the next nodes, in units of ties, (n_intervals, n_states)."""
        gaps = (estimate.states[estimate.nodes.begins + 1] - estimate.ends()) / self.noise
        return np.asarray(gaps * self._weights(estimate.nodes).T)

    def normal_equations(self, estimate: Estimate) -> NodeEquations:
        """Gauss and Newton's equations."""
        nodes, states, guards, resets = (
            estimate.nodes.joined(self.tie >= _TIGHTLY), estimate.states, estimate.guards,
            estimate.resets,
        )  # fmt: skip
        n_laws, n_guards = estimate.laws.n_free, 0 if guards is None else guards.n_free
        switches = None
        rows = nodes.intervals_of_instants
        if len(rows):
            switches = switching(estimate.motion, nodes, states, resets, n_laws + n_guards)
        crossings = None if switches is None or guards is None else switches.crossings()
        misses = None if crossings is None or guards is None else guards.misses(crossings)
        equations = NodeEquations(
            (len(nodes), states.shape[1]),
            n_laws=n_laws,
            n_guards=n_guards,
            n_resets=0 if resets is None else resets.n_free,
            unit=self.noise,
            at=nodes.begins[rows],
            kept=nodes.kept,
            since=np.zeros(0, dtype=np.intp) if misses is None else misses.since,
            # half a nat for an interval: where the velocity is the same on both sides the data do
            # not say when a recording switches
            hold=nodes.recordings.interval**-2.0,
            steps=estimate.laws.steps,
        )
        equations.add_samples(*self._misfit(estimate))
        weights = self._weights(nodes)
        for legs in steady_legs(estimate.motion, nodes, states):
            self._add_ties(equations, estimate, legs, weights)
        if switches is not None:
            gaps = self._add_ties(equations, estimate, switches.legs, weights)
            own = weights[:, switches.legs.rows]
            equations.add_instants(switches.legs, switches.by_instant, gaps, own)
            known = np.append(nodes.in_steps, np.zeros(len(nodes.stepping), dtype=bool))
            ends = np.append(np.zeros(len(nodes.at), dtype=np.intp), nodes.ends_of_steps)
            equations.hold_instants(known, ends)
            if guards is not None and misses is not None and crossings is not None:
                self._add_guards(equations, nodes, guards, misses, crossings)
                equations.keep_instants()
        return equations

    def _add_ties(
        self, equations: NodeEquations, estimate: Estimate, legs: Legs, weights: Array
    ) -> Array:
        """Add the gaps at the ends of some intervals, which are returned."""
        first = estimate.nodes.begins[legs.rows]
        gaps = (estimate.states[first + 1] - legs.ends) / self.noise
        equations.add_ties(legs, first, gaps, weights[:, legs.rows])
        return gaps

    def _add_guards(
        self,
        equations: NodeEquations,
        nodes: Nodes,
        guards: Guards,
        misses: Misses,
        crossings: Crossings,
    ) -> None:
        """Add what crossings say that miss their surface; a far one counts less."""
        assert crossings.varied is not None
        n_states, n_laws, n_guards = len(self.noise), equations.n_laws, equations.n_guards
        sizes = self._sizes(misses, nodes)
        times = misses.times / sizes
        root = (1.0 + np.square(times / LIMITS.far_miss)) ** -0.25
        weight = root / sizes
        varied = np.einsum(
            "kc,kcz->kz", misses.by_columns[:, :n_states], crossings.varied[misses.switches]
        )
        shared = np.zeros((len(times), len(equations.corner)))
        shared[:, : varied.shape[1] - n_states] = varied[:, n_states:]
        shared[:, n_laws : n_laws + n_guards] += misses.by_coef
        shared[:, equations.n_shared :] = misses.by_since
        equations.add_misses(
            misses.switches,
            root * times,
            weight[:, None] * varied[:, :n_states],
            weight[:, None] * shared,
            weight * misses.by_instants,
        )
        equations.value += float(_far(times).sum())
        matrix, right, of_sides = guards.side_equations()
        equations.add_sides(matrix, right)
        equations.value += of_sides

    def _sizes(self, misses: Misses, nodes: Nodes) -> Array:
        """Standard deviations of misses: a step passes its surface anywhere."""
        return np.where(misses.steps, nodes.recordings.interval / np.sqrt(12.0), self.guard_time)

    def _misfit(self, estimate: Estimate) -> tuple[Array, Array]:
        """Misfits in units of the noise, zero where nothing was measured, and their slopes."""
        nodes = estimate.nodes
        left = (nodes.y - estimate.states) / (self.noise * nodes.sizes)
        seen = np.isfinite(nodes.y)
        return np.where(seen, left, 0.0), np.where(seen, 1.0 / nodes.sizes, 0.0)

    def _weights(self, nodes: Nodes) -> Array:
        """Of the ties, (n_states, n_intervals)."""
        return np.asarray(1.0 / np.outer(self._looseness(nodes), np.sqrt(nodes.parts)))

    def _looseness(self, nodes: Nodes) -> Array:
        """Of nodes an interval apart, in units of the noise, (n_states,): ties and random walk."""
        walk = nodes.recordings.walk
        return np.hypot(self.tie, np.zeros(len(self.noise)) if walk is None else walk / self.noise)


def _far(times: Array) -> Array:
    """Half the squares of misses; of large ones, less."""
    return np.asarray(
        LIMITS.far_miss**2 * (np.sqrt(1.0 + np.square(times / LIMITS.far_miss)) - 1.0), dtype=float
    )
