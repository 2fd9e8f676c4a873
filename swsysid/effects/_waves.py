"""Sines: of a channel and of time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from swsysid._data.records import Records
from swsysid._results import Array
from swsysid.effects._base import Effect, Parameter, Place, figure, spread
from swsysid.effects._settings import SETTINGS

__all__ = ["PeriodicForcing", "Trigonometric"]


class _Wave(Effect):
    """A sine of unknown amplitude and phase."""

    terms = ("sine", "cosine")

    def argument(self, label: str, *theta: float) -> str:
        """The angle as text."""
        raise NotImplementedError

    def angle(self, records: Records, place: Place, *theta: float) -> Array:
        """The angle at every row."""
        raise NotImplementedError

    def column_names(self, label: str, *theta: float) -> tuple[str, ...]:
        angle = self.argument(label, *theta)
        return f"sin({angle})", f"cos({angle})"

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        angle = self.angle(records, place, *theta)
        return np.column_stack([np.sin(angle), np.cos(angle)])

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
        width = spread(records.channel(place)) or 1.0
        return (Parameter("wavenumber", np.geomspace(np.pi, 12.0 * np.pi, 32) / width),)

    def argument(self, label: str, *theta: float) -> str:
        return f"{figure(theta[0])} {label}"

    def angle(self, records: Records, place: Place, *theta: float) -> Array:
        return theta[0] * records.channel(place)


class PeriodicForcing(_Wave):
    """``amplitude * sin(2 pi frequency t + phase)``."""

    kind = "periodic_forcing"
    meaning = "a vibration of constant frequency acts on {target}"
    needs = frozenset({"time"})

    def places(self, records: Records) -> Sequence[Place]:
        return ["time"]

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        """Frequencies from one period in a trajectory, five in all, to a quarter of the rate."""
        assert records.t is not None
        duration = float(np.ptp(records.t)) or 1.0
        fastest = SETTINGS.fastest / records.step
        count = int(
            np.clip(SETTINGS.frequencies_a_peak * fastest * duration, 2, SETTINGS.most_frequencies)
        )
        lengths = [float(np.ptp(records.t[rows])) for rows in records.trajectories]
        slowest = max(0.7 / (max(lengths) or 1.0), SETTINGS.fewest_periods / (sum(lengths) or 1.0))
        if slowest >= fastest:
            return (Parameter("frequency", np.empty(0), "1/{time}"),)
        return (Parameter("frequency", np.linspace(slowest, fastest, count), "1/{time}"),)

    def argument(self, label: str, *theta: float) -> str:
        return f"{figure(2.0 * np.pi * theta[0])} t"

    def angle(self, records: Records, place: Place, *theta: float) -> Array:
        assert records.t is not None
        return 2.0 * np.pi * theta[0] * records.t
