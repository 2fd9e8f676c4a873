"""Identify switching dynamical systems from measured data.

>>> from swsysid import SwitchingSystemRegressor
>>> from swsysid.datasets import make_damped_oscillator
>>> data = make_damped_oscillator(n_samples=500, random_state=0)
>>> model = SwitchingSystemRegressor(n_modes=2, random_state=0).fit(data.X, data.Xdot)
>>> round(model.score(data.X, data.Xdot), 2)
1.0
"""

from swsysid._classifier import PolynomialSurfaceClassifier
from swsysid._effect_regressor import EffectRegressor
from swsysid._features import FunctionLibrary
from swsysid._mip import solve_mip
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._results import (
    Assignment,
    IdentificationWarning,
    SolverError,
    Status,
    Trajectory,
)
from swsysid.diagnosis import EffectReport, EffectSearchCV
from swsysid.relaxations import (
    ExactRelaxation,
    MomentRelaxation,
    Relaxation,
    SimplexRelaxation,
)

__version__ = "0.1.0"

__all__ = [
    "Assignment",
    "EffectRegressor",
    "EffectReport",
    "EffectSearchCV",
    "ExactRelaxation",
    "FunctionLibrary",
    "IdentificationWarning",
    "MomentRelaxation",
    "PolynomialSurfaceClassifier",
    "Relaxation",
    "SimplexRelaxation",
    "SolverError",
    "Status",
    "SwitchingSystemRegressor",
    "Trajectory",
    "__version__",
    "solve_mip",
]
