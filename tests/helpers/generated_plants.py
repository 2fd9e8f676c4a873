"""Generated plants: random laws, guards, jumps, noise and rates, recorded and identified.

A seed draws a plant of one of four kinds: a law on each side of a line, laws between which guards
change with memory, the same with a jump, and one law with impacts. The oracle is what was planted:
free rollouts of what was identified leave at most 1.5 times the noise of the samples, or it is said
that they do not.
"""

import warnings
from dataclasses import dataclass

import numpy as np

from swsysid import (
    HybridAutomaton,
    HybridAutomatonRegressor,
    IdentificationWarning,
    SwitchingSystemRegressor,
    TrajectoryIdentifier,
)

__all__ = ["Generated", "generated", "unsaid"]

KINDS = ("sides", "memory", "jump", "impact")
MOST_LEFT = 1.5  # times the noise, by what may be left without a word
STATES = ["x", "v"]


@dataclass(frozen=True)
class Generated:
    """A plant, and its recordings with noise."""

    kind: str
    plant: HybridAutomaton
    degree: int  # of its laws
    recordings: list[dict]
    noise: np.ndarray  # (2,)

    def estimator(self):
        """What is asked to identify it, told the kind of the plant and no number."""
        if self.kind == "sides":
            laws = SwitchingSystemRegressor(2, feature_library=self.degree, random_state=0)
            return TrajectoryIdentifier(laws)
        n_modes = 1 if self.kind == "impact" else 2
        return HybridAutomatonRegressor(n_modes, feature_library=self.degree, random_state=0)


def generated(seed: int) -> Generated:
    """The plant of a seed; one whose rollouts end early or never switch is drawn again."""
    rng = np.random.default_rng(seed)
    while True:
        kind = KINDS[rng.integers(len(KINDS))]
        degree = int(rng.choice([1, 1, 1, 3]))
        plant = _plant(kind, degree, rng)
        t = np.arange(int(rng.integers(60, 120))) * rng.choice([0.05, 0.08, 0.12])
        runs = [plant.simulate(x0, t, mode=mode) for x0, mode in _starts(kind, plant, rng)]
        whole = all(len(run.t) == len(t) and len(run.events) < 15 for run in runs)
        if whole and sum(len(run.events) for run in runs) >= 8:
            break
    x = [run.x for run in runs]
    noise = rng.choice([0.002, 0.005, 0.01]) * np.vstack(x).std(axis=0)
    noisy = [one + noise * rng.standard_normal(one.shape) for one in x]
    return Generated(kind, plant, degree, [{"t": t, "x": one} for one in noisy], noise)


def _plant(kind, degree, rng):
    laws = [_law(degree, rng) for _ in range(1 if kind == "impact" else 2)]
    if kind == "impact":
        back = f"{-rng.uniform(0.6, 0.95):.3f} v"
        laws = [{"x": "v", "v": f"{-rng.uniform(3.0, 10.0):.3f} - {rng.uniform(0, 0.2):.3f} v"}]
        return HybridAutomaton.stated(laws, [(0, 0, "x <= 0", {"v": back})], states=STATES)
    line = f"x + {rng.uniform(-1.0, 1.0):.3f} v" if rng.random() < 0.5 else "x"
    middle = rng.uniform(-0.3, 0.3)
    gap = 0.0 if kind == "sides" else rng.uniform(0.2, 0.5)
    jump = [{"v": f"{rng.uniform(0.6, 0.9):.3f} v"}] if kind == "jump" else []
    guards = [
        (0, 1, f"{line} >= {middle + gap:.3f}", *jump), (1, 0, f"{line} <= {middle - gap:.3f}"),
    ]  # fmt: skip
    return HybridAutomaton.stated(laws, guards, states=STATES)


def _law(degree, rng):
    """An oscillator about a point of its own."""
    stiffness, damping = rng.uniform(1.0, 6.0), rng.uniform(0.0, 0.3)
    force = f"{rng.uniform(-0.6, 0.6):.3f} - {stiffness:.3f} x - {damping:.3f} v"
    return {"x": "v", "v": force + (f" - {rng.uniform(0.2, 1.5):.3f} x^3" if degree > 1 else "")}


def _starts(kind, plant, rng):
    for _ in range(6):
        if kind == "impact":
            yield [rng.uniform(1.0, 3.0), rng.uniform(-1.0, 1.0)], 0
        else:
            angle, radius = rng.uniform(-0.9, 0.9), rng.uniform(1.0, 2.5)
            yield [-radius * np.cos(angle), radius * np.sin(angle)], 0


def unsaid(one: Generated) -> str | None:
    """What free rollouts leave above `MOST_LEFT` times the noise where nothing was said of it."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model = one.estimator().fit(one.recordings)
    said = [str(w.message) for w in caught if issubclass(w.category, IdentificationWarning)]
    if said or not model.report_.rollouts.holds:
        return None
    left, first = [], 0
    for recording in one.recordings:
        t, x = recording["t"], recording["x"]
        mode = {} if one.kind == "sides" else {"mode": int(model.modes_[first])}
        run = model.simulate(model.states_[first], t, **mode)
        if len(run.t) < len(t):
            return f"{one.kind}: a rollout ends at {run.t[-1]:.3g} of {t[-1]:.3g}"
        left.append((run.x - x) / one.noise)
        first += len(t)
    size = np.sqrt(np.mean(np.square(np.vstack(left)), axis=0))
    return f"{one.kind}: {size} times the noise" if size.max() > MOST_LEFT else None
