"""The switching regressor at the end of a pipeline, and copies of it with other parameters."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from sklearn.base import BaseEstimator, clone
from sklearn.pipeline import Pipeline
from sklearn.utils.metaestimators import available_if

from swsysid._results import Array

Transform = Callable[[Array], Array]


def steps_before(estimator: Any) -> Pipeline | None:
    """The steps of a pipeline before its last one, None if there are none."""
    return estimator[:-1] if len(getattr(estimator, "steps", ())) > 1 else None


def switching_step(estimator: Any) -> tuple[Transform, Any]:
    """What happens to X before the switching regressor, and the regressor itself."""
    steps = getattr(estimator, "steps", None)
    if steps is None:
        return _unchanged, estimator
    before = steps_before(estimator)
    return _unchanged if before is None else before.transform, steps[-1][1]


def _unchanged(X: Array) -> Array:
    return X


def with_parameters(estimator: BaseEstimator, **parameters: object) -> BaseEstimator:
    """A copy of the estimator whose switching regressor has other parameters."""
    copy = clone(estimator)
    switching_step(copy)[1].set_params(**parameters)
    return copy


def seeded(estimator: BaseEstimator, random_state: int | np.random.RandomState) -> BaseEstimator:
    """A copy for fits within a fit: what has no seed has this one, and no checkpoint is its own."""
    copy = clone(estimator)
    own = [(name.split("__")[-1], name, value) for name, value in copy.get_params().items()]
    unseeded = [name for last, name, value in own if last == "random_state" and value is None]
    kept = [name for last, name, _ in own if last == "checkpoint"]
    return copy.set_params(**dict.fromkeys(unseeded, random_state), **dict.fromkeys(kept))


def _last_step_has(method: str):
    return available_if(lambda pipeline: hasattr(pipeline.steps[-1][1], method))


class ModePipeline(Pipeline):
    """A pipeline of scikit-learn's whose modes can be asked for as those of its last step.

    A plain `Pipeline` that ends in a `SwitchingSystemRegressor` predicts velocities only; here
    ``predict_modes``, ``predict_mode_proba`` and ``mode_velocities`` transform `X` first, as
    ``predict`` does. They exist where the last step has them.

    Parameters
    ----------
    steps, transform_input, memory, verbose
        As in `sklearn.pipeline.Pipeline`.

    Examples
    --------
    >>> from sklearn.preprocessing import StandardScaler
    >>> from swsysid import ModePipeline, SwitchingSystemRegressor
    >>> from swsysid.datasets import make_damped_oscillator
    >>> data = make_damped_oscillator(n_samples=500, random_state=0)
    >>> switching = SwitchingSystemRegressor(n_modes=2, feature_library=1, random_state=0)
    >>> model = ModePipeline([("scale", StandardScaler()), ("switching", switching)])
    >>> model.fit(data.X, data.Xdot).predict_modes(data.X).shape
    (500,)
    """

    @_last_step_has("predict_modes")
    def predict_modes(self, X):
        """Mode of every sample according to the surface, shape (n_samples,)."""
        transform, switching = switching_step(self)
        return switching.predict_modes(transform(X))

    @_last_step_has("predict_mode_proba")
    def predict_mode_proba(self, X):
        """Probability of every mode, shape (n_samples, n_modes)."""
        transform, switching = switching_step(self)
        return switching.predict_mode_proba(transform(X))

    @_last_step_has("mode_velocities")
    def mode_velocities(self, X):
        """Velocity of every mode at every sample, shape (n_modes, n_samples, n_states)."""
        transform, switching = switching_step(self)
        return switching.mode_velocities(transform(X))
