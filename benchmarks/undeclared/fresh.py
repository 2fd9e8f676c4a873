"""Searches on plants, sizes, sampling rates and noises that no constant of the library was set on.

Everything about a record is drawn from its number: the plant and its parameters, what is missing
(nothing, an effect, a shape or a disturbance without a name), 400 to 20,000 rows, half to twice the
usual sampling rate, and 1 to 20 % noise on the velocities; or, in one of three, no velocities but
states with 0.3 to 3 % noise.
"""

from __future__ import annotations

import time
import warnings
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from sklearn.base import clone

from benchmarks.goals import Goal
from benchmarks.markdown import table
from benchmarks.results import origins
from benchmarks.undeclared.cells import effects_found, is_right, recorded, rival_is_right
from benchmarks.undeclared.fresh_plants import FRESH_PLANTS
from benchmarks.undeclared.unlisted import verdict
from swsysid import EffectSearchCV
from swsysid.datasets import unlisted_kinds
from swsysid.datasets._undeclared.make import planted_record
from swsysid.datasets._undeclared.records import Plant
from swsysid.datasets._undeclared.simulation import reference_run
from swsysid.effects import UnknownFunction, UnmeasuredDisturbance

__all__ = ["Drawn", "fresh_counts", "fresh_tables", "run_drawn", "run_fresh"]

# Ranges that are drawn from, all of them on a logarithmic scale.
ROWS, RATES, NOISES, STATE_NOISES = (400, 20_000), (0.5, 2.0), (0.01, 0.2), (0.003, 0.03)
TRAJECTORIES = (4, 6, 8, 12)
# What is missing: nothing, a listed effect, or what has no name.
MISSING, CHANCES = ("nothing", "listed", "unlisted"), (0.25, 0.5, 0.25)
RECORDINGS = 1 / 3
# A mode with fewer of the samples could not be declared; more switches are a sliding mode.
SMALLEST_MODE, MOST_SWITCHES = 0.15, 0.15
# With more of the samples in stays as short as this a plant slides along its guard now and then,
# where it obeys neither of the declared laws: such records are counted apart.
SHORT_STAY, MOST_IN_SHORT_STAYS = 3, 0.05
# Without the effect the error is larger by less than this: nothing worth finding.
INVISIBLE = 1.05
UNKNOWN = (UnknownFunction.kind, UnmeasuredDisturbance.kind)


@dataclass(frozen=True)
class Drawn:
    """One record, before it is made."""

    plant: Plant
    missing: str
    kind: str | None
    n_samples: int
    n_trajectories: int
    rate: float
    noise: float
    is_recording: bool
    seed: int

    @classmethod
    def of(cls, number: int) -> Drawn:
        """The record of a number."""
        rng = np.random.RandomState([16, number])

        def between(limits: tuple[float, float]) -> float:
            return float(np.exp(rng.uniform(*np.log(limits))))

        name = str(rng.choice(list(FRESH_PLANTS)))
        rate, n_samples = between(RATES), round(between(ROWS))
        plant = _declarable(name, rate, rng)
        missing = str(rng.choice(MISSING, p=CHANCES))
        kinds = {"nothing": [None], "listed": plant.kinds, "unlisted": unlisted_kinds()}[missing]
        kind = kinds[rng.randint(len(kinds))]
        is_recording = bool(rng.uniform() < RECORDINGS) and not plant.discrete
        noise = between(STATE_NOISES if is_recording else NOISES)
        n_trajectories = int(rng.choice(TRAJECTORIES))
        seed = int(rng.randint(2**31 - 1))
        return cls(plant, missing, kind, n_samples, n_trajectories, rate, noise, is_recording, seed)

    @property
    def slides(self) -> bool:
        """True of a plant that slides along its guard for a part of the time."""
        if self.plant.discrete:
            return False
        return in_short_stays(reference_run(self.plant).modes) > MOST_IN_SHORT_STAYS

    def record(self):
        """What `make_undeclared` returns, of this plant."""
        return planted_record(
            self.plant,
            self.kind if self.missing == "listed" else None,
            unlisted=self.kind if self.missing == "unlisted" else None,
            n_samples=self.n_samples,
            n_trajectories=self.n_trajectories,
            noise=0.0 if self.is_recording else self.noise,
            random_state=self.seed,
        )


def _declarable(name: str, rate: float, rng: np.random.RandomState) -> Plant:
    """A plant that spends some time in each mode and does not switch all the time."""
    while True:
        plant = FRESH_PLANTS[name](rng, rate)
        modes = reference_run(plant).modes
        shares = np.bincount(modes.ravel(), minlength=plant.n_modes) / modes.size
        switches = np.mean(np.diff(modes, axis=0) != 0)
        if shares.min() >= SMALLEST_MODE and switches <= MOST_SWITCHES:
            return plant


def in_short_stays(modes: np.ndarray) -> float:
    """Share of the samples (n_times, n_trajectories) in stays that begin and end within a few."""
    in_short = 0
    for trajectory in modes.T:
        stays = np.diff(np.flatnonzero(np.diff(trajectory)))  # but for the first and the last
        in_short += int(stays[stays <= SHORT_STAY].sum())
    return in_short / modes.size


def run_fresh(number: int) -> list[dict]:
    """The record of one search in the record of a number."""
    return [{"cell": number, **run_drawn(Drawn.of(number))}]


def run_drawn(drawn: Drawn) -> dict:
    """What one search says, and whether it is right."""
    data = drawn.record()
    known = {"t": data.t, "groups": data.groups}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        start = time.process_time()
        search = EffectSearchCV(data.estimator)
        if drawn.is_recording:
            states, inputs = recorded(data, drawn.seed % 1000, drawn.noise)
            search.fit(states, inputs=inputs, **known)
        else:
            search.fit(data.X, data.Xdot, **known)
        seconds = time.process_time() - start
        declared = clone(data.estimator).fit(data.X, data.Xdot)
    test, first = data.test, [f"{one.kind} of {one.place}" for one in search.effects_]
    found = search.predict(test.X, t=test.t, groups=test.groups)
    errors = [_error(found, test), _error(declared.predict(test.X), test)]
    return {
        "plant": drawn.plant.name,
        "missing": drawn.missing,
        "kind": drawn.kind,
        "rows": drawn.n_samples,
        "rate": drawn.rate,
        "noise": drawn.noise,
        "is_recording": drawn.is_recording,
        "slides": drawn.slides,
        "found": first,
        "rivals": [[rival.kind for rival in one.rivals] for one in search.effects_],
        "doubts": [list(one.doubts) for one in search.effects_],
        "verdict": _verdict(search, data, drawn),
        "visible": _visible_of(data, drawn),
        "errors": errors,
        "told_change": _told_change(search),
        "effects": effects_found(search),
        "seconds": seconds,
    }


def _verdict(search, data, drawn: Drawn) -> str:
    """One word for what was found."""
    if drawn.missing == "nothing":
        return "false alarm" if search.effects_ else "right"
    if drawn.missing == "unlisted":
        return verdict(search.effects_, data.unlisted)
    if not search.effects_:
        return "missed"
    first = search.effects_[0]
    if is_right(first, data) or rival_is_right(first, data):
        return "right"
    return "unknown" if first.kind in UNKNOWN else "wrong name"


def _visible_of(data, drawn: Drawn) -> float | None:
    """None where nothing is missing, of states, and of a jump, which is in no velocity."""
    if drawn.missing == "nothing" or drawn.is_recording or drawn.kind == "reset":
        return None
    return _visible(data, drawn.plant)


def _error(found, test) -> float:
    """Root mean square of what is wrong on fresh records, relative to each velocity's spread."""
    wrong = (found - test.Xdot_clean) / test.Xdot_clean.std(axis=0)
    return float(np.sqrt(np.mean(wrong**2)))


def _told_change(search) -> float:
    """Of the report: the error on the rows held out at the end, over that at the start."""
    steps = [np.array(step["held_out"]) for step in search.report_.errors]
    before, after = steps[0], steps[-1]
    moved = before > 0  # an exact equation has nothing to say
    return float(np.sqrt(np.mean((after[moved] / before[moved]) ** 2))) if moved.any() else 1.0


def _visible(data, plant: Plant) -> float:
    """Error of the declared law over that of the true one, each given its true modes."""
    return _oracle(data, plant, is_declared=True) / _oracle(data, plant, is_declared=False)


def _oracle(data, plant: Plant, is_declared: bool) -> float:
    parts = []
    for part in (data, data.test):
        *x, u = part.X.T
        declared = np.column_stack(plant.features(np.column_stack(x), u))
        features = declared if is_declared else part.structure
        parts.append((features, part.declared_modes if is_declared else part.modes, part.Xdot))
    (features, modes, Xdot), (test_features, test_modes, test_Xdot) = parts
    squares = 0.0
    for mode in np.unique(test_modes):
        rows, here = modes == mode, test_modes == mode
        coef = np.linalg.lstsq(features[rows], Xdot[rows], rcond=None)[0]
        wrong = test_Xdot[here] - test_features[here] @ coef
        squares += float(np.sum((wrong / Xdot.std(axis=0)) ** 2))
    return float(np.sqrt(squares / test_Xdot.size))


# -- what is kept of the records, and its table ---------------------------------------------------

# Groups of records that are told apart.
ASKED = {
    "all": lambda one: True,
    "velocities, noise below 5 %": lambda one: not one["is_recording"] and one["noise"] < 0.05,
    "velocities, noise above 5 %": lambda one: not one["is_recording"] and one["noise"] >= 0.05,
    "recordings, noise below 1 %": lambda one: one["is_recording"] and one["noise"] < 0.01,
    "recordings, noise above 1 %": lambda one: one["is_recording"] and one["noise"] >= 0.01,
    "fewer than 2000 rows": lambda one: one["rows"] < 2000,
    "more than 6000 rows": lambda one: one["rows"] > 6000,
}


def fresh_counts(records: list[dict]) -> dict:
    """Verdicts of each group of records, and what was wrong; those that slide are apart."""
    steady = [one for one in records if not one["slides"]]
    sliding = [one for one in records if one["slides"]]
    groups = {name: [one for one in steady if asked(one)] for name, asked in ASKED.items()}
    counts = {
        name: {missing: _counted(own, missing) for missing in MISSING}
        for name, own in groups.items()
    }
    seconds = [one["seconds"] for one in records]
    return {
        "counts": counts,
        "plants": dict(sorted(Counter(one["plant"] for one in records).items())),
        "never_worse": sum(one["told_change"] <= 1.0 for one in records),
        "of": len(records),
        "seconds": [float(np.median(seconds)), max(seconds)],
        "wrong": [_line(one) for one in steady if one["verdict"] != "right"],
        "sliding": len(sliding),
        "wrong_where_it_slides": [_line(one) for one in sliding if one["verdict"] != "right"],
    }


def _counted(records: Iterable[dict], missing: str) -> dict[str, int]:
    """How many got each verdict; one that was missed and could not be seen is `too small`."""
    return dict(
        Counter(
            "too small" if one["verdict"] == "missed" and _is_invisible(one) else one["verdict"]
            for one in records
            if one["missing"] == missing
        )
    )


def _is_invisible(one: dict) -> bool:
    return one["visible"] is not None and one["visible"] < INVISIBLE


def _line(one: dict) -> str:
    where = f"{one['plant']}, record {one['cell']}, {one['rows']} rows, noise {one['noise']:.1%}"
    of = " of the states" if one["is_recording"] else ""
    seen = "" if one["visible"] is None else f" (visible: {one['visible']:.2f})"
    found = ", ".join(one["found"]) or "nothing"
    return f"{where}{of}: {one['kind'] or 'nothing'}{seen}; found {found}"


def fresh_tables(parts: dict[str, dict]) -> str:
    """Shares of each group beside their goals, then what was found where it is not right."""
    found = parts["searches"]
    head = ["records", "listed effect right", "wrong name", "missed", "too small to see"]
    head += ["no name: right", "wrong name", "too small to see", "false alarms"]
    rows = [[name, *_shares(counts)] for name, counts in found["counts"].items()]
    lines = [*table(head, rows, "l" + "r" * (len(head) - 1)), ""]
    never, of = found["never_worse"], found["of"]
    verdict_of = Goal(at_least=1.0, percent=True).verdict(never / of)
    lines += [f"Error at the end not above that at the start: {never} of {of}, {verdict_of}.", ""]
    told = ", ".join(f"{name} {count}" for name, count in found["plants"].items())
    median, largest = found["seconds"]
    lines += [f"Records: {told}. CPU seconds, median and largest: {median:.1f} and {largest:.0f}."]
    lines += ["", "What was missing and what was found where they differ:", ""]
    lines += [f"- {line}" for line in found["wrong"]] or ["Nothing."]
    return "\n".join([*lines, *_sliding(found), "", origins(parts)]) + "\n"


def _sliding(found: dict) -> list[str]:
    """Records of plants that slide, beside the table."""
    wrong, of = found["wrong_where_it_slides"], found["sliding"]
    if not of:
        return []
    told = f"Of {of} more records, whose plants slide along their guards for a part of the time, "
    return ["", f"{told}{of - len(wrong)} are right.", "", *(f"- {line}" for line in wrong)]


def _shares(counts: dict[str, dict[str, int]]) -> list[str]:
    listed, unlisted, clean = (counts[name] for name in ("listed", "unlisted", "nothing"))
    n_listed, n_unlisted, n_clean = (sum(own.values()) for own in (listed, unlisted, clean))
    wrong = listed.get("wrong name", 0)
    return [
        f"{listed.get('right', 0)}/{n_listed}",
        str(wrong),
        str(listed.get("missed", 0)),
        str(listed.get("too small", 0)),
        f"{unlisted.get('right', 0)}/{n_unlisted}",
        str(unlisted.get("wrong name", 0)),
        str(unlisted.get("too small", 0)),
        f"{clean.get('false alarm', 0)}/{n_clean}",
    ]
