"""What the tools report on the same automata, with where it is told; data, nothing is computed.

Recordings and starts are theirs: between ten and fifteen noise-free ones of 1000 to 10,000 samples.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["DAINARX", "NOISE", "SOURCE", "Reported"]

SOURCE = (
    "Yu et al.: Derivative-agnostic inference of nonlinear hybrid systems, HSCC 2026, "
    "arXiv 2507.16426; noise-free, configured by hand for each case; a public run of its code "
    "(pengqianhan/Dainarx-pq, result/batch_20260223_180924/summary.md), to four decimals; a zero "
    "is one of these"
)
NOISE = (
    "that code ends in an error in 32 of 35 cases "
    "(result/batch_20260402_142042_noise0.05/summary.md of the same repository)"
)


@dataclass(frozen=True)
class Reported:
    """Figures of a tool on held-out recordings.

    Attributes
    ----------
    modes : int
        Too many or too few.
    instants : float
        Largest error of a switch instant, in time.
    mean, largest : float
        Deviations, relative to the largest value of each state.
    seconds : float
    """

    modes: int
    instants: float
    mean: float
    largest: float
    seconds: float


DAINARX = {
    "bouncing ball": Reported(0, 0.0, 0.0, 0.0, 3.67),
    "excitable cell": Reported(0, 0.01, 0.0002, 0.0176, 18.01),
    "tanks with valves": Reported(0, 0.01, 0.0007, 0.0177, 9.54),
    "buck converter": Reported(0, 0.0, 0.0, 0.0, 7.06),
    "thermostat": Reported(0, 0.02, 0.0007, 0.0102, 3.00),
    "three-state automaton": Reported(0, 0.0, 0.0, 0.0, 2.99),
    "two-state automaton": Reported(0, 0.0, 0.0, 0.0, 2.70),
    "variable heating": Reported(0, 0.03, 0.0005, 0.0200, 5.96),
    "relay and PID loop": Reported(0, 0.0, 0.0, 0.0, 10.37),
    "one-legged jumper": Reported(0, 0.0, 0.0, 0.0, 6.99),
    "two tanks": Reported(0, 0.0, 0.0, 0.0, 13.12),
    "Duffing oscillator": Reported(0, 0.001, 0.0, 0.0003, 20.04),
    "predator and prey": Reported(0, 0.02, 0.0006, 0.0047, 2.63),
}
