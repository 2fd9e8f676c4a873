"""Which of some stated models a training record prefers, by free runs over stretches held out."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from benchmarks.measured.rows import Run
from swsysid.refinement import RefinementResult, StatedModel, refine


def blocks(n_samples: int, n_blocks: int, n_start: int = 0) -> list[slice]:
    """Stretches of equal length that make up a record, but for the samples that tell its start."""
    ends = np.linspace(0, n_samples, n_blocks + 1).astype(int)
    ends[0] = n_start
    return [slice(first, end) for first, end in zip(ends[:-1], ends[1:], strict=True)]


def held_out_errors(
    models: Mapping[str, StatedModel | Sequence[StatedModel]],
    record: Mapping,
    held: Iterable[slice],
    options: Callable[[StatedModel], Mapping] = lambda model: {},
) -> dict[str, float]:
    """Error of every model on stretches whose output counts as missing while it is refined.

    The free run goes through the whole record; the inputs of a held stretch are known, as those
    of a test record are. What else the refinement of a model asks for, its `options` say. Of
    several starts of a model the one counts that fits best what is seen.
    """
    return {
        name: float(np.sqrt(np.mean([_error(one, record, part, options) ** 2 for part in held])))
        for name, one in models.items()
    }


def best_start(
    starts: StatedModel | Sequence[StatedModel],
    record: Mapping,
    options: Callable[[StatedModel], Mapping],
) -> RefinementResult:
    """The refinement that fits a record best, of several starts."""
    listed = [starts] if isinstance(starts, StatedModel) else starts
    refined = [refine(one, record, **options(one)) for one in listed]
    return min(refined, key=lambda one: float(np.sum(one.rmse_after)))


def best_of(errors: Mapping[str, float]) -> str:
    """The name with the smallest error."""
    return min(errors, key=errors.__getitem__)


def told(errors: Mapping[str, float], unit: str) -> str:
    """The errors in words, for the table."""
    return ", ".join(f"{name} {error:.3g} {unit}" for name, error in errors.items())


def free_run(result: RefinementResult, start, record: Mapping, **options) -> np.ndarray:
    """What the sensor of a refined model reads on a record, from a start."""
    inputs = record["inputs"]
    run = result.model.simulate(start, record["t"], inputs, **options)
    return result.model.measure(run.x, inputs[: len(run.x)])[:, 0]


def _error(
    starts: StatedModel | Sequence[StatedModel],
    record: Mapping,
    block: slice,
    options: Callable[[StatedModel], Mapping],
) -> float:
    x = np.array(record["x"], dtype=float).reshape(len(record["t"]), -1)
    seen = x.copy()
    seen[block] = np.nan
    result = best_start(starts, {**record, "x": seen}, options)
    asked = options(result.model)
    hold = {name: asked[name] for name in ("input_hold",) if name in asked}
    simulated = free_run(result, result.initial_states[0], record, rtol=1e-4, atol=1e-6, **hold)
    return Run(simulated[: block.stop][block], x[block, 0]).error()
