"""Result objects of the package: frozen records that can prove themselves, and `Status`.

Every solver, relaxation and simulation returns one of these. None of them is a bare array:
each carries the value it reached, a bound that certifies it where there is one, and a
`Status` whose ``advice`` says in one sentence what to do when something went wrong.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swsysid._rendering.series import draw_series, frame_of, names_or_numbers, span

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import DataFrame

Array = NDArray[np.float64]


class IdentificationWarning(UserWarning):
    """The data do not determine the answer (too few samples, a mode without data, ...)."""


class GuardWarning(IdentificationWarning):
    """The modes of the samples are not a function of the state: no surface tells them apart."""


class MisfitWarning(IdentificationWarning):
    """The model leaves far more than the noise (a wrong basin, a missing term, a wrong guard)."""


class SolverError(RuntimeError):
    """A solver is missing or failed; the message says what to do."""


class Status(Enum):
    """How a computation ended; `advice` says what to do about it."""

    OPTIMAL = "optimal"
    INACCURATE = "inaccurate"
    ITERATION_LIMIT = "iteration limit"
    TIME_LIMIT = "time limit"
    INFEASIBLE = "infeasible"
    UNBOUNDED = "unbounded"
    FAILED = "failed"
    COMPLETED = "completed"
    SWITCH_LIMIT = "switch limit"
    STATE_LIMIT = "state limit"
    STEP_FAILURE = "step failure"
    INPUT_RANGE = "input range"

    @property
    def ok(self) -> bool:
        """True if the result can be used without further thought."""
        return self in (Status.OPTIMAL, Status.COMPLETED)

    @property
    def advice(self) -> str:
        """One sentence that says what to do."""
        return _ADVICE[self]


_ADVICE = {
    Status.OPTIMAL: "Solved to the requested accuracy; nothing to do.",
    Status.INACCURATE: "The solver stopped near the optimum; check the gap, or rescale the data.",
    Status.ITERATION_LIMIT: "Increase max_iter, or loosen tol.",
    Status.TIME_LIMIT: "Increase time_limit; the bound and the gap say how far the answer can be.",
    Status.INFEASIBLE: "No point satisfies the constraints; increase coef_bound.",
    Status.UNBOUNDED: "The program has no finite optimum; set coef_bound.",
    Status.FAILED: "The solver failed; rescale the data to order one or choose another solver.",
    Status.COMPLETED: "The simulation reached the last requested time.",
    Status.SWITCH_LIMIT: "Too many switches (Zeno behaviour); increase max_switches or check the "
    "fields on both sides of the surface.",
    Status.STATE_LIMIT: "The state left the allowed box; the model is unstable here or x0 lies far "
    "from the training data.",
    Status.STEP_FAILURE: "The integrator could not proceed; the vector field is singular or stiff.",
    Status.INPUT_RANGE: "The requested times reach beyond the sampled inputs; shorten t.",
}


@dataclass(frozen=True)
class Assignment:
    """The mode assignment of every sample for given vector fields.

    Attributes
    ----------
    membership : ndarray of shape (n_samples, n_modes)
        Rows on the simplex; one-hot where the relaxation is tight.
    objective : float
        Sum over samples of the loss at the *hardened* membership (the row's largest entry).
    lower_bound : float
        Value of the relaxation: no hard assignment can have a smaller sum.
    tightness : ndarray of shape (n_samples,), bool
        True where the relaxation itself is one-hot (its moment matrix has rank one).
    status : Status
    """

    membership: Array
    objective: float
    lower_bound: float
    tightness: NDArray[np.bool_]
    status: Status

    @property
    def modes(self) -> NDArray[np.intp]:
        """Hardened labels, shape (n_samples,)."""
        return self.membership.argmax(axis=1)

    @property
    def gap(self) -> float:
        """`objective` - `lower_bound`, the most that hardening can have cost."""
        return self.objective - self.lower_bound


@dataclass(frozen=True)
class IterationRecord:
    """One iteration of the alternation.

    Attributes
    ----------
    iteration : int
    objective : float
        The joint objective J: loss over scale, plus coupling times the surface's objective.
    loss : float
        Sum of the losses at the hardened assignment, in the user's units.
    lower_bound : float
        Value of the relaxation of the assignment, in the user's units.
    mode_changes : int
        Number of samples whose label differs from the previous iteration's.
    tightness : float
        Fraction of samples at which the relaxation was one-hot.
    seconds : float
    modes : ndarray of shape (n_samples,), int8
        Hardened labels; -1 for samples of weight zero and for modes that were dropped later.
    """

    iteration: int
    objective: float
    loss: float
    lower_bound: float
    mode_changes: int
    tightness: float
    seconds: float
    modes: NDArray[np.int8]


@dataclass(frozen=True)
class SwitchEvent:
    """One event of a rollout: the mode changes at a time found by root finding.

    Attributes
    ----------
    time : float
    state : ndarray of shape (n_states,)
        Before a jump of an automaton.
    before, after : int
        Modes on the two sides.
    kind : str
        ``"crossing"``, ``"sliding"`` (both fields point at the surface), ``"leaving"`` (the end
        of a slide), ``"input"`` (a jump of the inputs changed the mode; no root was sought); in an
        automaton ``"transition"`` or ``"jump"`` (a transition that resets the state).
    """

    time: float
    state: Array
    before: int
    after: int
    kind: str


@dataclass(frozen=True)
class Trajectory:
    """A simulated trajectory.

    Attributes
    ----------
    t : ndarray of shape (n_times,)
        The requested times, cut at the last one reached.
    x : ndarray of shape (n_times, n_states)
    modes : ndarray of shape (n_times,), int
    events : tuple of SwitchEvent
    status : Status
    names : tuple of str
        Names of the states; x0, x1, ... if empty.
    lower, upper : ndarray of shape (n_times, n_states) or None
        Between these are, at each time, 95 % (``confidence`` of `simulate`) of the rollouts of
        ``n_draws`` models whose coefficients are drawn from the covariance of those that were
        found, with ``random_state``; infinite where too many have ended before. Noise and the
        error of the start are no part of it.
    """

    t: Array
    x: Array
    modes: NDArray[np.intp]
    events: tuple[SwitchEvent, ...]
    status: Status
    names: tuple[str, ...] = ()
    lower: Array | None = None
    upper: Array | None = None

    def __repr__(self) -> str:
        names, n_switches = ", ".join(self._names), len(self._switches)
        counted = f"{n_switches} switch{'' if n_switches == 1 else 'es'}"
        return f"Trajectory({span(self.t)}, {names}; {counted}; {self.status.value})"

    def to_frame(self) -> DataFrame:
        """The states and the mode at every time, as a data frame.

        Returns
        -------
        pandas.DataFrame of n_times rows
            Indexed by the times, with a column for each state, the column ``mode``, and, where
            there is a band, ``x_lower`` and ``x_upper`` of each state ``x``.
        """
        columns = dict(zip(self._names, self.x.T, strict=True))
        return frame_of(self.t, columns, {"mode": self.modes, **self.ends_of_band})

    @property
    def ends_of_band(self) -> dict[str, Array]:
        """Lower and upper end of each state by name, empty where there is no band."""
        if self.lower is None or self.upper is None:
            return {}
        ends = zip(self._names, self.lower.T, self.upper.T, strict=True)
        return {
            f"{name}_{end}": values
            for name, *both in ends
            for end, values in zip(("lower", "upper"), both, strict=True)
        }

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the states over time, and their band; thin lines stand where the mode switches.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, default=None
            None draws on a new figure.

        Returns
        -------
        matplotlib.axes.Axes
        """
        bands = [] if self.lower is None or self.upper is None else [(self.lower, self.upper)]
        return draw_series(ax, [(self.t, self.x)], self._names, self._switches, bands)

    @property
    def _names(self) -> list[str]:
        return names_or_numbers(self.names, self.x.shape[1])

    @property
    def _switches(self) -> list[float]:
        """Times at which the mode becomes another one."""
        return [event.time for event in self.events if event.before != event.after]
