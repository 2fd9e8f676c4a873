r"""`suggest_experiment`: which recording to make next.

A recording says of the parameters :math:`\theta` what its rollout shows of them in units of the
noise, :math:`S = J^\top J` with its own start eliminated from the derivatives J. What is known so
far and one recording more leave the covariance :math:`(S_0 + S)^{-1}`, whatever is measured there:
it can be told before the recording is made.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swsysid._checks.parameters import one_of, shown
from swsysid._results import Array
from swsysid._simulation.model import FittedModel, fitted_system
from swsysid._stays.arrow import covariance_of
from swsysid._whole_or_nothing import failing_in_words
from swsysid.refinement._estimation import Estimation
from swsysid.refinement._parameters import System
from swsysid.refinement._stated import StatedModel
from swsysid.refinement._trajectories import Observed, Recording

_TURNS = 100  # integrations until starts of recordings are found
_LEAST = 1e-12  # of the information about a parameter, the least that counts: rounding
_FEWEST = 2  # samples of a rollout


@runtime_checkable
class Identified(Protocol):
    """A model of recordings, with errors and noise."""

    estimator_: FittedModel
    coef_errors_: Array
    noise_: Array


@dataclass(frozen=True)
class Suggestion:
    """What each of some recordings would tell.

    Attributes
    ----------
    best : int
        The candidate that tells most.
    order : ndarray of shape (n_candidates,), int
        All of them, the best first.
    names : list of str
        The parameters, as `refine` names them.
    before : ndarray of shape (n_parameters,)
        Their standard errors now.
    after : ndarray of shape (n_candidates, n_parameters)
        The same with one recording more; infinite where nothing tells.
    apart : ndarray of shape (n_candidates,) or None
        By how many standard deviations the nearest rival would differ from the model there, that
        fitted anew.
    about : list of str
        The parameters that the order goes by; empty where it goes by rivals.
    """

    order: NDArray[np.intp]
    names: list[str]
    before: Array
    after: Array
    apart: Array | None
    about: list[str]

    @property
    def best(self) -> int:
        """The candidate that tells most."""
        return int(self.order[0])

    def __str__(self) -> str:
        told = f"Record candidate {self.best}"
        if self.apart is not None:
            return f"{told}: rivals would be {self.apart[self.best]:.3g} standard deviations apart."
        lines = [f"{told}; standard errors would go"]
        width = max(map(len, self.about))
        for name in self.about:
            k = self.names.index(name)
            lines.append(
                f"  {name:<{width}}  from {self.before[k]:.2g} to {self.after[self.best, k]:.2g}"
            )
        return "\n".join(lines)


@failing_in_words
def suggest_experiment(
    found: FittedModel | Identified,
    candidates: Sequence[Mapping[str, ArrayLike]],
    recordings: Recording | Iterable[Recording],
    *,
    about: str | Sequence[str] | None = None,
    rivals: Sequence[FittedModel] = (),
    observed: Observed | None = None,
    noise: ArrayLike | None = None,
    input_hold: str = "zero",
) -> Suggestion:
    """Say which of some recordings that could be made would tell most.

    Each candidate is simulated by the model. Of all it is the one with the least determinant of
    the covariance of the parameters (D-optimal), that of some with `about`, or with `rivals` the
    one in which the nearest of these would differ most.

    Parameters
    ----------
    found : TrajectoryIdentifier, SwitchingSystemRegressor or StatedModel
        With its parameters at their best values. Free are coefficients whose errors are not zero,
        or those that `refine` takes for free, and the surface where it has coefficients.
    candidates : list of dict
        Each with ``t``, ``x0`` (the start, (n_states,)) and, if the model has inputs, ``inputs``.
    recordings : dict, Trajectory, or list of them
        Those that `found` was identified from, as `refine` takes them.
    about : str or sequence of str, default=None
        Names of parameters, or how they begin: ``"mode 0: v', x"``, ``"mode 0"``, ``"surface"``.
    rivals : sequence of models, default=()
        Models of the same states and inputs, to be told apart from `found`.
    observed : sequence of str or int, default=None
        As in `refine`.
    noise : array-like of shape (n_outputs,), default=None
        Standard deviations of what is measured; None is ``found.noise_``.
    input_hold : {"zero", "linear"}, default="zero"
        Inputs between the samples.

    Returns
    -------
    Suggestion

    Raises
    ------
    ValueError, TypeError
        If a candidate, a name or the noise makes no sense; the message says what to do.

    Examples
    --------
    The rate of a decay is told best where it has fallen to a third:

    >>> import numpy as np
    >>> from swsysid.refinement import StatedModel, suggest_experiment
    >>> model = StatedModel(None, [[-1.0]], states=["x"])
    >>> recorded = {"t": np.array([0.0, 0.1]), "x": np.array([[1.0], [0.9]])}
    >>> candidates = [{"t": np.array([0.0, end]), "x0": [1.0]} for end in (0.1, 1.3, 5.0)]
    >>> suggestion = suggest_experiment(model, candidates, recorded, noise=0.01)
    >>> suggestion.best, suggestion.before.round(3), suggestion.after[suggestion.best].round(3)
    (1, array([0.149]), array([0.029]))
    """
    model = found.estimator_ if isinstance(found, Identified) else found
    if noise is None:
        if not isinstance(found, Identified):
            raise ValueError("noise is not known of this model; give what is measured its noise.")
        noise = found.noise_
    if not len(candidates):
        raise ValueError("candidates is empty; give recordings that could be made.")
    one_of("input_hold", input_hold, ("zero", "linear"))
    asked = partial(Estimation, observed=observed, noise=noise, linear=input_hold == "linear")
    starts = asked(model, recordings, frozen=True).initial_states(_TURNS)
    free = found.coef_errors_ > 0.0 if isinstance(found, Identified) else None
    asked = partial(asked, free=free, fit_surface=System(fitted_system(model)).linear is not None)
    now = asked(model, recordings, initial_states=starts)
    known, names = _information(now.told()[0]), now.parameters.names
    chosen = _chosen(about, names)
    after, values, apart = [], [], []
    for number, candidate in enumerate(candidates):
        ahead = [
            asked(model, [_simulated(one, candidate, number, input_hold)],
                  initial_states=candidate["x0"]).told()
            for one in (model, *rivals)
        ]  # fmt: skip
        matrix = known + _information(ahead[0][0])
        after.append(_errors(matrix))
        values.append(_log_volume(matrix, chosen))
        apart.append([_left(known, *of_rival) for of_rival in ahead[1:]])
    nearest = np.array(apart).min(axis=1) if len(rivals) else None
    order = np.argsort(values if nearest is None else -nearest, kind="stable")
    listed = [names[k] for k in chosen] if nearest is None else []
    return Suggestion(order, names, _errors(known), np.array(after), nearest, listed)


def _chosen(about: str | Sequence[str] | None, names: list[str]) -> list[int]:
    """Numbers of the parameters that are asked about."""
    begins = [""] if about is None else [about] if isinstance(about, str) else list(about)
    for one in begins:
        if not isinstance(one, str) or not any(name.startswith(one) for name in names):
            raise ValueError(
                f"about={shown(one)} is no parameter and begins none; there are {', '.join(names)}."
            )
    return [k for k, name in enumerate(names) if name.startswith(tuple(begins))]


def _simulated(model: FittedModel, candidate: object, number: int, input_hold: str) -> Recording:
    """What a model would show of a candidate, as far as it gets."""
    if not isinstance(candidate, Mapping) or not {"t", "x0"} <= set(candidate):
        raise ValueError(f"candidate {number} must be a dict with t, x0 and, if any, inputs.")
    t, inputs = candidate["t"], candidate.get("inputs")
    done = fitted_system(model).simulate(candidate["x0"], t, inputs, input_hold=input_hold)
    n, stated = len(done.t), model if isinstance(model, StatedModel) else None
    if n < _FEWEST:
        raise ValueError(f"candidate {number} diverges at once; start it elsewhere.")
    u = None if inputs is None else np.asarray(inputs, dtype=float)[:n]
    x = done.x if stated is None else stated.measure(done.x, u)
    return {"t": done.t, "x": x, "inputs": u}


def _information(slopes: Array) -> Array:
    return np.asarray(slopes.T @ slopes)


def _errors(information: Array) -> Array:
    return np.sqrt(np.diag(covariance_of(information)))


def _log_volume(information: Array, chosen: list[int]) -> float:
    """Logarithm of the determinant of the covariance of some parameters."""
    diagonal = np.diag(information)
    matrix = information + np.diag(_LEAST * np.where(diagonal > 0.0, diagonal, 1.0))
    unit = np.sqrt(np.diag(matrix))
    scaled, others = matrix / unit[:, None] / unit, np.delete(np.arange(len(unit)), chosen)
    both = [np.linalg.slogdet(one)[1] for one in (scaled[np.ix_(others, others)], scaled)]
    return float(both[0] - both[1] - 2.0 * np.log(unit[chosen]).sum())


def _left(known: Array, slopes: Array, difference: Array) -> float:
    """What parameters that move as far as is known do not explain, in standard deviations."""
    right = slopes.T @ difference
    matrix = known + _information(slopes)
    explained = right @ np.linalg.lstsq(matrix, right, rcond=None)[0]
    return max(0.0, float(difference @ difference - explained)) ** 0.5
