"""scikit-learn's own checks, with no expected failures."""

from sklearn.utils.estimator_checks import parametrize_with_checks

from swsysid._classifier import PolynomialSurfaceClassifier


@parametrize_with_checks([PolynomialSurfaceClassifier()])
def test_estimator_checks(estimator, check):
    check(estimator)
