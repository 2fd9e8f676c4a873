"""Effects of time: drifts and periodic forcing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from swsysid._data.records import Records
from swsysid._results import Array
from swsysid.effects._base import Effect, Parameter, Place, figure

__all__ = ["Drift", "PeriodicForcing"]

_MOST_FREQUENCIES = 4000
_PER_PEAK = 2.5  # frequencies scanned in the width of a peak, one over the duration
_FASTEST = 0.25  # of the sampling rate
_FEWEST_PERIODS = 5.0  # of all trajectories together: fewer are a drift or a slow feedback


class Drift(Effect):
    """``rate * t`` or ``rate * t * x``: a level or a coefficient that changes slowly."""

    kind = "drift"
    meaning = "{channel} in the law of {target} drifts with time: ageing, heating, leakage"
    terms = ("rate",)
    needs = frozenset({"time"})

    def places(self, records: Records) -> Sequence[Place]:
        """The level, or a channel whose coefficient drifts."""
        return ["level", *records.states, *records.inputs]

    def column_names(self, label: str, *theta: float) -> tuple[str, ...]:
        return ("t",) if label == "level" else (f"t {label}",)

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        assert records.t is not None
        values = 1.0 if place == "level" else records.channel(place)
        return (records.t * values)[:, None]


class PeriodicForcing(Effect):
    """``amplitude * sin(2 pi frequency t + phase)``."""

    kind = "periodic_forcing"
    meaning = "a vibration of constant frequency acts on {target}"
    terms = ("sine", "cosine")
    needs = frozenset({"time"})

    def places(self, records: Records) -> Sequence[Place]:
        return ["time"]

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        """Frequencies from one period in a trajectory, five in all, to a quarter of the rate."""
        assert records.t is not None
        duration = float(np.ptp(records.t)) or 1.0
        fastest = _FASTEST / records.step
        count = int(np.clip(_PER_PEAK * fastest * duration, 2, _MOST_FREQUENCIES))
        lengths = [float(np.ptp(records.t[rows])) for rows in records.trajectories]
        slowest = max(0.7 / (max(lengths) or 1.0), _FEWEST_PERIODS / (sum(lengths) or 1.0))
        if slowest >= fastest:
            return (Parameter("frequency", np.empty(0), "1/{time}"),)
        return (Parameter("frequency", np.linspace(slowest, fastest, count), "1/{time}"),)

    def column_names(self, label: str, *theta: float) -> tuple[str, ...]:
        return tuple(f"{wave}({figure(2.0 * np.pi * theta[0])} t)" for wave in ("sin", "cos"))

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        assert records.t is not None
        angle = 2.0 * np.pi * theta[0] * records.t
        return np.column_stack([np.sin(angle), np.cos(angle)])

    def physical(self, theta: Mapping[str, float], coef: Mapping[str, float]) -> dict[str, float]:
        """Amplitude and phase in place of sine and cosine."""
        return {
            **theta,
            "amplitude": float(np.hypot(coef["sine"], coef["cosine"])),
            "phase": float(np.arctan2(coef["cosine"], coef["sine"])),
        }
