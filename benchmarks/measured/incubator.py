"""Heated box under a thermostat: a law of first order, and a heater that has to warm up itself.

The free run begins with the first sample of the record; its first half trains, its second half,
through which the run goes on without another look at the box, is the test.
"""

from __future__ import annotations

from benchmarks.measured.choice import free_run
from benchmarks.measured.rows import FreeRun, Run
from swsysid.datasets import fetch_incubator
from swsysid.refinement import ParametricLibrary, StatedModel, refine

READABLE = 0.38  # K, of its makers' two heat capacities: measured with the data, not published
BOX, BED, INPUTS = "box", "bed", ["room", "heater"]
# In 1/s, and K/s for the power of the heater, whose watts these data do not tell.
LOSS, POWER, PASSED = 0.003, 0.1, 0.01
# Differences of temperatures, and the heater: the unit of the bed is that of the box.
TERMS = {
    "box - room": lambda box, room: box - room,
    "bed - box": lambda box, bed: bed - box,
    "heater": lambda heater: heater,
}


def rows() -> list[FreeRun]:
    """Free run of the box on the second half of the record, in K."""
    record = fetch_incubator().thermostat
    half = len(record.t) // 2
    runs = [_free_run(model, record, half) for model in (_first_order(), _with_a_bed())]
    before, after = ([run] for run in runs)
    name, change = "incubator, box, K", "the heater's own temperature"
    return [FreeRun.of_runs(name, change, before, after, readable=(READABLE,))]


def _first_order() -> StatedModel:
    terms = {name: TERMS[name] for name in ("box - room", "heater")}
    library = ParametricLibrary(terms, [BOX, *INPUTS])
    return StatedModel(library, [[-LOSS, POWER]], states=[BOX], inputs=INPUTS)


def _with_a_bed() -> StatedModel:
    law = [[-LOSS, PASSED, 0.0], [0.0, -PASSED, POWER]]
    return StatedModel(
        ParametricLibrary(TERMS, [BOX, BED, *INPUTS]), law, states=[BOX, BED], inputs=INPUTS
    )


def _free_run(model: StatedModel, record, half: int) -> Run:
    train = {name: record[name][:half] for name in ("t", "x", "inputs")}
    cold = {BED: float(record.x[0, 0])} if model.coef_.shape[1] > 1 else None
    result = refine(model, train, observed=[BOX], initial_states=cold)
    return Run(free_run(result, result.initial_states[0], record)[half:], record.x[half:])
