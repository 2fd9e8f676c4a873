"""The model as the recordings themselves tell it; derivatives are where it starts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sklearn.base import clone

from swsysid._cli.recorded import Recorded
from swsysid._cli.samples import Samples
from swsysid._cli.settings import RECORDINGS
from swsysid._data.matching import best_matching
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
        joint = np.zeros((n_modes, n_modes))
        np.add.at(joint, (modes, self.modes), 1.0)
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
    if len(recorded.t) > RECORDINGS.most_samples:
        fewer = -(-len(recorded.t) // RECORDINGS.most_samples)
        return None, (
            f"Identified from derivatives: rollouts of more than {RECORDINGS.most_samples:,} samples "
            f"take long (--decimate {fewer} makes them fewer)."
        )
    try:
        identifier, whole = _fitted(model, samples, recorded, order, n_jobs, verbose)
    except (ValueError, SolverError) as error:
        return None, f"Identified from derivatives: {error}"
    if identifier.n_modes_ != model.n_modes_:
        return None, (
            "Identified from derivatives: the trajectories themselves show "
            f"{identifier.n_modes_} of {model.n_modes_} modes."
        )
    modes = recorded.at(
        samples.t, samples.groups, identifier.modes_, identifier.predict_modes(samples.frame)
    )
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


def _excess(identifier: TrajectoryIdentifier) -> Array:
    report = identifier.report_
    return report.noise / report.noise_of_differences
