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
from swsysid.plotting import PALETTE, STYLE

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
# One dot a fold. The guard is a sphere: a plane cannot be it, and scores what guessing does; a
# cubic has more coefficients than it needs, and gains nothing. Beta hardly matters here.

plt.style.use(STYLE)
results = search.cv_results_
degrees = np.asarray(results["param_surface__degree"], dtype=int)
betas = np.asarray(results["param_surface__beta"], dtype=float)
folds = np.array([results[f"split{fold}_test_score"] for fold in range(search.n_splits_)])
figure, ax = plt.subplots(figsize=(6.8, 4.4), layout="constrained")
for shift, beta, marker in zip((-0.2, 0.0, 0.2), np.unique(betas), "os^", strict=True):
    columns = betas == beta
    places = np.broadcast_to(degrees[columns] + shift, folds[:, columns].shape)
    ax.plot(places.T, folds[:, columns].T, marker, color=PALETTE["os^".index(marker)], alpha=0.7)
    ax.plot([], [], marker, color=PALETTE["os^".index(marker)], label=f"beta {beta:g}")
ax.axhline(0.5, color="0.6", linewidth=1.0, linestyle="--", zorder=0)
ax.set(xlabel="degree of the surface", ylabel="balanced mode accuracy, held out")
ax.set(xticks=np.unique(degrees), ylim=(0.45, 1.02))
ax.legend(loc="center right")
plt.show()
