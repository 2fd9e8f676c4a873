"""The records that estimators, relaxations, simulations and programs hand out.

They are frozen dataclasses; none needs to be built by a user. Here is where their names are
public, whichever part of the package makes them.

>>> from swsysid.results import Status
>>> Status.TIME_LIMIT.advice
'Increase time_limit; the bound and the gap say how far the answer can be.'
"""

from swsysid._automaton.parts import FirstModes
from swsysid._automaton.transitions import (
    AffineReset,
    ConjunctiveGuard,
    PolynomialGuard,
    Transition,
)
from swsysid._automaton_search.assembly import TransitionVerdict
from swsysid._automaton_search.refinement import AutomatonRefinement
from swsysid._automaton_search.report import AutomatonReport
from swsysid._identification.number_of_modes import ModeCandidate
from swsysid._identification.terms import SurfaceCandidate
from swsysid._known.checks import KnownCheck
from swsysid._results import (
    Assignment,
    IterationRecord,
    Status,
    SwitchEvent,
    Trajectory,
)
from swsysid._stays.count import CountCandidate
from swsysid._stays.identification import StayRecord
from swsysid._stays.recording_report import RecordingReport
from swsysid._surfaces.margins import MarginCertificate
from swsysid._verdict.comparison import Verdict
from swsysid._verdict.verdict import SwitchingVerdict
from swsysid.relaxations._certificates import FitCertificate
from swsysid.relaxations._mixed_integer import MipResult

__all__ = [
    "AffineReset",
    "Assignment",
    "AutomatonRefinement",
    "AutomatonReport",
    "ConjunctiveGuard",
    "CountCandidate",
    "FirstModes",
    "FitCertificate",
    "IterationRecord",
    "KnownCheck",
    "MarginCertificate",
    "MipResult",
    "ModeCandidate",
    "PolynomialGuard",
    "RecordingReport",
    "Status",
    "StayRecord",
    "SurfaceCandidate",
    "SwitchEvent",
    "SwitchingVerdict",
    "Trajectory",
    "Transition",
    "TransitionVerdict",
    "Verdict",
]
