"""`refine` and `initial_states`: what a user calls."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Protocol, runtime_checkable

from numpy.typing import ArrayLike

from swsysid._checks.parameters import flag, one_of, verbosity, whole
from swsysid._known.checks import KnownCheck, checks
from swsysid._known.known import Known, known_laws
from swsysid._rendering.progress import progress
from swsysid._results import Array
from swsysid._simulation.model import FittedModel
from swsysid._stays.output_error import LOSSES
from swsysid._whole_or_nothing import failing_in_words
from swsysid.refinement._estimation import Estimation
from swsysid.refinement._known import RefinedFit
from swsysid.refinement._result import RefinementResult
from swsysid.refinement._stated import StatedModel
from swsysid.refinement._trajectories import Observed, Recording

_STAYS = "refine leaves surfaces as they are, or fits them with fit_surface=True"


@runtime_checkable
class Stateable(Protocol):
    """A model with more than laws and a surface, which can be written as a stated one."""

    def stated(self) -> StatedModel:
        """Itself as a stated model."""

    def with_numbers_of(self, stated: StatedModel) -> FittedModel:
        """A copy with the numbers of what `stated` has given."""


@failing_in_words
def refine(
    model: FittedModel | Stateable,
    trajectories: Recording | Iterable[Recording],
    *,
    observed: Observed | None = None,
    initial_states: ArrayLike | Mapping[str, float] | None = None,
    segment_length: int | None = None,
    loss: str = "linear",
    fit_surface: bool = False,
    free: ArrayLike | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    noise: ArrayLike | None = None,
    input_hold: str = "zero",
    joined: bool = True,
    held_out: Recording | Iterable[Recording] | None = None,
    known: Known | Sequence[str] | str | None = None,
    max_nfev: int = 100,
    verbose: int = 0,
) -> RefinementResult:
    """Improve the parameters of a model on the error of its rollouts.

    Parameters
    ----------
    model : SwitchingSystemRegressor, EffectRegressor or StatedModel
        Where to start. Coefficients that are zero stay zero. Of an EffectRegressor, such as the
        ``best_estimator_`` of a search for effects, `EffectRegressor.stated` is refined: numbers of
        its effects, which have to be functions of the present states and inputs, are named
        parameters.
    trajectories : dict, Trajectory, or list of them
        A dict has ``t``, ``x`` (the measured channels; NaN where a value is missing), ``inputs``
        if the model has any, and perhaps ``groups`` that name separate trajectories; the
        recordings of `swsysid.datasets` are such dicts.
    observed : sequence of str or int, default=None
        States that the columns of ``x`` measure; the others are hidden. None means all, or the
        output of a `StatedModel`.
    initial_states : dict or array-like, default=None
        Guess of the states at the first times, above all of hidden ones: (n_states,), or a row for
        each trajectory. By default measured states start as measured and hidden ones at 0.
    segment_length : int, default=None
        Number of samples in a segment. None takes a thirty-second of the data, or less where the
        start diverges. The length of the longest trajectory means single shooting.
    loss : {"linear", "soft_l1", "huber", "cauchy"}, default="linear"
        Loss of the squared residuals; all but ``"linear"`` discount outliers.
    fit_surface : bool, default=False
        Refine the coefficients of the surface too.
    free : array-like of bool, default=None
        Coefficients that may change, of the shape of ``coef_`` (of that of the `StatedModel` that
        an `EffectRegressor` is written as); None means those of a `StatedModel`, or all that are
        not zero. Of a law that was exact in the data, such as q' = v, none is free.
    bounds : dict of str to (low, high), default=None
        Bounds of named parameters.
    noise : array-like of shape (n_outputs,), default=None
        Standard deviations that weigh the channels against each other; None means those of the
        measured channels themselves.
    input_hold : {"zero", "linear"}, default="zero"
        Inputs between the samples.
    joined : bool, default=True
        False leaves the segments apart, each with an initial state of its own: for chaotic
        systems, whose long rollouts mean nothing.
    held_out : dict, Trajectory, or list of them, default=None
        Recordings that take no part. Where their rollouts become worse, the model is returned
        unchanged: what a law lacks is then taken up by numbers that mean something else.
    known : Known or list of str, default=None
        What is known of the laws: values, missing terms, ties, sums that are equal, bounds of
        single coefficients. It holds exactly, from a start that is brought to it, and ``known`` of
        the result says what the trajectories would rather have. Nothing of surfaces.
    max_nfev : int, default=100
        Largest number of batched integrations.
    verbose : int, default=0
        1 shows a bar of the integrations on standard error.

    Returns
    -------
    RefinementResult
        Never worse than the start on the rollouts of the training data.

    Raises
    ------
    ValueError, TypeError
        If the arguments make no sense; the message says what to do.

    Examples
    --------
    A decay of which two samples a time constant are measured:

    >>> import numpy as np
    >>> from swsysid.refinement import StatedModel, refine
    >>> t = np.linspace(0.0, 3.0, 7)
    >>> result = refine(StatedModel(None, [[-0.5]], states=["x"]), {"t": t, "x": np.exp(-2.0 * t)})
    >>> round(float(result.values[0]), 4)
    -2.0
    """
    _check(loss, input_hold, max_nfev, segment_length)
    with progress(max_nfev, "integrations", bool(verbosity(verbose))) as bar:
        stated, told = _of_laws_alone(model), known_laws(known, _STAYS)

        def asked(left_out: frozenset[int] = frozenset()) -> Estimation:
            return Estimation(
                stated,
                trajectories,
                observed=observed,
                initial_states=initial_states,
                segment_length=segment_length,
                loss=loss,
                fit_surface=flag("fit_surface", fit_surface),
                free=free,
                bounds=bounds,
                noise=noise,
                linear=input_hold == "linear",
                joined=flag("joined", joined),
                known=told,
                left_out=left_out,
                integrated=bar.update,
            )

        estimation = asked()
        result = estimation.refined(max_nfev)
        if told is not None:
            checked = _checked(estimation, result, asked, max_nfev)
            result = replace(result, known=checked)
        if held_out is not None and result.improved:
            before, after = (
                Estimation(
                    one,
                    held_out,
                    observed=observed,
                    loss=loss,
                    noise=noise,
                    linear=input_hold == "linear",
                    joined=joined,
                    frozen=True,
                ).refined(max_nfev)
                for one in (_of_laws_alone(model), result.model)
            )
            result = result.judged(before, after, _of_laws_alone(model), estimation.start)
    if not isinstance(model, Stateable):
        return result
    assert isinstance(result.model, StatedModel)
    return replace(result, model=model.with_numbers_of(result.model))


@failing_in_words
def initial_states(
    model: FittedModel | Stateable,
    trajectories: Recording | Iterable[Recording],
    *,
    observed: Observed | None = None,
    guess: ArrayLike | Mapping[str, float] | None = None,
    loss: str = "linear",
    noise: ArrayLike | None = None,
    input_hold: str = "zero",
    max_nfev: int = 100,
) -> Array:
    """States from which the rollouts of a model fit the beginning of trajectories best.

    A free run on new data needs the state at its first time, hidden states included: give the
    first few samples.

    Parameters
    ----------
    model, trajectories, observed, loss, noise, input_hold, max_nfev
        As in `refine`; no parameter of the model changes.
    guess : dict or array-like, default=None
        As `initial_states` of `refine`.

    Returns
    -------
    ndarray of shape (n_trajectories, n_states)

    Examples
    --------
    Position is measured, velocity is not:

    >>> import numpy as np
    >>> from swsysid.refinement import StatedModel, initial_states
    >>> model = StatedModel(None, [[0.0, 1.0], [-1.0, 0.0]], states=["q", "v"])
    >>> t = np.linspace(0.0, 0.5, 6)
    >>> initial_states(model, {"t": t, "x": np.sin(t)}, observed=["q"]).round(4) + 0.0
    array([[0., 1.]])
    """
    _check(loss, input_hold, max_nfev, None)
    estimation = Estimation(
        _of_laws_alone(model),
        trajectories,
        observed=observed,
        initial_states=guess,
        loss=loss,
        noise=noise,
        linear=input_hold == "linear",
        frozen=True,
    )
    return estimation.initial_states(max_nfev)


def _of_laws_alone(model: FittedModel | Stateable) -> FittedModel:
    return model.stated() if isinstance(model, Stateable) else model


def _checked(
    estimation: Estimation,
    result: RefinementResult,
    asked: Callable[[frozenset[int]], Estimation],
    max_nfev: int,
) -> tuple[KnownCheck, ...]:
    """What trajectories would rather have of each thing known."""
    region = estimation.region
    assert region is not None
    done = {frozenset[int](): (estimation, result)}

    def fit(left_out: frozenset[int]) -> RefinedFit:
        if left_out not in done:
            other = asked(left_out)
            done[left_out] = other, other.refined(max_nfev)
        other, refined = done[left_out]
        return other.fit_beside(refined.model, region.touched, fit)

    return checks(fit(frozenset()), region)


def _check(loss, input_hold, max_nfev, segment_length) -> None:
    one_of("loss", loss, LOSSES)
    one_of("input_hold", input_hold, ("zero", "linear"))
    whole("max_nfev", max_nfev)
    whole("segment_length", segment_length, also=(None,))
