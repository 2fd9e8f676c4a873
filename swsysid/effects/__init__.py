"""Effects that a declared model may lack."""

from swsysid._data.records import Records
from swsysid.effects._actuator import DeadZone, GainChange, Overflow, PowerLaw, Saturation
from swsysid.effects._base import Effect, Parameter
from swsysid.effects._found import FoundEffect, Rival
from swsysid.effects._friction import (
    AsymmetricFriction,
    CoulombFriction,
    QuadraticDrag,
    StribeckFriction,
)
from swsysid.effects._guards import GuardHysteresis
from swsysid.effects._memory import Backlash, Delay, Lag
from swsysid.effects._placed import PlacedEffect
from swsysid.effects._resets import Reset
from swsysid.effects._sensors import ClockLag, SensorOffset
from swsysid.effects._static import Bias, Drift, InputCoupling, Polynomial
from swsysid.effects._structure import ExtraMode
from swsysid.effects._types import GuardEffect, MeasurementEffect, ResetEffect, StructureEffect
from swsysid.effects._waves import PeriodicForcing, Trigonometric


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
    "GuardEffect",
    "GuardHysteresis",
    "InputCoupling",
    "Lag",
    "MeasurementEffect",
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
    "ResetEffect",
    "Saturation",
    "SensorOffset",
    "StribeckFriction",
    "StructureEffect",
    "Trigonometric",
    "all_effects",
]
