"""Effects that a declared model may lack."""

# In reading order: `_base` is what an effect is, `_types` its four kinds that are no columns;
# `_terms`, `_characteristics`, `_friction`, `_shapes` are columns of the present, `_memory` and
# `_bristles` of the past, `_intervals` of a time, `_rates` act on a rate as a whole, `_sensors`
# change the record, `_guards` and `_switching` the modes; `_placed` puts one at a place,
# `_kinematics` says which states are positions.

from swsysid._data.records import Records
from swsysid.effects._base import Effect, Parameter
from swsysid.effects._bristles import BoucWen, DahlFriction, LuGreFriction
from swsysid.effects._characteristics import (
    DeadZone,
    GainChange,
    Hill,
    InputGain,
    Overflow,
    PowerLaw,
    Saturation,
    SoftSaturation,
)
from swsysid.effects._friction import (
    AsymmetricFriction,
    CoulombFriction,
    Hysteresis,
    LoadFriction,
    QuadraticDrag,
    StribeckFriction,
)
from swsysid.effects._guards import GuardHysteresis
from swsysid.effects._intervals import TimeInterval
from swsysid.effects._memory import Backlash, Delay, Lag, TransportDelay
from swsysid.effects._placed import Formula, FoundEffect, PlacedEffect, Rival
from swsysid.effects._rates import EndStop, RateEffect, RateLimit, Stick
from swsysid.effects._sensors import ClockLag, Feedthrough, Quantisation, SensorOffset
from swsysid.effects._shapes import UnknownFunction
from swsysid.effects._switching import ExtraMode, Reset
from swsysid.effects._terms import (
    Bias,
    Drift,
    InputCoupling,
    PeriodicForcing,
    Polynomial,
    Ripple,
    Trigonometric,
    UnmeasuredDisturbance,
)
from swsysid.effects._types import GuardEffect, MeasurementEffect, ResetEffect, StructureEffect


def all_effects() -> list[Effect]:
    """Effects that every search looks for, the simplest explanation first."""
    return [
        Bias(),
        CoulombFriction(),
        QuadraticDrag(),
        InputCoupling(),
        Drift(),
        Hysteresis(),
        Polynomial(),
        DeadZone(),
        Saturation(),
        PowerLaw(),
        Delay(),
        Lag(),
        TransportDelay(),
        Backlash(),
        Overflow(),
        Stick(),
        RateLimit(),
        EndStop(),
        GainChange(),
        PeriodicForcing(),
        StribeckFriction(),
        AsymmetricFriction(),
        LoadFriction(),
        DahlFriction(in_motions=False),
        Trigonometric(),
        SensorOffset(),
        Feedthrough(),
        ClockLag(),
        GuardHysteresis(),
        Reset(),
        ExtraMode(),
        TimeInterval(),
        UnknownFunction(),
        UnmeasuredDisturbance(),
    ]


def special_effects() -> list[Effect]:
    """Effects that a search looks for where they are asked for.

    They take longer to try, or are hardly told from one of `all_effects` by most records: who
    expects one says so. Dahl's friction is looked for in laws of forces anyway.

    Examples
    --------
    >>> from swsysid import EffectSearchCV, SwitchingSystemRegressor
    >>> from swsysid.effects import DahlFriction, all_effects
    >>> library = [*all_effects(), DahlFriction()]
    >>> search = EffectSearchCV(SwitchingSystemRegressor(1), effects=library)
    """
    return [
        InputGain(),
        SoftSaturation(),
        Hill(),
        Ripple(),
        Quantisation(),
        DahlFriction(),
        LuGreFriction(),
        BoucWen(),
    ]


__all__ = [
    "AsymmetricFriction",
    "Backlash",
    "Bias",
    "BoucWen",
    "ClockLag",
    "CoulombFriction",
    "DahlFriction",
    "DeadZone",
    "Delay",
    "Drift",
    "Effect",
    "EndStop",
    "ExtraMode",
    "Feedthrough",
    "Formula",
    "GainChange",
    "GuardEffect",
    "GuardHysteresis",
    "Hill",
    "Hysteresis",
    "InputCoupling",
    "InputGain",
    "Lag",
    "LoadFriction",
    "LuGreFriction",
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
    "Quantisation",
    "Reset",
    "ResetEffect",
    "RateEffect",
    "RateLimit",
    "Ripple",
    "Saturation",
    "SensorOffset",
    "SoftSaturation",
    "Stick",
    "StribeckFriction",
    "StructureEffect",
    "TimeInterval",
    "TransportDelay",
    "Trigonometric",
    "UnknownFunction",
    "UnmeasuredDisturbance",
    "all_effects",
    "special_effects",
]
