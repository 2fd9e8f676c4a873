r"""Velocities of recorded states: those of a model, and the slopes of what it leaves over.

A filter that differentiates measured states smears whatever jumps inside its window: inputs, modes,
and the effects that are looked for; and a smeared jump looks like another effect. Here the filter
is part of the model. With laws f along the states, the rest :math:`r(t) = y(t) - \int^t f` of the
measurement y is nearly straight, so that its slopes D r can be taken over as many samples as it
stays straight. Of a term h that the laws lack, D r shows :math:`\bar h = D \int h`, a mean of h
over the window. The velocity of a row is

.. math:: C_j \bar\Phi + D r,

and whatever is compared with it is averaged alike. No window reaches across a switch, which two
laws would share, nor across a jump of an input; a window of two thirds of a stay leaves most of it.
Nothing is left of the filter but its noise, of which neighbours share some: only rows are kept
whose noise is independent.

Inputs that rest and jump (a relay, a step) are held between their samples, and not linear. Next to
a jump nobody knows what the input was between two samples, and half a step of the input's whole
range is a gross error.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from swsysid._data.recordings import staircases
from swsysid._data.records import Records, next_states
from swsysid._data.windows import Windows, stays_of
from swsysid._effect_model.declared import Declared, Modes
from swsysid._effect_model.decoding import (
    Decoded,
    decoded,
    modes_of_velocities,
    stretches_of,
)
from swsysid._effect_model.joint_fit import JointFit, as_stated, fit_jointly, with_decoded_modes
from swsysid._effect_search.folds import Rows, Split, StateNoise
from swsysid._effect_search.settings import SETTINGS
from swsysid._remembered import Remembered
from swsysid._results import Array
from swsysid._stays.settings import SETTINGS as STAYS
from swsysid._stays.start import named
from swsysid.differentiation import differentiate
from swsysid.differentiation._smoothing import local_polynomial
from swsysid.differentiation._strength import WINDOWS, Strength, strongest
from swsysid.effects import StructureEffect

_FEWEST_ROWS = 40
_N_FILTERINGS = 3  # the later ones with a better model of what need not be filtered
_DEGREE = 2  # of local polynomials: a slope in the middle is a mean of what it shows
_DECIDING_ROWS = 600  # of the longest stays, which say how straight a rest is
_ENOUGH_ROWS = 200  # a longer window is not worth fewer
_ENOUGH_ROWS_OF_A_MODE = 40  # nor these, of which three folds must tell its law


@dataclass(frozen=True)
class Measured:
    """A whole record with its velocities, and the rows of it that are worked on."""

    records: Records
    targets: Array  # (n_samples, n_states)
    rows: Rows
    window: int = 1  # samples that the velocity of a row is made of
    recorded: Records | None = None  # the states as they were measured, if velocities were not
    noise: StateNoise | None = None  # of these

    def is_enough(self, parts: Split, rolled_out: bool = False) -> bool:
        """Whether there are rows enough to hold some of them out.

        Where a law is rolled out every sample counts, and else those with velocities of their own.
        """
        rows = parts if rolled_out else parts.of(self.rows)
        return len(rows.search) >= self._fewest

    def enough(self, parts: Split, rolled_out: bool = False) -> str:
        """How many samples of such a record, longer or faster, would be enough, in a sentence."""
        rows, records = parts if rolled_out else parts.of(self.rows), self.records
        more = self._fewest / max(len(rows.search), 1)
        told = f"Record {int(np.ceil(len(records) * more))} samples"
        if not records.timed:
            return f"{told}."
        assert records.t is not None
        longest = float(np.ptp(records.t[max(records.trajectories, key=len)]))
        return (
            f"{told}: as fast as now over a time of {more * longest:.3g}, or in steps of "
            f"{records.step / more:.3g}."
        )

    @property
    def _fewest(self) -> int:
        n_columns = self.records.X.shape[1] + self.targets.shape[1]
        return max(_FEWEST_ROWS, SETTINGS.rows_a_column * n_columns)

    def fitted(self, declared: Declared, rows: Rows | None = None) -> JointFit:
        """The declared model alone, fitted to these rows or some of them."""
        rows = self.rows if rows is None else rows
        decoded_modes = self.records.decoded_modes
        modes = None if decoded_modes is None else decoded_modes[rows]
        return fit_jointly(declared, (), self.records, rows, self.targets[rows], modes)

    def beside(self, fit: JointFit) -> Measured | None:
        """The same from a model with effects, by which modes and velocities are better known.

        None where the model says nothing new of them.
        """
        anew = any(isinstance(term.effect, StructureEffect) for term in fit.terms)
        if not fit.terms or anew:
            return None
        if self.recorded is None:
            return None if fit.laws.seeks_modes else _with_modes(fit, self)
        states = self.records.X
        decoding = decoded(fit.laws, self.recorded, states, fit.contributions)
        return _filtered(fit, self.recorded, states, decoding)


def with_velocities(declared: Declared, records: Records, targets: Array) -> Measured:
    """A record with measured velocities, whose modes are told where they are not to be sought."""
    measured = Measured(records, targets, np.arange(len(records)))
    fit = as_stated(declared, records)
    return measured if fit is None else _with_modes(fit, measured)


def from_states(declared: Declared, records: Records) -> Measured:
    """Velocities (next states in discrete time) of a record of measured states."""
    fit = as_stated(declared, records)
    if records.n_hidden and (declared.n_modes != 1 or declared.discrete_time):
        raise ValueError(
            "order=2 asks what one law in continuous time lacks; declare n_modes=1, or identify "
            "positions by TrajectoryIdentifier(order=2)."
        )
    if declared.discrete_time:
        rows, targets = next_states(records)
        measured = Measured(records, targets, rows)
        return measured if fit is None else _with_modes(fit, measured)
    disturbance = None
    if fit is None:
        fit, states = _start(declared, records)
    else:
        states, disturbance = _lacking(fit, records)
    decoding = decoded(fit.laws, records, states, fit.contributions, disturbance)
    measured = _filtered(fit, records, states, decoding)
    for _ in range(_N_FILTERINGS - 1):
        fit, states = measured.fitted(declared), measured.records.X
        decoding = decoded(fit.laws, records, states, fit.contributions, decoding.disturbances)
        measured = _filtered(fit, records, states, decoding)
    return measured


def beside_effects(
    declared: Declared, measured: Measured, first: JointFit
) -> tuple[Declared, Measured | None]:
    """A declared model and a record that are better known with effects inside, which are in a fit.

    None for a record of which they say nothing new.
    """
    records = measured.records if measured.recorded is None else measured.recorded
    seen = records.with_columns(measured.records.X)
    anew = declared.anew(records, first.contributions(seen)) if first.terms else None
    if anew is None:
        return declared, measured.beside(first)
    if measured.recorded is None:
        return anew, with_velocities(anew, records, measured.targets)
    return anew, from_states(anew, records)


def _with_modes(fit: JointFit, measured: Measured) -> Measured:
    """The same with the modes that its velocities tell by the laws of a fit."""
    records = with_decoded_modes(fit, measured.records, measured.rows, measured.targets)
    return replace(measured, records=records)


def _start(declared: Declared, records: Records) -> tuple[JointFit, Array]:
    """The declared model fitted to differentiated states, and the states smoothed."""
    start, velocities, X = _differentiated(records, records.trajectories)
    return fit_jointly(declared, (), start, np.arange(len(start)), velocities), X


def _lacking(fit: JointFit, records: Records) -> tuple[Array, Array]:
    """Smoothed states, and the disturbance of the velocities by what known laws lack."""
    # In a record without noise a filter that trusts the laws explains what they lack by switches.
    start, velocities, X = _differentiated(records, stretches_of(fit.laws, records))
    modes = modes_of_velocities(fit.laws, start, velocities, fit.contributions)
    errors = np.abs(velocities - fit.predict(start, modes))
    left = np.max([np.median(errors[modes == mode], axis=0) for mode in np.unique(modes)], axis=0)
    return X, left[None] * np.sqrt(STAYS.memory * records.step)


def _differentiated(records: Records, stretches: list[Rows]) -> tuple[Records, Array, Array]:
    """Filtered rows with velocities, these, and all rows with their states smoothed."""
    n_states, X = records.n_states, records.X.copy()
    assert records.t is not None
    labels = np.empty(len(X), dtype=np.intp)
    for number, stretch in enumerate(stretches):
        labels[stretch] = number
    derived = differentiate(
        named(X[:, :n_states], list(records.names[:n_states])),
        records.t,
        labels,
        inputs=X[:, n_states:] if records.n_inputs else None,
        too_short="drop",
    )
    kept, sampled = np.zeros(len(X), dtype=bool), np.zeros(len(derived.t), dtype=bool)
    for label in np.unique(derived.groups):
        own, told = np.flatnonzero(labels == label), np.flatnonzero(derived.groups == label)
        # two samples between events tell a velocity midway between them, where none was taken
        kept[own] = np.isin(records.t[own], derived.t[told])
        sampled[told] = np.isin(derived.t[told], records.t[own])
    chosen, smoothed = np.flatnonzero(kept), derived.X[sampled]
    X[chosen, :n_states] = smoothed[:, :n_states]
    return records.take(chosen).with_columns(smoothed), derived.Xdot[sampled], X


def _filtered(fit: JointFit, records: Records, states: Array, decoding: Decoded) -> Measured:
    """Velocities of a model and what it leaves over, and states that are less noisy."""
    n_states = records.n_states
    added = fit.contributions(records.with_columns(states))
    motion = _drawn(fit, records.with_columns(states), decoding.modes, added)
    rest = records.X[:, :n_states] - motion
    modes = np.where(decoding.sure, decoding.modes, -1)
    windows = _windows(rest, records, modes, _between_jumps(records, decoding.stretches))
    X = np.column_stack([motion + windows.values @ rest, records.X[:, n_states:]])
    shown = np.zeros((len(records), 1), dtype=bool)
    shown[windows.whole()] = True

    seen = replace(records, X=X, average=Averages(shown, windows.means), decoded_modes=modes)
    laws, every = fit.laws.coef[decoding.modes], np.arange(len(records))
    targets = np.einsum("nkf,nf->nk", laws, fit.features(seen)) + windows.slopes @ rest
    targets += seen.averaged(added[decoding.modes, every])
    rows = windows.whole(max(1, round(windows.length / SETTINGS.rows_a_window)))
    noise = StateNoise.of(rest, windows)
    # where velocities are hidden none is compared: nothing holds neighbours of what is held out
    window = 1 if records.n_hidden else windows.length
    return Measured(seen, targets, rows[decoding.sure[rows]], window, records, noise)


@dataclass(frozen=True, eq=False)
class Averages:
    """What windows make of columns of all rows; rows without a window stay as they are."""

    shown: NDArray[np.bool_]  # (n_rows, 1): the others
    means: csr_matrix

    @cached_property
    def _kept(self) -> Remembered[tuple[NDArray[np.bool_], csr_matrix]]:
        return Remembered(2)

    def __call__(self, columns: Array, rows: Rows | None = None) -> Array:
        if rows is None:
            return np.where(self.shown, self.means @ columns, columns)
        seen, means = self._kept.of(rows, (), lambda: (self.shown[rows], self.means[rows]))
        return np.where(seen, means @ columns, columns[rows])


def _windows(rest: Array, records: Records, modes: Modes, stretches: list[Rows]) -> Windows:
    """Windows over which a rest is straight, but no longer than leaves most in the stays."""
    assert records.t is not None
    stays = stays_of(modes, stretches)
    of_modes = [
        np.array([len(stay) for stay in stays if modes[stay[0]] == mode])
        for mode in np.unique(modes[modes >= 0])
    ]
    longest = _longest(of_modes)
    lengths = [w for w in WINDOWS if SETTINGS.shortest_window <= w <= longest]
    candidates = [Strength(local_polynomial(w, _DEGREE), window=w) for w in lengths]
    long = sorted(stays, key=len, reverse=True)
    enough = np.cumsum([len(stay) for stay in long]) >= _DECIDING_ROWS
    long = long[: int(np.argmax(enough)) + 1] if enough.any() else long
    # The equation that bends most decides: the others lose nothing but some of their quiet.
    chosen = [
        strongest(
            candidates, [(column[stay, None], records.t[stay]) for stay in long], np.zeros(1), 1
        )
        for column in rest.T
    ]
    length = min((one.window for one in chosen if one.window), default=SETTINGS.shortest_window)
    return Windows(records.t, stays, length // 2, _DEGREE)


def _longest(of_modes: list[Rows]) -> int:
    """The longest window that is worth the rows it costs, for the lengths of the stays in modes."""
    # Slopes over w samples have variances that fall with the third power of w, and of a stay of L
    # samples there are (L - w) / w of them that are independent. A mode of short stays is to have
    # its share: what the modes know is multiplied, as in a determinant.
    most = max([SETTINGS.shortest_window, *(int(own.max()) for own in of_modes)])
    windows = np.arange(SETTINGS.shortest_window, most + 1)
    left = np.array(
        [np.maximum(own[:, None] - windows + 1, 0).sum(axis=0) for own in of_modes], dtype=float
    )
    rows = left * SETTINGS.rows_a_window / windows
    own = np.minimum(_ENOUGH_ROWS_OF_A_MODE, rows.max(axis=1, keepdims=True))
    many = (rows.sum(axis=0) >= _ENOUGH_ROWS) & (rows >= own).all(axis=0)
    worth = np.prod(left * (windows / most) ** 2, axis=0)
    return int(windows[np.argmax(np.where(many, worth, 0.0))])


def _drawn(fit: JointFit, records: Records, modes: NDArray[np.intp], added: Array) -> Array:
    """Integrals of the laws from the begin of each trajectory, (n_samples, n_states).

    What the effects add, (n_modes, n_samples, n_states), is `added` to the laws.

    Between two samples the states are the cubic through their values and velocities, inputs and
    what is beside the laws are linear, and the law is that of the mode at the end.
    """
    n_states, X, t = records.n_states, records.X, records.t
    assert t is not None
    first = np.concatenate([rows[:-1] for rows in records.trajectories])
    last = np.concatenate([rows[1:] for rows in records.trajectories])
    acting, step = modes[last], (t[last] - t[first])[:, None]
    at_samples, every = fit.declared_velocities(X) + added, np.arange(len(acting))
    begin, end = at_samples[acting, first], at_samples[acting, last]
    middle = 0.5 * (X[first] + X[last])
    middle[:, :n_states] += 0.125 * step * (begin - end)
    inside = fit.declared_velocities(middle)[acting, every]
    inside += 0.5 * (added[acting, first] + added[acting, last])
    steps = step / 6.0 * (begin + 4.0 * inside + end)
    answer, done = np.zeros((len(records), n_states)), 0
    for rows in records.trajectories:
        own = steps[done : done + len(rows) - 1]
        answer[rows[1:]], done = np.cumsum(own, axis=0), done + len(own)
    return answer


def _between_jumps(records: Records, stretches: list[Rows]) -> list[Rows]:
    """Stretches of a record cut where a held input steps, if that leaves most of them."""
    t, inputs = records.t, records.X[:, records.n_states :]
    assert t is not None
    held = [*staircases([(t[rows], inputs[rows]) for rows in records.trajectories])]
    cut = [
        part
        for rows in stretches
        for part in np.split(
            rows, np.flatnonzero(np.diff(inputs[rows][:, held], axis=0).any(axis=1)) + 1
        )
    ]
    left = sum(len(part) for part in cut if len(part) >= SETTINGS.shortest_window)
    return cut if 2 * left >= sum(map(len, stretches)) else stretches
