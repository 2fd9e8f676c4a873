"""Write cart.csv: a motor pushes a cart on a rail, and at one end of the rail is a rubber bumper.

    python examples/cart/simulate_cart.py [FILE]        # cart.csv beside this script by default

Five runs of eight seconds are simulated, each from rest with a force of its own, and logged 100
times a second: position and speed with the noise of their sensors, and the commanded force. The
file names neither the bumper nor the dry friction of the rail; both are to be found.
"""

import csv
import sys
from pathlib import Path

import numpy as np

MASS = 2.0  # kg
VISCOUS = 3.0  # N s/m
DRY_FRICTION = 0.8  # N
BUMPER = 0.25  # m, where the rubber begins
STIFFNESS = 160.0  # N/m, of the rubber
RUBBER_DAMPING = 6.0  # N s/m

STEP = 0.01  # s, between rows
SUBSTEPS = 20  # of the simulation, within a row
DURATION = 8.0  # s, of a run
RUNS = 5
NOISE = (0.0005, 0.005)  # m and m/s, standard deviations of the two sensors
COLUMNS = ["run", "t [s]", "x [m]", "v [m/s]", "force [N]"]


def main():
    """Simulate all runs and write the file."""
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("cart.csv")
    generator = np.random.default_rng(7)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for run in range(1, RUNS + 1):
            writer.writerows(measured_run(run, generator))


def measured_run(run, generator):
    """Rows of one run, rounded as the logger does."""
    frequencies, phases = generator.uniform(0.15, 0.6, 3), generator.uniform(0.0, 6.28, 3)
    x, v = 0.0, 0.0
    for row in range(round(DURATION / STEP)):
        t = row * STEP
        force = 4.0 * float(np.sin(6.28 * frequencies * t + phases).sum()) + 1.0
        noise = generator.standard_normal(2) * NOISE
        yield run, f"{t:.2f}", f"{x + noise[0]:.4f}", f"{v + noise[1]:.4f}", f"{force:.3f}"
        for _ in range(SUBSTEPS):
            v += STEP / SUBSTEPS * acceleration(x, v, force)
            x += STEP / SUBSTEPS * v


def acceleration(x, v, force):
    """Of the cart, in m/s^2; the law changes where it touches the bumper."""
    touching = x > BUMPER
    rubber = STIFFNESS * (x - BUMPER) + RUBBER_DAMPING * v if touching else 0.0
    return (force - VISCOUS * v - DRY_FRICTION * np.sign(v) - rubber) / MASS


if __name__ == "__main__":
    main()
