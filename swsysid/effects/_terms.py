"""Terms that need no threshold: constants, monomials, other channels, drifts and waves.

How much of a record each frequency may explain is known before a wave is fitted to it. What is
correlated in time and follows nothing at all is a disturbance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len, rfft

from swsysid._data.records import Records
from swsysid._results import Array
from swsysid.effects._base import LEVEL, Effect, Parameter, Place, figure, products, spread
from swsysid.effects._characteristics import OfAChannel, OfRates
from swsysid.effects._types import WithoutColumns

_MOST_MONOMIALS = 60  # in several channels
# Periods of a position in the range of the record.
_FEWEST_RIPPLES = 6.0  # where the search for slow ones ends
_MOST_PERIODS = 100.0
_RIPPLES_A_PERIOD = 5.0  # numbers of periods scanned in one: a peak is two wide
# Frequencies of a forcing.
_MOST_FREQUENCIES = 200_000
_FREQUENCIES_AT_ONCE = 4000  # in one scan, at most
_N_PEAKS = 6  # of the spectrum of the trajectories whose frequencies are scanned
_FREQUENCIES_A_PEAK = 2.5  # scanned in the width of a peak, one over the duration
_FASTEST = 0.25  # of the sampling rate
_FEWEST_PERIODS = 5.0  # in all trajectories: fewer are a drift or a slow feedback
_SEEN_AGAIN = 2.0  # and in the time that they cover

_FINE = 4  # frequencies of a transform in the width of a peak of one trajectory


class Bias(Effect):
    """A constant."""

    kind = "bias"
    meaning = "a constant acts on {target}: a load, a leak or an offset"
    terms = ("offset",)

    def places(self, records: Records) -> Sequence[Place]:
        return ["constant"]

    def column_names(self, label: str, *theta: float) -> tuple[str, ...]:
        return ("1",)

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        return np.ones((len(records), 1))

    def factors(self, place: Place) -> tuple[int, ...]:
        return ()


class Polynomial(Effect):
    """One monomial of states and inputs.

    Parameters
    ----------
    degree : int, default=3
        Largest degree of monomials in several channels.
    power : int, default=5
        Largest degree of monomials in one channel.
    """

    kind = "polynomial"
    meaning = "a term {channel} acts on {target}"

    def __init__(self, degree: int = 3, power: int = 5):
        self.degree = degree
        self.power = power

    def places(self, records: Records) -> Sequence[Place]:
        """Channels of the factors, such as (0, 0, 1) for x0**2 x1."""
        channels = [*records.states, *records.inputs]
        powers = [
            (channel,) * power
            for power in range(self.degree + 1, self.power + 1)
            for channel in channels
        ]
        listed = products(channels, self.degree) + powers
        return listed[: _MOST_MONOMIALS + len(powers)]

    def column_names(self, label: str, *theta: float) -> tuple[str, ...]:
        return (label,)

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        return np.prod([records.channel(channel) for channel in place], axis=0)[:, None]

    def factors(self, place: Place) -> tuple[int, ...]:
        return tuple(place)

    def label(self, place: Place, names: Sequence[str]) -> str:
        """Such as ``x^2 v``."""
        powers = {channel: place.count(channel) for channel in sorted(set(place))}
        return " ".join(
            names[channel] + (f"^{power}" if power > 1 else "") for channel, power in powers.items()
        )

    def formula(self, label: str, parameters: Mapping[str, float]) -> str:
        return f"{parameters['coefficient']:.4g} {label}"


class InputCoupling(OfRates, OfAChannel):
    """A logged signal that the declared model does not use.

    Parameters
    ----------
    positions : list of str or int, default=None
        Channels whose rates act instead of a signal. A search for what a law of a force lacks looks
        for these as well: for viscous friction where a position is logged, for inertia where a
        velocity is.
    """

    kind = "input_coupling"
    meaning = "the logged signal {channel} acts on {target}"
    needs = frozenset({"signals"})
    formulas = ("{0}",)

    def places(self, records: Records) -> Sequence[Place]:
        """The signals."""
        return records.signal_channels if self.positions is None else super().places(records)

    def functions(self, x: Array, *theta: float) -> Sequence[Array]:
        return [x]


class Drift(Effect):
    """``rate * t`` or ``rate * t * x``: a level or a coefficient that changes slowly."""

    kind = "drift"
    meaning = "{channel} in the law of {target} drifts with time: ageing, heating, leakage"
    terms = ("rate",)
    needs = frozenset({"time"})

    def places(self, records: Records) -> Sequence[Place]:
        """The level, or a channel whose coefficient drifts."""
        return [LEVEL, *records.states, *records.inputs]

    def column_names(self, label: str, *theta: float) -> tuple[str, ...]:
        return ("t",) if label == LEVEL else (f"t {label}",)

    def proportional_to(self, place: Place) -> int | None:
        return None if place == LEVEL else int(place)

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        assert records.t is not None
        values = 1.0 if place == LEVEL else records.channel(place)
        return (records.t * values)[:, None]


class _Wave(OfAChannel):
    """A sine of unknown amplitude and phase."""

    terms = ("sine", "cosine")
    formulas = ("sin({1} {0})", "cos({1} {0})")

    def functions(self, x: Array, *theta: float) -> Sequence[Array]:
        return [np.sin(theta[0] * x), np.cos(theta[0] * x)]

    def physical(self, theta: Mapping[str, float], coef: Mapping[str, float]) -> dict[str, float]:
        """Amplitude and phase in place of sine and cosine."""
        return {
            **theta,
            "amplitude": float(np.hypot(coef["sine"], coef["cosine"])),
            "phase": float(np.arctan2(coef["cosine"], coef["sine"])),
        }


class Trigonometric(_Wave):
    """``amplitude * sin(wavenumber * x + phase)``: cogging, ripple, gravity on a link."""

    kind = "trigonometric"
    # less than half a period in the data is a cubic, which has one parameter less
    meaning = "a force periodic in {channel} acts on {target}: cogging, ripple or gravity"

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        """Half a period to six in the range, none that the channel's values are too few for.

        At values g apart a wave of the number k is one of 2 pi / g - k as well: an input in steps
        shows no wave between them.
        """
        values = records.channel(place)
        waves = np.geomspace(np.pi, 12.0 * np.pi, 32) / (spread(values) or 1.0)
        return (Parameter("wavenumber", waves[waves * _usual_gap(values) < np.pi]),)


def _usual_gap(values: Array) -> float:
    """Between neighbouring values, without the outermost hundredths: half the range has larger."""
    low, high = np.quantile(values, [0.01, 0.99])
    gaps = np.sort(np.diff(np.unique(values[(values >= low) & (values <= high)])))
    covered = np.cumsum(gaps)
    return float(gaps[np.searchsorted(covered, 0.5 * covered[-1])]) if len(gaps) else 0.0


class Ripple(_Wave):
    """``amplitude * sin(2 pi x / period + phase)``: teeth of a gear, poles of a motor (cogging).

    Parameters
    ----------
    period : float, default=None
        Of the teeth, where it is known. None looks for periods shorter than those of
        `Trigonometric`, of which the record has six to a hundred.
    """

    kind = "ripple"
    meaning = "gear teeth or magnets make a force that is periodic in the position {channel}"

    def __init__(self, period: float | None = None):
        self.period = period

    def places(self, records: Records) -> Sequence[Place]:
        """What is known to be a position, or all that the laws are about where nothing is."""
        return sorted(records.positions) or records.variables

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        if self.period is not None:
            return (Parameter("period", np.array([self.period]), "{channel}", exact=True),)
        width, most = spread(records.channel(place)) or 1.0, _MOST_PERIODS
        count = int(_RIPPLES_A_PERIOD * (most - _FEWEST_RIPPLES))
        numbers = np.linspace(_FEWEST_RIPPLES, most, count)
        return (Parameter("period", width / numbers[::-1], "{channel}"),)

    def column_names(self, label: str, *theta: float) -> tuple[str, ...]:
        return super().column_names(label, 2.0 * np.pi / theta[0])

    def functions(self, x: Array, *theta: float) -> Sequence[Array]:
        return super().functions(x, 2.0 * np.pi / theta[0])


class PeriodicForcing(_Wave):
    """``amplitude * sin(2 pi frequency t + phase)``."""

    kind = "periodic_forcing"
    meaning = "a vibration of constant frequency acts on {target}"
    needs = frozenset({"time"})

    def places(self, records: Records) -> Sequence[Place]:
        return ["time"]

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        """Frequencies from two periods of the time that was seen, five in all, to a fast one.

        Trajectories that were seen at the same times show no more of them than one: what comes
        again has come twice.
        """
        lengths = records.durations
        slowest = max(
            0.7 / (max(lengths) or 1.0),
            _FEWEST_PERIODS / (sum(lengths) or 1.0),
            _SEEN_AGAIN / (_seen(records) or 1.0),
        )
        fastest, values = _FASTEST / records.step, np.empty(0)
        if slowest < fastest:
            count = int(_FREQUENCIES_A_PEAK * fastest * _duration(records))
            values = np.linspace(slowest, fastest, min(max(count, 2), _MOST_FREQUENCIES))
        return (Parameter("frequency", values, "1/{time}"),)

    def shortlist(self, records: Records, place: Place, grid: Array, left: Array) -> Array:
        """Those about the highest peaks of the trajectories, which are wider than its own."""
        squares = power(records, left, grid[:, 0])
        own = float(np.mean(records.durations)) or 1.0
        width = _FREQUENCIES_A_PEAK * _duration(records) / own
        most = _FREQUENCIES_AT_ONCE // squares.shape[1]
        return grid[likeliest(squares, max(1, min(int(_N_PEAKS * width), most)))]

    def column_names(self, label: str, *theta: float) -> tuple[str, ...]:
        return super().column_names("t", 2.0 * np.pi * theta[0])

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        assert records.t is not None
        return np.column_stack(self.functions(records.t, 2.0 * np.pi * theta[0]))


def _duration(records: Records) -> float:
    """Of the whole record, with the time between its trajectories."""
    assert records.t is not None
    return float(np.ptp(records.t)) or 1.0


def _seen(records: Records) -> float:
    """Time in which at least one trajectory was seen."""
    assert records.t is not None
    ends = sorted((records.t[rows[0]], records.t[rows[-1]]) for rows in records.trajectories)
    seen, until = 0.0, -np.inf
    for first, last in ends:
        seen += max(0.0, last - max(first, until))
        until = max(until, last)
    return float(seen)


def power(records: Records, values: Array, frequencies: Array) -> Array:
    """Squares that waves of each frequency explain of columns (n_samples, n_columns).

    Shape (n_frequencies, n_columns). Each trajectory has a wave of its own phase and amplitude, so
    that what one wave explains in all of them is less: where this is small, a wave of the whole
    record, whose peaks are narrower by the gaps between the trajectories, need not be tried.
    """
    assert records.t is not None
    total = np.zeros((len(frequencies), values.shape[1]))
    for rows in records.trajectories:
        # a quarter of a sample's distance is little of the period of a frequency that is asked for
        places = np.rint((records.t[rows] - records.t[rows[0]]) / records.step).astype(int)
        series = np.zeros((places[-1] + 1, values.shape[1]))
        np.add.at(series, places, values[rows])
        length = next_fast_len(_FINE * len(series), real=True)
        squares = np.abs(rfft(series, length, axis=0)) ** 2 / len(rows)
        total += squares[np.rint(frequencies * records.step * length).astype(int)]
    return total


def likeliest(power: Array, each: int) -> NDArray[np.intp]:
    """Frequencies (n_frequencies, n_columns) of the largest of each column, so many of them."""
    if each >= len(power):
        return np.arange(len(power))
    return np.unique(np.argpartition(-power, each, axis=0)[:each])


class UnmeasuredDisturbance(WithoutColumns):
    """A random force of some size that is forgotten after some time (Ornstein and Uhlenbeck).

    It predicts nothing in a record that is not there yet, and lowers no error. A search says it
    where what is left over is correlated in time, and where an effect with a name does not predict
    stretches it has not seen any better than such a force would.
    """

    kind = "unmeasured_disturbance"
    meaning = (
        "a force that nobody measured acts on {target}; it follows no channel, and only a sensor "
        "of what drives {target} from outside can settle it"
    )
    needs = frozenset({"order"})
    lowers_nothing = "it follows nothing that was measured"

    def places(self, records: Records) -> Sequence[Place]:
        return ["time"]

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        return (Parameter("size", np.empty(0)), Parameter("time_constant", np.empty(0), "{time}"))

    def statement(self, place: Place, names: Sequence[str], target: int, *theta: float) -> str:
        size, time_constant = map(figure, theta)
        return (
            f"a force of size {size} that nobody measured acts on {names[target]} and is forgotten "
            f"after {time_constant}; the laws do not have it"
        )
