"""Fit PARC to the samples of one npz file and answer in another; runs in PARC's environment.

    python run_parc.py GIVEN.npz ANSWERED.npz

Given: X and Xdot to fit (X are monomials already), X_test, which monomials may separate the modes,
n_modes, seed. Answered: velocities and modes at X_test, and the CPU seconds of the chosen fit and
of all fits together. Features and velocities are standardised. Of several starts and weights of
separability the one with the smallest error on the training samples is taken. Starting Python,
reading and predicting are not timed.
"""

import sys
from time import process_time

import numpy as np
from pyparc.parc import PARC
from sklearn.preprocessing import StandardScaler

# Softmax and k-means of the features are its defaults, and sigma 1; but k-means of monomials is no
# better than a coin where modes are not clusters, only about a third of the random starts find the
# modes of SLS, and under noise sigma 10 finds them where 1 and 0.1 do not.
SETTINGS = [
    (start, sigma)
    for start, number in ((("kmeans", 10), 1), (("random", 0), 4))
    for sigma in (1.0, 10.0)
    for _ in range(number)
]


def main() -> None:
    """Read, fit with every setting, write the best."""
    given, answered = sys.argv[1:]
    with np.load(given) as file:
        data = dict(file)
    inputs, outputs = StandardScaler().fit(data["X"]), StandardScaler().fit(data["Xdot"])
    X, Xdot = inputs.transform(data["X"]), outputs.transform(data["Xdot"])
    separating, n_modes = data["separating"], int(data["n_modes"])
    fits = [
        fit(X, Xdot, separating, n_modes, [int(data["seed"]), number], *setting)
        for number, setting in enumerate(SETTINGS)
    ]
    _, seconds, model = min(fits, key=lambda fitted: fitted[0])
    velocities, modes = model.predict(inputs.transform(data["X_test"]))
    np.savez(
        answered,
        velocities=outputs.inverse_transform(velocities),
        modes=np.asarray(modes, dtype=int).ravel(),
        seconds=seconds,
        seconds_all=sum(fitted[1] for fitted in fits),
    )


def fit(X, Xdot, separating, n_modes: int, seed: list[int], start: tuple, sigma: float):
    """Error on the training samples, CPU seconds and model of one setting."""
    np.random.seed(seed)  # PARC draws from numpy's global state
    model = PARC(K=n_modes, initialization=start, sigma=sigma, verbose=0)
    started = process_time()
    model.fit(X, Xdot, feature_selection=separating)
    seconds = process_time() - started
    return np.square(Xdot - model.predict(X)[0]).mean(), seconds, model


if __name__ == "__main__":
    main()
