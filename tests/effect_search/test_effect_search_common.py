"""scikit-learn's own checks of the search for effects and of models with effects."""

import pytest
from sklearn.utils.estimator_checks import parametrize_with_checks

from swsysid import EffectRegressor, EffectSearchCV, SwitchingSystemRegressor
from swsysid.effects import CoulombFriction, Polynomial

DECLARED = SwitchingSystemRegressor(n_modes=1, random_state=0)


@pytest.mark.filterwarnings("ignore::swsysid.IdentificationWarning")
@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
@parametrize_with_checks(
    [
        EffectSearchCV(DECLARED, effects=[CoulombFriction(), Polynomial()], max_effects=1),
        EffectRegressor(DECLARED),
    ]
)
def test_scikit_learn_checks(estimator, check):
    check(estimator)
