"""
Choosing the surface's degree and beta
======================================

The estimators are scikit-learn's, so its grid search works on them, the nested surface included.
The library is PySINDy's. Folds are whole trajectories: rows of one trajectory are nearly copies of
each other, and a fold of shuffled rows would test on the training data.
"""

# %%
# Data, choices, and a score
# --------------------------
# The score is the balanced mode accuracy: one mode is rarer, and how the modes are numbered must
# not matter. The true modes are known here and reach the scorer as metadata; on measured data use
# ``mode_consistency_scorer``, which needs none.

import warnings

import matplotlib.pyplot as plt
import numpy as np
import sklearn
from pysindy import PolynomialLibrary
from sklearn.model_selection import GridSearchCV, GroupKFold

from swsysid import IdentificationWarning, SwitchingSystemRegressor
from swsysid.datasets import make_switching_network
from swsysid.metrics import balanced_mode_accuracy, mode_accuracy_scorer

data = make_switching_network(n_samples=1000, noise=0.02, random_state=0)
test = make_switching_network(n_samples=2000, random_state=1)

sklearn.set_config(enable_metadata_routing=True)
model = SwitchingSystemRegressor(feature_library=PolynomialLibrary(degree=2), random_state=0)
search = GridSearchCV(
    model.set_fit_request(groups=True),
    {"surface__degree": [1, 2, 3], "surface__beta": [1e-5, 1e-3, 1e-1]},
    scoring=mode_accuracy_scorer(balanced=True).set_score_request(modes=True),
    cv=GroupKFold(3),
)
with warnings.catch_warnings():
    # A plane is not the guard of this system, and the fits with one say so.
    warnings.simplefilter("ignore", IdentificationWarning)
    search.fit(data.X, data.Xdot, groups=data.groups, modes=data.modes)
sklearn.set_config(enable_metadata_routing=False)

print(search.best_params_)
accuracy = balanced_mode_accuracy(test.modes, search.best_estimator_.predict_modes(test.X))
print(f"balanced test mode accuracy {accuracy:.4f}")

# %%
# What was compared
# -----------------
# The guard is a sphere: a plane cannot be it, and a cubic has more coefficients than it needs.

results = search.cv_results_
figure, ax = plt.subplots(figsize=(6.4, 4.4), layout="constrained")
for degree, marker in zip([1, 2, 3], "os^", strict=True):
    rows = np.asarray(results["param_surface__degree"] == degree, dtype=bool)
    betas = np.asarray(results["param_surface__beta"][rows], dtype=float)
    ax.semilogx(betas, results["mean_test_score"][rows], marker=marker, label=f"degree {degree}")
ax.set(xlabel="surface__beta", ylabel="balanced mode accuracy")
ax.legend()
plt.show()
