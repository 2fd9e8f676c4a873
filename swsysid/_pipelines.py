"""The switching regressor at the end of a pipeline, and copies of it with other parameters."""

from __future__ import annotations

from typing import Any

from sklearn.base import clone

__all__ = ["seeded", "switching_step", "with_parameters"]


def switching_step(estimator: Any) -> tuple[Any, Any]:
    """What happens to X before the switching regressor, and the regressor itself."""
    steps = getattr(estimator, "steps", None)
    if steps is None:
        return (lambda X: X), estimator
    if len(steps) == 1:
        return (lambda X: X), steps[-1][1]
    return estimator[:-1].transform, steps[-1][1]


def with_parameters(estimator: Any, **parameters: Any) -> Any:
    """A copy of the estimator whose switching regressor has other parameters."""
    copy = clone(estimator)
    switching_step(copy)[1].set_params(**parameters)
    return copy


def seeded(estimator: Any, random_state: Any) -> Any:
    """A copy of the estimator in which everything random that has no seed has this one."""
    copy = clone(estimator)
    unseeded = [
        name
        for name, value in copy.get_params().items()
        if name.split("__")[-1] == "random_state" and value is None
    ]
    return copy.set_params(**dict.fromkeys(unseeded, random_state))
