"""scikit-learn's own checks of the regressor and of the feature library."""

import numpy as np
import pytest
from sklearn.utils.estimator_checks import parametrize_with_checks

from swsysid import FunctionLibrary, SwitchingSystemRegressor


@pytest.mark.filterwarnings("ignore::swsysid.IdentificationWarning")
@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
@parametrize_with_checks(
    [SwitchingSystemRegressor(), SwitchingSystemRegressor(n_modes=1, loss="squared")]
)
def test_regressor(estimator, check):
    check(estimator)


@parametrize_with_checks([FunctionLibrary([np.sin, np.cos])])
def test_function_library(estimator, check):
    check(estimator)
