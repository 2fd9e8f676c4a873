"""Draw the figure of the README, ``docs/_static/readme_figure.png``, and print its numbers.

Run by ``make figures``.
"""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt

from swsysid import PolynomialSurfaceClassifier, SwitchingSystemRegressor
from swsysid.datasets import make_quartic_oscillator
from swsysid.metrics import balanced_mode_accuracy, mode_accuracy
from swsysid.plotting import STYLE, RolloutDisplay, SwitchingSurfaceDisplay

FIGURE = Path(__file__).parent / "_static" / "readme_figure.png"


def main():
    """Identify the quartic oscillator from noisy velocities and draw two panels."""
    # the first five seconds of each trajectory, before most of them have settled in one mode
    data = make_quartic_oscillator(n_samples=2000, noise=0.05, t_end=5.0, random_state=0)
    test = make_quartic_oscillator(n_samples=2000, t_end=5.0, random_state=1)
    truth = make_quartic_oscillator(None, n_trajectories=5, time_step=0.05, random_state=2)
    model = SwitchingSystemRegressor(
        n_modes=2, feature_library=3, surface=PolynomialSurfaceClassifier(degree=4), random_state=0
    ).fit(data.X, data.Xdot)
    modes = model.predict_modes(test.X)
    print(f"mode accuracy {mode_accuracy(test.modes, modes):.4f}")
    print(f"balanced mode accuracy {balanced_mode_accuracy(test.modes, modes):.4f}")

    plt.style.use(STYLE)
    figure, axes = plt.subplots(1, 3, figsize=(16.0, 4.8), layout="constrained")
    SwitchingSurfaceDisplay.from_estimator(
        model, data.X, modes=data.modes, true_guard=data.guard, names=["x", "y"], ax=axes[0]
    )
    RolloutDisplay.from_estimator(
        model, truth.X, truth.t, groups=truth.groups, names=["x", "y"], ax=axes[1:]
    )
    FIGURE.parent.mkdir(exist_ok=True)
    figure.savefig(FIGURE, dpi=110)


if __name__ == "__main__":
    main()
