"""`TrajectoryIdentifier`: identification from noisy recordings, without derivatives."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator, MetaEstimatorMixin, clone

from swsysid._checks.estimators import check_fitted
from swsysid._checks.parameters import flag, verbosity
from swsysid._data.recordings import Hold
from swsysid._pipelines import seeded
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._rendering.progress import progress
from swsysid._stays.certainty import certainty
from swsysid._stays.given import Given, read_given, warn_of_turns
from swsysid._stays.identification import StayIdentification
from swsysid._stays.input_holds import with_steps
from swsysid._stays.origin import Origin
from swsysid._stays.pieces import Pieces, between_jumps
from swsysid._stays.recording_report import reported
from swsysid._stays.samples import active_modes_of, states_of
from swsysid._stays.search import Search, check_estimator, check_order
from swsysid._stays.settings import StaySettings
from swsysid._stays.weighted import weighted
from swsysid._verdict.comparison import Split
from swsysid._verdict.held_out import HeldOutTrajectories
from swsysid._verdict.judge import Asked, JudgedOnRecordings
from swsysid._whole_or_nothing import failing_in_words, whole_or_nothing
from swsysid.exporting import ToOtherTools
from swsysid.refinement._rollout_score import rollout_score


class TrajectoryIdentifier(JudgedOnRecordings, ToOtherTools, MetaEstimatorMixin, BaseEstimator):
    r"""Identify a switching system from recordings: noisy states, no derivatives.

    With the stays in the modes given, laws, states, switch instants and surfaces of highest
    likelihood are

    .. math::

        \min_{C, s, \tau, a} \; \tfrac12 \sum_i \Big\| \frac{y_i - x(t_i; C, s, \tau)}{\sigma}
        \Big\|^2 \quad \text{with} \quad \dot x = C_j \Phi(x, u) \text{ in mode } j,
        \quad f_a(x(\tau)) = 0,

    a smooth problem in which noise is where it was measured. It alternates with the two other steps
    of the paper: the modes are assigned (the most likely ones of a Kalman filter that may switch,
    the surface as its prior), and the classifier of `estimator` is fitted to the estimated states.
    It starts from `estimator` fitted to differentiated recordings.

    Parameters
    ----------
    estimator : SwitchingSystemRegressor, default=None
        Library, number of modes, surface, sparsity, and the start. None is
        ``SwitchingSystemRegressor()``. ``n_modes="auto"`` chooses the number by an information
        criterion of the measurements.
    order : {1, 2}, default=1
        1: the columns of x are the states. 2: they are positions; the states are positions and
        speeds, and the library needs every speed as a column.
    observed : sequence of str or int, default=None
        States that are measured. None means all; hidden states are refused with what to do.
    refine : bool, default=True
        Whole recordings are rolled out from one start. False ties every sample to the one before
        within 0.4 of the noise, and judges rollouts over stretches of some 30 samples: for chaotic
        systems, whose longer rollouts mean nothing.
    n_jobs : int, default=None
        Given to `estimator`, whose starts run side by side; the answer is the same for any.
    random_state : int, RandomState instance or None, default=None
        Given to `estimator` where that has none.
    verbose : int, default=0
        1 shows the rounds on standard error.

    Attributes
    ----------
    estimator_ : SwitchingSystemRegressor
        With the laws and surfaces found; predicts, simulates and prints.
    modes_ : ndarray of shape (n_samples,), int
        Mode of every sample, in the order of the data. Where a recording slides along a surface, as
        friction at rest does, the mode with the larger share.
    states_ : ndarray of shape (n_samples, n_states)
        States without noise.
    switch_times_ : list of ndarray
        Instants at which each recording switches, or begins and ends to slide along a surface.
    switch_time_errors_ : list of ndarray
        Their standard errors.
    noise_ : ndarray of shape (n_channels,)
        Standard deviation of the noise of each column of x.
    input_holds_ : tuple of str
        What each input does between two samples: ``"linear"`` on a line, ``"zero"`` it keeps its
        value until the next one, ``"between"`` it steps at an instant that is estimated.
    coef_errors_ : ndarray of the shape of ``estimator_.coef_``
        Standard errors of the coefficients of the laws; 0 where fixed, infinite where the
        recordings tell nothing (rate and constant of a mode that rests).
    surface_errors_ : ndarray of the shape of ``estimator_.surface_.coef_`` or None
        Standard errors of the coefficients of the surfaces, the largest of each held; None for
        one mode and for a classifier without coefficients.
    n_modes_ : int
    mode_selection_ : list of CountCandidate
        The candidates of ``n_modes="auto"``, empty otherwise.
    history_ : list of StayRecord
        The rounds of the alternation.
    report_ : RecordingReport
        What was found, as text; its ``rollouts`` are what free rollouts of the model leave of the
        recordings, modes told by its own surface, and which of the switches they make.
    verdict_ : SwitchingVerdict
        Whether the modes are to be believed: what they leave of recordings held out, beside smooth
        laws of one mode. It takes some fits more, made when it is first asked for.

    See Also
    --------
    SwitchingSystemRegressor : From states and velocities.
    swsysid.refinement.refine : Maximum likelihood for any model, hidden states included.

    Examples
    --------
    A mass on a spring that is softer on one side; its position and speed are recorded with noise.

    >>> import numpy as np
    >>> from swsysid import SwitchingSystemRegressor, TrajectoryIdentifier
    >>> from swsysid.refinement import StatedModel, StatedSurface
    >>> plant = StatedModel(
    ...     None, [[[0, 1], [-1, -0.1]], [[0, 1], [-4, -0.1]]],
    ...     states=["x", "v"], surface=StatedSurface([[0, 1, 0]], 1),
    ... )
    >>> t = np.linspace(0, 10, 201)
    >>> rng = np.random.default_rng(0)
    >>> runs = [plant.simulate(start, t).x for start in ([1, 1], [-2, 0], [1.5, -1])]
    >>> recordings = [{"t": t, "x": run + 0.01 * rng.standard_normal(run.shape)} for run in runs]
    >>> estimator = SwitchingSystemRegressor(sparsity="auto", random_state=0)
    >>> found = TrajectoryIdentifier(estimator).fit(recordings)
    >>> for equation in sorted(line[8:] for line in found.estimator_.equations(precision=1)):
    ...     print(equation)
    x0' = 1.0 x1
    x0' = 1.0 x1
    x1' = -1.0 x0 - 0.1 x1
    x1' = -4.0 x0 - 0.1 x1

    No smooth law does as well:

    >>> found.verdict_
    SwitchingVerdict(SWITCHES, n_modes=2, trusted)
    """

    #: Sizes and limits that a fit takes for granted; a subclass may have others.
    settings = StaySettings()

    def __init__(
        self,
        estimator=None,
        *,
        order=1,
        observed=None,
        refine=True,
        n_jobs=None,
        random_state=None,
        verbose=0,
    ):
        self.estimator = estimator
        self.order = order
        self.observed = observed
        self.refine = refine
        self.n_jobs = n_jobs
        self.random_state = random_state
        self.verbose = verbose

    @whole_or_nothing
    def fit(self, x, t=None, groups=None, inputs=None):
        """Identify the laws, the modes and the surface.

        Parameters
        ----------
        x : array-like of shape (n_samples, n_channels), or a list of recordings
            Measured states, NaN where a value is missing. A recording is a dict with ``t``, ``x``
            and, if there are any, ``inputs``; the other arguments are then left out. Or a list of
            tables, with lists of times and inputs.
        t : array-like of shape (n_samples,), default=None
            Times, increasing within each recording; they may be uneven and differ in rate. Two
            rows at one time are the left and the right limit of an event.
        groups : array-like of shape (n_samples,), default=None
            Recording of each row. None is one recording, or several where the times begin anew.
        inputs : array-like of shape (n_samples, n_inputs), default=None
            Linear between the samples; they jump at an event. One that is constant by pieces keeps
            its value until the next sample, or steps at an instant in between, if that is clearly
            likelier (`input_holds_`).

        Returns
        -------
        self

        Raises
        ------
        ValueError, TypeError
            If a parameter or the data make no sense; the message says what to do.
        """
        order, estimator = check_order(self.order), check_estimator(self.estimator)
        given = read_given(x, t, groups, inputs)
        warn_of_turns(given)
        pieces = between_jumps(given)
        settings = self.settings.joined(flag("refine", self.refine))
        estimator = seeded(estimator, self.random_state).set_params(n_jobs=self.n_jobs)
        with progress(None, "rounds", bool(verbosity(self.verbose))) as bar:
            origin = Origin.of(given, estimator, order)
            counted = origin.counted(pieces.given)
            search = Search(estimator, counted, order, self.observed, settings, bar.update)
            held = with_steps(search)
            if held.given is not counted:
                search = Search(
                    estimator, held.given, order, self.observed, settings, bar.update,
                    known=held.found,
                )  # fmt: skip
            found = origin.told(weighted(search.identified(), search, origin))
        self._keep(given)
        self.input_holds_ = tuple(map(str, held.holds))
        self._store(found, search, origin, pieces)
        return self

    def predict(self, X):
        """Velocity of the active mode at states (and inputs), (n_samples, n_states)."""
        return self._fitted.predict(X)

    def predict_modes(self, X):
        """Mode at states (and inputs), shape (n_samples,)."""
        return self._fitted.predict_modes(X)

    def simulate(self, x0, t, inputs=None, **options):
        """Roll the identified system out; as `SwitchingSystemRegressor.simulate`.

        Inputs keep their value until the next sample if all of them did so in `fit`; else they are
        linear between their samples.
        """
        fitted, held = self._fitted, {Hold.ROW} == set(self._holds)
        hold = Hold.ROW if held else Hold.LINE
        return fitted.simulate(x0, t, inputs, **({"input_hold": str(hold)} | options))

    def to_hybrid_system(self):
        """Laws and surfaces as formulas; as `SwitchingSystemRegressor.to_hybrid_system`."""
        return self._fitted.to_hybrid_system()

    @failing_in_words
    def score(self, x, t=None, groups=None, inputs=None):
        """Coefficient of determination of rollouts of recordings that were held out.

        Each rollout begins where it fits the first samples of its recording best; the score is the
        mean over the channels. That of velocities would hardly see a wrong mode.

        Parameters
        ----------
        x, t, groups, inputs
            As in `fit`.

        Returns
        -------
        float
            1 is perfect; not above 0 is no better than the mean. Minus infinity where a rollout
            diverges.
        """
        model, given = self._fitted, between_jumps(read_given(x, t, groups, inputs)).given
        return rollout_score(model, self._stepped(given))

    def set_params(self, **params):
        """Set parameters, those of the default estimator (``estimator__n_modes``) included."""
        nested = any(key.startswith("estimator__") for key in params)
        if nested and params.get("estimator", self.estimator) is None:
            params = {"estimator": SwitchingSystemRegressor()} | params
        return super().set_params(**params)

    # -- parts of fit ------------------------------------------------------------------------

    def _asked(self, given: Given, split: Split) -> Asked:
        order = check_order(self.order)
        estimator = seeded(check_estimator(self.estimator), self.random_state)

        def fitted(rows, n_modes, whole, **options):
            asked = clone(estimator).set_params(n_modes=n_modes, **options)
            again = clone(self).set_params(estimator=asked, refine=whole, verbose=0)
            return again.fit(*given.data(rows))

        held_out = HeldOutTrajectories(self._stepped(given), split, fitted, order)
        return Asked(held_out, estimator.feature_library, estimator.n_modes)

    def _stepped(self, given: Given) -> Given:
        """With the limits of inputs that keep their value until the next row."""
        if given.n_inputs != len(self._holds):
            return given
        known = [Hold.ROW if one == Hold.ROW else Hold.LINE for one in self._holds]
        return given.stepped(known)

    def _store(
        self, found: StayIdentification, search: Search, origin: Origin, pieces: Pieces
    ) -> None:
        given, sure = search.given, certainty(found, origin)
        recordings = found.estimate.nodes.recordings
        self.estimator_, self.n_modes_ = found.model, len(found.estimate.laws.coef)
        states = origin.states(recordings.joined(states_of(found.estimate)))
        self.states_ = given.by_rows(_split(states, given))
        self.modes_ = given.by_rows(_split(active_modes_of(found.estimate), given))
        stays = found.estimate.nodes.stays
        self.switch_times_, self.switch_time_errors_ = pieces.switches(stays, sure.instants)
        self.coef_errors_, self.surface_errors_ = sure.coef, sure.surface
        self.noise_ = found.left[: given.n_channels]
        self.mode_selection_, self.history_ = search.candidates, list(found.history)
        holds = [Hold(one) for one in self.input_holds_]
        self.report_ = reported(search, found, sure, self.modes_, origin, holds)

    @property
    def _holds(self) -> tuple[str, ...]:
        """What inputs do between samples; of models that were saved before it was told, nothing."""
        return vars(self).get("input_holds_", ())

    @property
    def _fitted(self) -> SwitchingSystemRegressor:
        check_fitted(self)
        return self.estimator_


def _split(rows: NDArray, given: Given) -> list[NDArray]:
    """Rows of each recording."""
    return np.split(rows, np.cumsum([len(part) for part in given.rows])[:-1])
