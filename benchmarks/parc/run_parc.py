"""Fit PARC to the samples of one npz file and answer in another; runs in PARC's environment.

    python run_parc.py GIVEN.npz ANSWERED.npz

Given: X and Xdot to fit (X are monomials already), X_test, n_modes, seed. Answered: velocities
and modes at X_test, and the CPU seconds of the chosen fit and of all fits together. Features and
velocities are standardised. Of several starts and weights of separability the one with the
smallest error on the training samples is taken. Starting Python, reading and predicting are not
timed.
"""

import sys
from time import process_time

import numpy as np
from pyparc.parc import PARC
from sklearn.preprocessing import StandardScaler

# Softmax, its default, separates better than Voronoi cells of monomials; its default start,
# k-means of the monomials, is no better than a coin where modes are not clusters (SLS).
SETTINGS = [
    (start, sigma) for start in (("kmeans", 10), ("random", 0)) for sigma in (0.1, 1.0, 10.0)
]


def main() -> None:
    """Read, fit with every setting, write the best."""
    given, answered = sys.argv[1:]
    with np.load(given) as file:
        data = dict(file)
    inputs, outputs = StandardScaler().fit(data["X"]), StandardScaler().fit(data["Xdot"])
    X, Xdot = inputs.transform(data["X"]), outputs.transform(data["Xdot"])
    fits = [fit(X, Xdot, int(data["n_modes"]), int(data["seed"]), *setting) for setting in SETTINGS]
    _, seconds, model = min(fits, key=lambda fitted: fitted[0])
    velocities, modes = model.predict(inputs.transform(data["X_test"]))
    np.savez(
        answered,
        velocities=outputs.inverse_transform(velocities),
        modes=np.asarray(modes, dtype=int).ravel(),
        seconds=seconds,
        seconds_all=sum(fitted[1] for fitted in fits),
    )


def fit(X, Xdot, n_modes: int, seed: int, start: tuple, sigma: float):
    """Error on the training samples, CPU seconds and model of one setting."""
    np.random.seed(seed)  # PARC draws from numpy's global state
    model = PARC(K=n_modes, initialization=start, sigma=sigma, verbose=0)
    started = process_time()
    model.fit(X, Xdot)
    seconds = process_time() - started
    return np.square(Xdot - model.predict(X)[0]).mean(), seconds, model


if __name__ == "__main__":
    main()
