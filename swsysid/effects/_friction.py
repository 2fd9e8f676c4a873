"""Friction and drag: forces that oppose a velocity."""

from __future__ import annotations

import numpy as np

from swsysid._data.records import Records
from swsysid._results import Array
from swsysid.effects._base import Effect, Parameter, Place, figure, quantile_levels
from swsysid.effects._settings import SETTINGS

__all__ = ["AsymmetricFriction", "CoulombFriction", "QuadraticDrag", "StribeckFriction"]


class _OfAState(Effect):
    def places(self, records: Records) -> list[int]:
        """States that take both signs."""
        shares = np.mean(np.sign(records.X) > 0, axis=0), np.mean(np.sign(records.X) < 0, axis=0)
        return [
            state for state in records.states if min(s[state] for s in shares) >= SETTINGS.rare_sign
        ]


class _Dry(_OfAState):
    def breaks(self, place: Place, *theta: float) -> tuple[tuple[int, float], ...]:
        return ((place, 0.0),)


class CoulombFriction(_Dry):
    """``-friction * sign(v)``: dry friction."""

    kind = "coulomb_friction"
    meaning = "dry friction opposes {channel} with a constant force"
    terms = ("friction",)

    def column_names(self, label: str, *theta: float) -> tuple[str, ...]:
        return (f"-sign({label})",)

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        return -np.sign(records.channel(place))[:, None]


class StribeckFriction(_Dry):
    """``-(friction + breakaway * exp(-(v / velocity)**2)) * sign(v)``."""

    kind = "stribeck_friction"
    meaning = "dry friction opposes {channel} and is larger at low speed (Stribeck effect)"
    terms = ("friction", "breakaway")

    def plausible(self, coef: Array) -> bool:
        """Friction opposes the motion, and breaks away from more than it slides with."""
        return bool((coef > 0.0).all())

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        speeds = np.abs(records.channel(place))
        return (
            Parameter(
                "velocity", quantile_levels(speeds[speeds > 0.0], 0.05, 0.8, 16), "{channel}"
            ),
        )

    def column_names(self, label: str, *theta: float) -> tuple[str, ...]:
        sign = f"-sign({label})"
        return (sign, f"{sign} exp(-({label} / {figure(theta[0])})^2)")

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        velocity, sign = records.channel(place), -np.sign(records.channel(place))
        return np.column_stack([sign, sign * np.exp(-((velocity / theta[0]) ** 2))])


class AsymmetricFriction(_Dry):
    """Viscous and dry friction whose sizes differ between the two directions.

    Together with the declared model's own viscous friction the law is
    ``-(viscous_forward v + friction_forward)`` for v > 0 and
    ``-(viscous_backward v - friction_backward)`` for v < 0; `viscous_difference` is what the
    forward motion has more.
    """

    kind = "asymmetric_friction"
    meaning = "friction opposes {channel} with different sizes in the two directions"
    terms = ("friction_forward", "friction_backward", "viscous_difference")

    def column_names(self, label: str, *theta: float) -> tuple[str, ...]:
        return (f"-[{label} > 0]", f"[{label} < 0]", f"-max({label}, 0)")

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        velocity = records.channel(place)
        return np.column_stack(
            [-1.0 * (velocity > 0), 1.0 * (velocity < 0), -np.maximum(velocity, 0.0)]
        )


class QuadraticDrag(_OfAState):
    """``-drag * v * |v|``: turbulent drag."""

    kind = "quadratic_drag"
    meaning = "turbulent drag opposes {channel} in proportion to its square"
    terms = ("drag",)

    def column_names(self, label: str, *theta: float) -> tuple[str, ...]:
        return (f"-{label} |{label}|",)

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        velocity = records.channel(place)
        return -(velocity * np.abs(velocity))[:, None]
