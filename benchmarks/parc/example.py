"""PARC's half of the page "Coming from PARC"; runs in PARC's environment (build.sh)."""

import warnings

import numpy as np
from pyparc.parc import PARC
from sklearn.preprocessing import StandardScaler

warnings.simplefilter("ignore", FutureWarning)  # PARC passes an argument that scikit-learn retires

rng = np.random.default_rng(0)
X = rng.uniform(-2.0, 2.0, (2000, 2))
damping = np.where(X[:, 0] > 0.0, 0.1, 0.5)
Xdot = np.column_stack([X[:, 1], -X[:, 0] - damping * X[:, 1]])
Xdot += 0.02 * rng.standard_normal(Xdot.shape)

inputs, outputs = StandardScaler().fit(X), StandardScaler().fit(Xdot)
np.random.seed(0)  # PARC draws from numpy's global state
parc = PARC(K=2, sigma=1.0, verbose=0)
parc.fit(inputs.transform(X), outputs.transform(Xdot))
velocities, modes = parc.predict(inputs.transform(X))
velocities = outputs.inverse_transform(velocities)
rmse = np.sqrt(np.mean((velocities - Xdot) ** 2))
right = np.mean((np.ravel(modes) == 1) == (X[:, 0] > 0.0))
print(f"error of the velocities {rmse:.4f}, modes right {100 * max(right, 1 - right):.1f} %")
