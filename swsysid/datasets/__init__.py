"""Data sets: the paper's systems, generated with their truth, and measured public records."""

from swsysid.datasets._generated import (
    make_damped_oscillator,
    make_quartic_oscillator,
    make_switching_network,
)
from swsysid.datasets._measured import (
    fetch_cascaded_tanks,
    fetch_ced_prbs,
    fetch_emps,
    fetch_incubator,
    fetch_mr_damper,
    fetch_rc_vehicle,
    fetch_silverbox,
)
from swsysid.datasets._sources import MeasuredDataError
from swsysid.datasets._undeclared.make import make_undeclared, undeclared_kinds, unlisted_kinds
from swsysid.datasets._undeclared.plants import UnlistedEffect
from swsysid.datasets._undeclared.records import PlantedEffect

__all__ = [
    "MeasuredDataError",
    "PlantedEffect",
    "UnlistedEffect",
    "fetch_cascaded_tanks",
    "fetch_ced_prbs",
    "fetch_emps",
    "fetch_incubator",
    "fetch_mr_damper",
    "fetch_rc_vehicle",
    "fetch_silverbox",
    "make_damped_oscillator",
    "make_quartic_oscillator",
    "make_switching_network",
    "make_undeclared",
    "undeclared_kinds",
    "unlisted_kinds",
]
