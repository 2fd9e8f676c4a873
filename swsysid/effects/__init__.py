"""Effects that a declared model may lack."""

from swsysid._data.records import Records
from swsysid._search.trials import PlacedEffect
from swsysid.effects._actuator import DeadZone, GainChange, Overflow, PowerLaw, Saturation
from swsysid.effects._base import Effect, Parameter
from swsysid.effects._found import FoundEffect, Rival
from swsysid.effects._friction import (
    AsymmetricFriction,
    CoulombFriction,
    QuadraticDrag,
    StribeckFriction,
)
from swsysid.effects._guards import ExtraMode, GuardHysteresis, Reset
from swsysid.effects._memory import Backlash, Delay, Lag
from swsysid.effects._sensors import ClockLag, SensorOffset
from swsysid.effects._static import Bias, InputCoupling, Polynomial, Trigonometric
from swsysid.effects._time import Drift, PeriodicForcing


def all_effects() -> list[Effect]:
    """Every effect of the library, the simplest explanation first."""
    return [
        Bias(),
        CoulombFriction(),
        QuadraticDrag(),
        InputCoupling(),
        Drift(),
        Polynomial(),
        DeadZone(),
        Saturation(),
        PowerLaw(),
        Delay(),
        Lag(),
        Backlash(),
        Overflow(),
        GainChange(),
        PeriodicForcing(),
        Trigonometric(),
        StribeckFriction(),
        AsymmetricFriction(),
        SensorOffset(),
        ClockLag(),
        GuardHysteresis(),
        Reset(),
        ExtraMode(),
    ]


__all__ = [
    "AsymmetricFriction",
    "Backlash",
    "Bias",
    "ClockLag",
    "CoulombFriction",
    "DeadZone",
    "Delay",
    "Drift",
    "Effect",
    "ExtraMode",
    "GainChange",
    "GuardHysteresis",
    "InputCoupling",
    "Lag",
    "Overflow",
    "Parameter",
    "PlacedEffect",
    "Records",
    "Rival",
    "FoundEffect",
    "PeriodicForcing",
    "Polynomial",
    "PowerLaw",
    "QuadraticDrag",
    "Reset",
    "Saturation",
    "SensorOffset",
    "StribeckFriction",
    "Trigonometric",
    "all_effects",
]
