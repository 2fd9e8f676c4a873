"""Stays and laws of recordings in discrete time, with memory: the search from end to end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton_search.discrete_data import DiscreteData
from swsysid._automaton_search.discrete_modes import reassigned
from swsysid._automaton_search.discrete_rows import RowFit, alternate, assigned, scale_of
from swsysid._automaton_search.discrete_settings import SETTINGS, DiscreteSettings
from swsysid._automaton_search.discrete_starts import LawPool
from swsysid._automaton_search.discrete_states import StateFit, with_states
from swsysid._automaton_search.lagged import Labels, LaggedRows, lagged_rows
from swsysid._checks.parameters import whole
from swsysid._data.features import FeatureMap
from swsysid._results import Array
from swsysid.refinement._trajectories import Record


@dataclass(frozen=True)
class DiscreteCandidate:
    """One number of modes, and what the recordings say of it: the least criterion is chosen."""

    n_modes: int
    criterion: float  # nats: negative log likelihood, switches and coefficients paid for


@dataclass(frozen=True)
class DiscreteStays:
    """Laws of all modes, and the mode of every row of the recordings.

    Attributes
    ----------
    coef : ndarray of shape (n_modes, n_states, n_features_out)
        Laws x[k + 1] = C_j Phi(row k), the most populated mode first.
    feature_map : FeatureMap
        Of the lagged columns.
    rows : LaggedRows
        Recording after recording, in the order in which they were given.
    modes : ndarray of shape (n_rows,), int
    straddling : ndarray of shape (n_rows,), bool
        Rows that no law explains, since the state jumps between their samples; their mode is that
        of a neighbour.
    states : tuple of ndarray of shape (n_samples, n_states)
        Of every recording: measured states without their noise, NaN where no row tells.
    noise : ndarray of shape (n_states,)
        Standard deviations of the measurements, about rounding if there is none.
    history : tuple of float
        Nats of the winning start, round after round.
    candidates : tuple of DiscreteCandidate
        Numbers of modes that were compared.
    """

    coef: Array
    feature_map: FeatureMap
    rows: LaggedRows
    modes: Labels
    straddling: NDArray[np.bool_]
    states: tuple[Array, ...]
    noise: Array
    history: tuple[float, ...]
    candidates: tuple[DiscreteCandidate, ...]


def identify_stays(
    recordings: Sequence[Record],
    lags: int,
    *,
    library: object = None,
    n_modes: int | str = "auto",
    channels: Sequence[str] | None = None,
    settings: DiscreteSettings = SETTINGS,
) -> DiscreteStays:
    """Laws and stays of recordings of a system that switches at samples.

    Parameters
    ----------
    recordings : sequence of Record
    lags : int
        Samples before the present one that the laws see.
    library : None, int, transformer or PySINDy library, default=None
        Features of the lagged columns; None is the columns themselves, an int all monomials up to
        that degree.
    n_modes : int or "auto", default="auto"
        If no more modes than fewer can be told apart the answer has fewer.
    channels : sequence of str, default=None
        Names of the states and inputs.
    settings : DiscreteSettings

    Returns
    -------
    DiscreteStays

    Raises
    ------
    ValueError
        If no recording is long enough for a row, or `n_modes` is no number of modes.
    """
    most = settings.most_modes if n_modes == "auto" else whole("n_modes", n_modes, least=1)
    # the order in which recordings are given means nothing, down to the last digit
    order = sorted(range(len(recordings)), key=lambda place: _content(recordings[place]))
    rows = lagged_rows([recordings[place] for place in order], lags, channels)
    data = DiscreteData.of(rows, FeatureMap(library, rows.columns, rows.names), settings)
    search = StaySearch(data, most)
    found, candidates = search.best(None if n_modes == "auto" else most)
    return _answer(data, search.on_all_rows(found), candidates, recordings, order)


@dataclass(frozen=True)
class Found:
    """Modes and laws; with states where the measurements have noise."""

    fit: RowFit
    states: StateFit | None
    history: tuple[float, ...]

    @property
    def cost(self) -> float:
        """Nats that are minimised."""
        return self.fit.cost if self.states is None else self.states.cost

    @property
    def coef(self) -> Array:
        """Laws in the units of the data."""
        return self.fit.coef if self.states is None else self.states.coef


class StaySearch:
    """Compares numbers of modes on a part of the rows, then goes on with all of them."""

    def __init__(self, data: DiscreteData, most: int):
        self.data, self.part = data, data.part()
        self.pool = LawPool(self.part.problem)
        self.most, self.settings = most, data.settings

    def best(self, n_modes: int | None) -> tuple[Found, tuple[DiscreteCandidate, ...]]:
        """The best identification, with so many modes or as many as the data ask for."""
        by_rows = self._by_rows(n_modes)
        if n_modes is not None:
            fewer = [count for count in by_rows if count <= n_modes]
            by_rows = {max(fewer): by_rows[max(fewer)]}
        found = {count: Found(fit, None, fit.history) for count, fit in by_rows.items()}
        if not any(_is_exact(fit, self.settings) for fit in by_rows.values()):
            for turn, ties in enumerate(self.settings.stages):
                found = self._hopeful(found, self.settings.hopeless[turn])
                found = {count: with_noise(self.part, one, ties) for count, one in found.items()}
        chosen = min(found.values(), key=lambda one: one.cost)
        candidates = [DiscreteCandidate(count, one.cost) for count, one in found.items()]
        return chosen, tuple(candidates)

    def _hopeful(self, found: dict[int, Found], nats: float) -> dict[int, Found]:
        """Candidates not worse than one of fewer modes, nor by so many nats a row than any."""
        most = min(one.cost for one in found.values()) + nats * len(self.part.rows)
        kept: dict[int, Found] = {}
        for count, one in sorted(found.items()):
            if one.cost <= min([most, *(fewer.cost for fewer in kept.values())]):
                kept[count] = one
        return kept

    def _by_rows(self, n_modes: int | None) -> dict[int, RowFit]:
        """The best fit by rows of every number of modes, until two more modes say no more."""
        best: dict[int, RowFit] = {}
        last: RowFit | None = None
        in_vain = 0
        for count in range(1, self.most + 1 + self.settings.patience):
            last = self._alternated(count, last)
            lasting = without_momentary(self.part, last)
            n_lasting = len(lasting.coef)
            before = min((fit.cost for fit in best.values()), default=np.inf)
            if n_lasting not in best or lasting.cost < best[n_lasting].cost:
                best[n_lasting] = lasting
            if n_modes is not None and n_lasting >= n_modes:
                break
            in_vain = 0 if lasting.cost < before else in_vain + 1
            if n_modes is None and (in_vain > self.settings.patience or count >= self.most):
                break
        return best

    def _alternated(self, count: int, last: RowFit | None) -> RowFit:
        """The best of the starts with so many modes."""
        starts = [self.pool.best(count)]
        if last is not None:
            starts.append(self.pool.beside(last.coef))
        fits = [alternate(self.part.problem, coef) for coef in starts]
        return min(fits, key=lambda fit: fit.cost)

    def on_all_rows(self, found: Found) -> Found:
        """The same with all rows."""
        if self.part is self.data:
            return found
        if found.states is None:
            fit = alternate(self.data.problem, found.coef)
            return Found(fit, None, found.history + fit.history)
        problem, part = self.data.problem, self.part.problem
        scale = scale_of(part, found.coef, found.fit.lawful)
        fit = assigned(problem, found.coef, scale, found.fit.switching)
        return with_noise(self.data, Found(fit, None, found.history), [found.states.tie] * 2)


def without_momentary(data: DiscreteData, fit: RowFit) -> RowFit:
    """A fit without modes whose stays are as short as what straddles a jump.

    The rows of a jump may have a law of their own, that of the reset; they are no mode.
    """
    modes = fit.lawful
    first = np.flatnonzero(data.rows.begins | np.append(True, np.diff(modes) != 0))
    length = np.diff(np.append(first, len(modes)))
    short = length <= data.rows.lags + 1
    lasting = np.array([
        np.mean(short[own]) < data.settings.momentary if (own := modes[first] == mode).any()
        else False
        for mode in range(len(fit.coef))
    ])  # fmt: skip
    if lasting.all() or not lasting.any():
        return fit
    return without_momentary(data, alternate(data.problem, fit.coef[lasting]))


def with_noise(data: DiscreteData, found: Found, ties: Sequence[float]) -> Found:
    """Laws and modes in turn, with noise where it was measured and ever less disturbance.

    A disturbance that is tried again is left as soon as the modes stay, and smaller ones are not
    tried once they have made the measurements much less likely.
    """
    fit, states, history = found.fit, found.states, [*found.history]
    best, settled = found, None
    hopeless = data.settings.hopeless[-1] * len(data.rows)
    for tie in ties:
        if tie == settled:
            continue
        states = with_states(data, fit, tie, states)
        history.append(states.cost)
        if best.states is None or states.cost < best.cost:
            best = Found(fit, states, ())
        if states.cost > best.cost + hopeless:
            break
        before, fit = fit, reassigned(data, fit, states)
        settled = tie if np.array_equal(before.lawful, fit.lawful) else None
    return replace(best, history=tuple(history))


def _is_exact(fit: RowFit, settings: DiscreteSettings) -> bool:
    return bool((fit.scale < settings.exact).all())


def _content(record: Record) -> tuple[int, bytes, bytes]:
    return len(record.y), record.y.tobytes(), record.u.tobytes()


def _answer(
    data: DiscreteData,
    found: Found,
    candidates: tuple[DiscreteCandidate, ...],
    recordings: Sequence[Record],
    order: list[int],
) -> DiscreteStays:
    """What was found, in the units and the order of the user, the most populated mode first."""
    fit, n_modes = found.fit, len(found.coef)
    names = np.argsort(-np.bincount(fit.modes, minlength=n_modes), kind="stable")
    recording = np.asarray(order)[data.rows.recording]
    back = np.argsort(recording, kind="stable")
    samples = _samples(data, found.states) * data.target_unit
    states = tuple(np.full(record.y.shape, np.nan) for record in recordings)
    for place, estimated in enumerate(states):
        own = recording == place
        for lag in range(-1, data.rows.lags + 1):
            estimated[data.rows.sample[own] - lag] = samples[own, lag + 1]
    noise = np.median(fit.scale, axis=0) if found.states is None else found.states.noise
    return DiscreteStays(
        coef=data.coef(found.coef)[names],
        feature_map=data.feature_map,
        rows=replace(data.rows, recording=recording).take(back),
        modes=np.argsort(names)[fit.modes][back],
        straddling=fit.unexplained[back],
        states=states,
        noise=noise * data.target_unit,
        history=found.history,
        candidates=candidates,
    )


def _samples(data: DiscreteData, found: StateFit | None) -> Array:
    """States at x[k + 1], x[k], ... of every row, (n_rows, lags + 2, n_states)."""
    if found is not None:
        return found.states[found.back]
    n_states, lags = data.rows.n_states, data.rows.lags
    columns = data.rows.columns[:, : n_states * (lags + 1)]
    every = np.hstack([data.rows.targets, columns]).reshape(-1, lags + 2, n_states)
    return np.asarray(every / data.target_unit)
