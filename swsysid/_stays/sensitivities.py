r"""How whole rollouts change with what is unknown of laws and surfaces, and with their starts.

The flow of every interval is varied as in an estimate with a node at every time (`flow`), all of
them at once, and chained along each recording. An instant :math:`\tau` follows the state and the
surface f = 0,

.. math:: \mathrm d\tau = - \frac{\nabla f \cdot \mathrm d x + \mathrm d f}{\dot f},

which makes the flow over it that of the saltation matrix.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from swsysid._results import Array
from swsysid._stays.flow import Switching, steady_legs, switching
from swsysid._stays.guards import Guards
from swsysid._stays.laws import Laws
from swsysid._stays.nodes import Nodes, Rows
from swsysid._stays.recordings import Recordings
from swsysid._stays.rollouts import Event, Rolled, along
from swsysid._stays.sliding import SlidingLaws


class RolledNodes(Nodes):
    """The nodes of rollouts; an interval may begin in another mode than the one before ends in."""

    def __init__(self, recordings: Recordings, runs: Sequence[Rolled]):
        self.runs = runs
        super().__init__(recordings, [])
        self.states = np.concatenate([run.states for run in runs])

    def place_switches(self) -> None:
        """Modes before and after the switch of each interval, and where it is."""
        switches: list[tuple[int, Event]] = [
            (first + event.step, event)
            for first, run in zip(self.first.tolist(), self.runs, strict=True)
            for event in run.events
            if event.kind != "leaving"  # at the end of a step
        ]
        self.modes = np.concatenate([run.modes for run in self.runs])
        self.instants = np.array([event.time for _, event in switches])
        self.old = self.modes[self.begins]
        self.new = self.old.copy()
        at = np.array([node for node, _ in switches], dtype=np.intp)
        self.place_at(np.searchsorted(self.begins, at))
        self.new[self.at] = [event.entered for _, event in switches]
        self.stepping = np.zeros(0, dtype=np.intp)
        self.segments, self.kept = self.segments_of((1,))

    @property
    def told_by(self) -> Rows:
        """No transition tells a switch."""
        return np.full(len(self.at), -1)

    @property
    def entered(self) -> Array:
        """Nobody asks when a mode was entered."""
        return np.full(len(self.at), np.nan)


def sensitivities(laws: Laws, guards: Guards, nodes: RolledNodes) -> Array:
    """Derivatives of all nodes, (n_nodes, n_states, n_states + n_unknowns).

    By the state at which each rollout starts, by the unknowns of the laws, then of the surfaces.
    """
    n_states, n_modes = nodes.states.shape[1], len(laws.coef)
    n_shared = laws.n_free + guards.n_free
    slides = (nodes.old >= n_modes).any() or (nodes.new >= n_modes).any()
    motion = SlidingLaws.of(laws, guards) if slides else laws
    by_state = np.zeros((len(nodes.begins), n_states, n_states))
    by_shared = np.zeros((len(nodes.begins), n_states, n_shared))
    for legs in steady_legs(motion, nodes, nodes.states):
        by_state[legs.rows] = legs.by_state.transpose(2, 1, 0)
        by_shared[legs.rows[:, None], :, legs.columns] = legs.by_law.transpose(2, 0, 1)
    if len(nodes.at):
        found = switching(motion, nodes, nodes.states)
        moves = _of_instants(guards, found, laws.n_free, n_shared)
        whole = np.zeros((len(nodes.at), n_states, n_states + n_shared))
        whole[:, :, :n_states] = found.legs.by_state.transpose(2, 1, 0)
        whole[:, :, n_states + found.legs.columns] = found.legs.by_law.transpose(2, 1, 0)
        whole += found.by_instant[:, :, None] * moves[:, None, :]
        by_state[nodes.at], by_shared[nodes.at] = np.split(whole, [n_states], axis=2)
    return _chained(nodes, by_state, by_shared)


def _of_instants(guards: Guards, found: Switching, n_laws: int, n_shared: int) -> Array:
    """Derivatives of the instants, by the nodes before them and what is shared."""
    crossings = found.crossings()
    assert crossings.varied is not None
    misses = guards.misses(crossings)
    n_states, varied = crossings.varied.shape[1], crossings.varied[misses.switches]
    off = np.zeros((len(misses.times), n_states + n_shared))
    off[:, : varied.shape[2]] = np.einsum("kc,kcz->kz", misses.by_columns[:, :n_states], varied)
    off[:, n_states + n_laws :] += misses.by_coef
    moves = np.zeros((len(crossings.old), n_states + n_shared))
    with np.errstate(all="ignore"):
        moves[misses.switches] = np.nan_to_num(
            -off / misses.by_instants[:, None], posinf=0, neginf=0
        )
    return moves


def _chained(nodes: Nodes, by_state: Array, by_shared: Array) -> Array:
    """From the derivatives of each interval those along the recordings."""
    n_states, ends = by_state.shape[1], nodes.begins + 1
    slopes = np.zeros((len(nodes), n_states, n_states))
    right = np.zeros((len(nodes), n_states, n_states + by_shared.shape[2]))
    slopes[ends], right[ends, :, n_states:] = by_state, by_shared
    right[nodes.first, :, :n_states] = np.eye(n_states)
    return along(slopes, right)
