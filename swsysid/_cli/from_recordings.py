"""The model as the recordings themselves tell it; derivatives are where it starts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sklearn.base import clone

from swsysid._cli.recorded import Recorded
from swsysid._cli.samples import Samples
from swsysid._cli.settings import RECORDINGS
from swsysid._cli.verdict import relative_error
from swsysid._data.matching import best_matching, contingency
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._results import Array, SolverError
from swsysid._stays.settings import StaySettings
from swsysid._trajectory_identifier import TrajectoryIdentifier


@dataclass(frozen=True)
class FromRecordings:
    """Laws, modes and instants of highest likelihood, with their standard errors."""

    identifier: TrajectoryIdentifier
    whole: bool  # rollouts over whole trajectories; else over stretches
    modes: NDArray[np.intp]  # of the rows of the samples
    labels: list[object]  # of the trajectories

    @property
    def model(self) -> SwitchingSystemRegressor:
        """The identified model."""
        return self.identifier.estimator_

    def names_of_modes(self, modes: NDArray[np.intp]) -> NDArray[np.intp]:
        """How the modes of another model of the same rows are called here."""
        n_modes = self.identifier.n_modes_
        joint = contingency(modes, self.modes, shape=(n_modes, n_modes))
        return np.asarray(best_matching(joint)[1], dtype=np.intp)

    @property
    def excess(self) -> Array:
        """What the rollouts leave, in units of the noise that neighbouring samples show."""
        return _excess(self.identifier)


class _Identifier(TrajectoryIdentifier):
    """From one start: what a second one takes, somebody waits for."""

    settings = StaySettings(stretches=(1.0,))


def identify_recordings(
    model: SwitchingSystemRegressor,
    samples: Samples,
    *,
    order: int,
    n_jobs: int | None,
    verbose: bool,
) -> tuple[FromRecordings | None, str]:
    """What the recordings say of as many modes as `model` has; if nothing, why not."""
    recorded = samples.recorded
    if recorded is None or samples.t is None:
        return None, ""
    is_plain = model.feature_library is None or isinstance(model.feature_library, int)
    most = RECORDINGS.most_samples if is_plain else RECORDINGS.most_of_pipelines
    if len(recorded.t) > most:
        fewer = -(-len(recorded.t) // most)
        return None, (
            f"Identified from derivatives: rollouts of more than {most:,} samples of these terms "
            f"take long (--decimate {fewer} makes them fewer)."
        )
    try:
        identifier, whole = _fitted(model, samples, recorded, order, n_jobs, verbose)
    except (ValueError, SolverError) as error:
        return None, f"Identified from derivatives: {error}"
    predicted = identifier.predict_modes(samples.frame)
    shown = min(identifier.n_modes_, 1 if (predicted == predicted[0]).all() else model.n_modes_)
    if shown < model.n_modes_:
        return None, (
            "Identified from derivatives: the trajectories themselves show "
            f"{shown} of {model.n_modes_} modes."
        )
    excess = _excess(identifier)
    if (excess > RECORDINGS.hopeless).any():
        worst = int(np.argmax(excess))
        return None, (
            "Identified from derivatives: over stretches of 30 samples rollouts leave "
            f"{excess[worst]:.2g} times the noise of {samples.names[worst]}; a term, a mode or an "
            "effect is missing (--diagnose looks for it)."
        )
    left, before = _left(identifier.estimator_, samples), _left(model, samples)
    if (excess > RECORDINGS.noise_alone).any() and left > RECORDINGS.worse * before:
        return None, (
            "Identified from derivatives: the laws that follow the trajectories best miss their "
            "derivatives, and so lack something."
        )
    modes = recorded.at(samples.t, samples.groups, identifier.modes_, predicted)
    return FromRecordings(identifier, whole, modes, recorded.labels), ""


def _fitted(
    model: SwitchingSystemRegressor,
    samples: Samples,
    recorded: Recorded,
    order: int,
    n_jobs: int | None,
    verbose: bool,
) -> tuple[TrajectoryIdentifier, bool]:
    """Stretches first: laws that lack something are bent by long rollouts, which take long too."""
    import pandas as pd

    n_states = recorded.states.shape[1]
    x = pd.DataFrame(recorded.states, columns=list(samples.names[:n_states]))
    inputs = None
    if recorded.inputs.shape[1]:
        inputs = pd.DataFrame(recorded.inputs, columns=list(samples.names[order * n_states :]))
    data = x, recorded.t, recorded.groups, inputs
    options = {"order": order, "n_jobs": n_jobs, "verbose": int(verbose)}
    estimator = clone(model).set_params(n_modes=model.n_modes_, verbose=0)
    stretches = _Identifier(estimator, refine=False, **options).fit(*data)
    if (_excess(stretches) > RECORDINGS.noise_alone).any():
        return stretches, False
    whole = _Identifier(estimator, **options).fit(*data)
    if (_excess(whole) > RECORDINGS.noise_alone).any() or whole.n_modes_ != stretches.n_modes_:
        return stretches, False
    return whole, True


def _left(model: SwitchingSystemRegressor, samples: Samples) -> float:
    """What a model leaves of the derivatives that are not known."""
    errors = (samples.Xdot - model.predict(samples.frame))[:, samples.n_known :]
    return relative_error(errors, samples.Xdot[:, samples.n_known :].std(axis=0))


def _excess(identifier: TrajectoryIdentifier) -> Array:
    report = identifier.report_
    return report.noise / report.noise_of_differences
