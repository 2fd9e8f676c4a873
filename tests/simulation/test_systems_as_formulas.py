"""A fitted model as formulas: its surface is one or is refused, whatever classifier it is."""

import numpy as np
import pytest
from sklearn.tree import DecisionTreeClassifier

from swsysid import PolynomialSurfaceClassifier, SwitchingSystemRegressor
from swsysid.exporting import NoFormulaError

X = np.linspace(-1.0, 1.0, 40)[:, None]
Y = np.where(X > 0.25, -X, 2.0 * X)  # another law above .25


def fitted(surface, n_modes=2):
    return SwitchingSystemRegressor(n_modes, surface=surface, n_init=2, random_state=0).fit(X, Y)


@pytest.mark.parametrize("x", [-0.7, 0.1, 0.6])
def test_a_polynomial_surface_is_a_formula_with_its_sign(x):
    surface = fitted(PolynomialSurfaceClassifier(degree=1))
    told = surface.to_sympy()
    values = {symbol: x for symbol in told.states}
    mode = int(surface.predict_modes([[x]])[0])
    law = float(told.laws[mode][0].subs(values))
    assert law == pytest.approx(-x if x > 0.25 else 2.0 * x, abs=1e-6)


@pytest.mark.parametrize("n_modes", [1, 2])
def test_a_tree_is_no_formula_and_one_mode_needs_none(n_modes):
    model = fitted(DecisionTreeClassifier(), n_modes)
    if n_modes == 1:
        assert model.to_sympy() is not None
    else:
        with pytest.raises(NoFormulaError, match="the surface of DecisionTreeClassifier is no"):
            model.to_sympy()
