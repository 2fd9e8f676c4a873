"""Effects that a declared model may lack."""

from swsysid._data.records import Records
from swsysid.effects._base import Effect, Parameter
from swsysid.effects._characteristics import (
    AsymmetricFriction,
    CoulombFriction,
    DeadZone,
    GainChange,
    Overflow,
    PowerLaw,
    QuadraticDrag,
    Saturation,
    StribeckFriction,
)
from swsysid.effects._disturbance import UnmeasuredDisturbance
from swsysid.effects._guards import GuardHysteresis
from swsysid.effects._memory import Backlash, Delay, Lag
from swsysid.effects._placed import Formula, FoundEffect, PlacedEffect, Rival
from swsysid.effects._sensors import ClockLag, SensorOffset
from swsysid.effects._shapes import UnknownFunction
from swsysid.effects._switching import ExtraMode, Reset
from swsysid.effects._terms import (
    Bias,
    Drift,
    InputCoupling,
    PeriodicForcing,
    Polynomial,
    Trigonometric,
)
from swsysid.effects._types import GuardEffect, MeasurementEffect, ResetEffect, StructureEffect


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
        UnknownFunction(),
        UnmeasuredDisturbance(),
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
    "Formula",
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
    "UnknownFunction",
    "UnmeasuredDisturbance",
    "all_effects",
]
