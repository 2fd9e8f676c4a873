"""Identify switching dynamical systems from measured data.

>>> from swsysid import SwitchingSystemRegressor
>>> from swsysid.datasets import make_damped_oscillator
>>> data = make_damped_oscillator(n_samples=500, random_state=0)
>>> model = SwitchingSystemRegressor(n_modes=2, random_state=0).fit(data.X, data.Xdot)
>>> round(model.score(data.X, data.Xdot), 2)
1.0
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from swsysid._automaton.model import HybridAutomaton
    from swsysid._automaton_regressor import HybridAutomatonRegressor
    from swsysid._classifier import PolynomialSurfaceClassifier
    from swsysid._data.features import FunctionLibrary
    from swsysid._effect_regressor import EffectRegressor
    from swsysid._journal import best_so_far
    from swsysid._known.known import Known
    from swsysid._pipelines import ModePipeline
    from swsysid._regressor import SwitchingSystemRegressor
    from swsysid._results import (
        Assignment,
        GuardWarning,
        IdentificationWarning,
        MisfitWarning,
        SolverError,
        Status,
        Trajectory,
    )
    from swsysid._saving.files import Recording, load_model, save_model
    from swsysid._tables.recordings import read_recordings
    from swsysid._trajectory_identifier import TrajectoryIdentifier
    from swsysid.diagnosis import EffectReport, EffectSearchCV
    from swsysid.relaxations import ExactRelaxation, MomentRelaxation, Relaxation, SimplexRelaxation
    from swsysid.relaxations._mixed_integer import solve_mip

__version__ = "0.2.0"

__all__ = [
    "Assignment",
    "EffectRegressor",
    "EffectReport",
    "EffectSearchCV",
    "ExactRelaxation",
    "FunctionLibrary",
    "GuardWarning",
    "HybridAutomaton",
    "HybridAutomatonRegressor",
    "IdentificationWarning",
    "Known",
    "MisfitWarning",
    "ModePipeline",
    "MomentRelaxation",
    "PolynomialSurfaceClassifier",
    "Recording",
    "Relaxation",
    "SimplexRelaxation",
    "SolverError",
    "Status",
    "SwitchingSystemRegressor",
    "Trajectory",
    "TrajectoryIdentifier",
    "__version__",
    "best_so_far",
    "load_model",
    "read_recordings",
    "save_model",
    "solve_mip",
]

# Names are imported when they are first asked for, so that the command line can print its help
# or refuse a file without waiting for scikit-learn and SciPy.
_HOMES = {
    name: home
    for home, names in {
        "_automaton.model": "HybridAutomaton",
        "_automaton_regressor": "HybridAutomatonRegressor",
        "_classifier": "PolynomialSurfaceClassifier",
        "_data.features": "FunctionLibrary",
        "_journal": "best_so_far",
        "_known.known": "Known",
        "_effect_regressor": "EffectRegressor",
        "_pipelines": "ModePipeline",
        "_regressor": "SwitchingSystemRegressor",
        "_results": "Assignment GuardWarning IdentificationWarning MisfitWarning SolverError "
        "Status Trajectory",
        "_saving.files": "Recording load_model save_model",
        "_tables.recordings": "read_recordings",
        "_trajectory_identifier": "TrajectoryIdentifier",
        "diagnosis": "EffectReport EffectSearchCV",
        "relaxations": "ExactRelaxation MomentRelaxation Relaxation SimplexRelaxation",
        "relaxations._mixed_integer": "solve_mip",
    }.items()
    for name in names.split()
}
_MODULES = frozenset(
    "datasets diagnosis differentiation effects exporting metrics plotting refinement relaxations "
    "report uncertainty weak_form".split()
)


def __getattr__(name: str) -> object:
    if name in _MODULES:
        return import_module(f"{__name__}.{name}")
    if name in _HOMES:
        value = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, *_MODULES})
