"""Laws and stays of recordings in discrete time, with memory: from recordings to the answer.

With it, how certain laws are and which of both noises they were estimated from.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from swsysid._checks.parameters import whole
from swsysid._data.features import FeatureMap
from swsysid._data.recordings import Record
from swsysid._discrete_stays.data import DiscreteData
from swsysid._discrete_stays.found import Found, lasting_only
from swsysid._discrete_stays.lagged import KnownGuard, Labels, LaggedRows, lagged_rows
from swsysid._discrete_stays.modes import reassigned
from swsysid._discrete_stays.more_modes import finer_modes
from swsysid._discrete_stays.orders import LagCandidate, choose_lags, with_own_orders
from swsysid._discrete_stays.persistence import goes_on
from swsysid._discrete_stays.relations import parted_by_relations
from swsysid._discrete_stays.rows import RowFit
from swsysid._discrete_stays.search import DiscreteCandidate, Searched, StaySearch
from swsysid._discrete_stays.states import NoiseProfile, with_states
from swsysid._journal import step
from swsysid._known.known import Known
from swsysid._results import Array
from swsysid._stays.arrow import covariance_of

_AS_LIKELY = 2.0  # nats by which one kind of noise may be worse and be all: two deviations


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
    lags : ndarray of shape (n_modes,), int
        Of every mode; coefficients of features that see further back are zero.
    lag_candidates : tuple of LagCandidate
        Of ``lags="auto"``, else empty.
    searched : Searched
        The same in the order and the units of the search.
    order : tuple of int
        Recordings in the order of the search.
    names : ndarray of shape (n_modes,), int
        Modes of the search, in the order of these.
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
    lags: Labels
    lag_candidates: tuple[LagCandidate, ...]
    searched: Searched
    order: tuple[int, ...]
    names: Labels


@step
def identify_stays(
    recordings: Sequence[Record],
    lags: int | str = "auto",
    *,
    library: object = None,
    n_modes: int | str = "auto",
    channels: Sequence[str] | None = None,
    max_modes: int = 6,
    most_lags: int = 4,
    known: Known | None = None,
) -> DiscreteStays:
    """Laws and stays of recordings of a system that switches at samples.

    Parameters
    ----------
    recordings : sequence of Record
        Measured states (NaN where missing) and inputs.
    lags : int or "auto", default="auto"
        Samples before the present one that the laws see. "auto" chooses the fewest whose rollouts
        of held-out stretches are about as good as any, for all modes and then for each.
    library : None, int, transformer or PySINDy library, default=None
        Features of the lagged columns; None is the columns themselves, an int all monomials up to
        that degree.
    n_modes : int or "auto", default="auto"
        If the recordings do not tell so many apart the answer has fewer.
    channels : sequence of str, default=None
        Names of the states and inputs.
    max_modes, most_lags : int
        Where they are to be found.
    known : Known, default=None
        What is known of the laws.

    Returns
    -------
    DiscreteStays

    Raises
    ------
    ValueError
        If no recording is long enough for a row, or a number is none.

    Examples
    --------
    A state that halves until it is below 1, and doubles until it is above 8:

    >>> x, factor = [5.0], 0.5
    >>> for _ in range(60):
    ...     factor = 2.0 if x[-1] < 1.0 else 0.5 if x[-1] > 8.0 else factor
    ...     x.append(factor * x[-1])
    >>> x = np.array(x)[:, None]
    >>> found = identify_stays([Record(np.arange(61.0), x, np.empty((61, 0)))], lags=0)
    >>> sorted(found.coef.ravel().round(9).tolist()), found.modes[:8].tolist()
    ([0.5, 2.0], [0, 0, 0, 1, 1, 1, 1, 0])
    """
    whole("n_modes", n_modes, also=("auto",))
    whole("lags", lags, least=0, also=("auto",))
    # the order in which recordings are given means nothing, down to the last digit
    order = tuple(sorted(range(len(recordings)), key=lambda place: _content(recordings[place])))
    shapes = [record.y.shape for record in recordings]
    ordered = [recordings[place] for place in order]

    @cache
    def searched(lags: int) -> Searched:
        rows = lagged_rows(ordered, lags, channels)
        feature_map = FeatureMap(library, rows.columns, rows.names)
        search = StaySearch(DiscreteData.of(rows, feature_map, known), max_modes)
        return search.best(None if n_modes == "auto" else int(n_modes))

    if lags != "auto":
        one = searched(int(lags))
        return _answer(one, np.full(len(one.found.coef), lags), (), shapes, order)
    chosen, tried = choose_lags(searched, most_lags)
    one, own = with_own_orders(searched(chosen))
    return _answer(one, own, tried, shapes, order)


@step
def with_guards(stays: DiscreteStays, guards: Sequence[KnownGuard]) -> tuple[DiscreteStays, float]:
    """Modes that ask guards, laws for these, and the log likelihood of the modes.

    Noise makes a row look like one of another mode; where its guard is far from zero it is none.
    The likelihood is that of measurements and modes for the laws and the noise of `stays`. Without
    noise a row by itself tells its mode, and nothing changes.
    """
    found, data = stays.searched.found, stays.searched.data
    if found.states is None:
        return stays, 0.0
    own = [
        replace(one, source=int(stays.names[one.source]), target=int(stays.names[one.target]))
        for one in guards
    ]
    fit, likelihood = reassigned(data, replace(found.fit, guards=tuple(own)), found.states)
    free = (found.coef != 0.0).any(axis=1)
    states = with_states(data, fit, found.states.tie, found.states, free)
    kept = lasting_only(data, Found(fit, states, (*found.history, states.cost)))
    lags = stays.lags[np.argsort(stays.names)]
    if len(kept.coef) < len(lags):  # one was none: those that are left tell theirs
        used = [(law != 0.0).any(axis=0) for law in kept.coef]
        lags = np.array([data.memory[own].max(initial=0) for own in used])
    again = replace(stays.searched, found=kept)
    shapes = [one.shape for one in stays.states]
    return _answer(again, lags, stays.lag_candidates, shapes, stays.order), likelihood


def finer(stays: DiscreteStays, most: int) -> DiscreteStays | None:
    """The same with modes, `most` at most, for stays in modes that leave much."""
    return _again(stays, finer_modes(stays.searched.data, stays.searched.found, most))


def parted(stays: DiscreteStays, most: int) -> DiscreteStays | None:
    """The same with modes, `most` at most, that one law of long memory had joined.

    None where there are none, or where noise hides it.
    """
    found, data = stays.searched.found, stays.searched.data
    if found.states is not None or not data.rows.lags:
        return None
    fit = parted_by_relations(data, found.fit, most)
    if fit is None:
        return None
    return _again(stays, Found(fit, None, (*found.history, *fit.history)))


def _again(stays: DiscreteStays, found: Found | None) -> DiscreteStays | None:
    """What else was found in the rows of some stays."""
    if found is None:
        return None
    lags = np.full(len(found.coef), stays.searched.data.rows.lags)
    again, shapes = replace(stays.searched, found=found), [one.shape for one in stays.states]
    return _answer(again, lags, stays.lag_candidates, shapes, stays.order)


def _content(record: Record) -> tuple[int, bytes, bytes]:
    return len(record.y), record.y.tobytes(), record.u.tobytes()


def _answer(
    searched: Searched,
    lags: Labels,
    lag_candidates: tuple[LagCandidate, ...],
    shapes: Sequence[tuple[int, ...]],
    order: tuple[int, ...],
) -> DiscreteStays:
    """What was found, in the units and the order of the user, the most populated mode first."""
    data, found = searched.data, searched.found
    fit, n_modes = found.fit, len(found.coef)
    names = np.argsort(-np.bincount(fit.modes, minlength=n_modes), kind="stable")
    recording = np.asarray(order)[data.rows.recording]
    back = np.argsort(recording, kind="stable")
    samples = found.samples(data) * data.target_unit
    states = tuple(np.full(shape, np.nan) for shape in shapes)
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
        candidates=searched.candidates,
        lags=lags[names],
        lag_candidates=lag_candidates,
        searched=searched,
        order=order,
        names=names,
    )


@dataclass(frozen=True)
class KindsOfNoise:
    """Noise that a sensor adds, noise in the equation, and what the laws would be by either alone.

    Attributes
    ----------
    sensor, equation : ndarray of shape (n_states,)
        Standard deviations.
    sensor_alone, equation_alone : float
        Nats by which the rows are less likely if there is no other noise.
    laws_of_sensor, laws_of_equation : ndarray of shape (n_modes, n_states, n_features_out)
        Laws in that case.
    goes_on : bool
        Whether what the laws leave of rows goes on for a while, as no noise does.
    """

    sensor: Array
    equation: Array
    sensor_alone: float
    equation_alone: float
    laws_of_sensor: Array
    laws_of_equation: Array
    goes_on: bool = False

    @property
    def sizes(self) -> tuple[Array, Array]:
        """Of the sensor and in the equation."""
        return self.sensor, self.equation

    @property
    def drives(self) -> bool:
        """Whether there is noise in the equation for sure."""
        return self.sensor_alone > _AS_LIKELY

    @property
    def senses(self) -> bool:
        """Whether there is noise of the sensor for sure."""
        return self.equation_alone > _AS_LIKELY


@dataclass(frozen=True)
class DiscreteCertainty:
    """Standard errors of laws in the user's units, infinite where the rows say nothing."""

    coef: Array  # (n_modes, n_states, n_features)
    noises: KindsOfNoise | None  # None where rows are exact

    @classmethod
    def of(cls, stays: DiscreteStays) -> DiscreteCertainty:
        """That of an identification."""
        found, data, names = stays.searched.found, stays.searched.data, stays.names
        if found.states is None:
            variance = _variance_by_rows(data, found.fit)
            return cls(data.coef(np.sqrt(variance))[names], None)
        profile = NoiseProfile.of(data, found.fit, found.states)
        sensor = found.states.noise * data.target_unit
        noises = KindsOfNoise(
            sensor,
            found.states.tie * sensor,
            float(profile.nats[0]),
            float(profile.nats[-1]),
            data.coef(profile.coef[0])[names],
            data.coef(profile.coef[-1])[names],
            goes_on(
                np.where(found.fit.unexplained[:, None], 0.0, found.states.left),
                data.rows.begins,
                data.rows.lags,
                found.states.tie,
            ),
        )
        return cls(data.coef(np.sqrt(profile.variance))[names], noises)


def _variance_by_rows(data: DiscreteData, fit: RowFit) -> Array:
    """Of laws of least squares; features that see further back than a law are none of it."""
    variance, problem = np.zeros(fit.coef.shape), data.problem
    for mode, law in enumerate(fit.coef):
        longest = problem.memory[law.any(axis=0)].max(initial=0)
        used = problem.memory <= longest
        features = problem.features[fit.lawful == mode][:, used]
        told = np.diag(covariance_of(features.T @ features))
        variance[mode][:, used] = np.outer(np.square(fit.scale[mode]), told)
    if data.known is not None:  # exact rows: what is fixed has no error
        variance[data.region(len(fit.coef)).fixed[0]] = 0.0
    return variance
