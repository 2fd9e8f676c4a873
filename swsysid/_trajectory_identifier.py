"""`TrajectoryIdentifier`: identification from noisy recordings, without derivatives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from sklearn.base import BaseEstimator, MetaEstimatorMixin, clone

from swsysid._checkpoints import checkpointed
from swsysid._checks.estimators import check_fitted
from swsysid._checks.parameters import flag, verbosity
from swsysid._data.recordings import many_recordings
from swsysid._journal import handing_over
from swsysid._known.known import both_known, check_known
from swsysid._pipelines import seeded
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._rendering.progress import progress
from swsysid._stays.certainty import Certainty, certainty, told_in_modes
from swsysid._stays.condensed import Total, length_of, of_all
from swsysid._stays.given import Given, read_given, warn_of_turns
from swsysid._stays.identification import StayIdentification
from swsysid._stays.input_holds import hold_sentences, holds_of
from swsysid._stays.knowledge import Again, Knowledge, checked
from swsysid._stays.origin import Origin
from swsysid._stays.pieces import Pieces, between_jumps
from swsysid._stays.recording_report import reported
from swsysid._stays.samples import active_modes_of, states_of
from swsysid._stays.search import Search, check_estimator, check_order
from swsysid._stays.settings import StaySettings
from swsysid._stays.walk import Walk
from swsysid._stays.walking import walking
from swsysid._stays.weighted import weighted
from swsysid._verdict.comparison import Split
from swsysid._verdict.held_out import HeldOutTrajectories
from swsysid._verdict.judge import Asked, JudgedOnRecordings
from swsysid._whole_or_nothing import failing_in_words
from swsysid.exporting import ToOtherTools
from swsysid.refinement._rollout_score import rollout_score

_OF_MANY = 20_000  # samples of many recordings with which the first rounds are made


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
    known : Known or list of str, default=None
        What is known of the laws before, beside what `estimator` knows: values, missing terms,
        bounds, ties between modes, linear relations. It holds exactly, and `known_` says what the
        recordings would rather have.
    refine : bool, default=True
        Whole recordings are rolled out from one start. False ties every sample to the one before
        within 0.4 of the noise, and judges rollouts over stretches of some 30 samples: for chaotic
        systems, whose longer rollouts mean nothing.
    input_hold : {"auto", "linear", "zero", "next", "between"} or a sequence, default="auto"
        What the inputs, or each of them, do between two samples: they go on a line, keep their
        value until the next one, have had it since the one before (what a logger writes at the
        end of an interval), or step at an instant that is estimated. ``"auto"`` takes what is
        likeliest; ``"linear"`` where nothing steps.
    n_jobs : int, default=None
        Given to `estimator`, whose starts run side by side; the answer is the same for any.
    random_state : int, RandomState instance or None, default=None
        Given to `estimator` where that has none.
    verbose : int, default=0
        1 shows the rounds on standard error.
    checkpoint : str or path, default=None
        Folder of your own in which finished steps are kept: the same fit goes on from there after
        it was stopped, and ends with the same answer. `best_so_far` reads what it has until now.

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
    equation_noise_ : ndarray of shape (n_states,) or None
        What noise in the equation adds to the states in an interval, None where there is none.
    input_holds_ : tuple of str
        What each input does between two samples, as `input_hold`.
    coef_errors_ : ndarray of the shape of ``estimator_.coef_``
        Standard errors of the coefficients of the laws; 0 where fixed, infinite where the
        recordings tell nothing (rate and constant of a mode that rests). Of a coefficient on a
        bound it is that without the bound, to whose other side the interval does not reach.
    known_ : tuple of KnownCheck
        For each thing `known` what the recordings would rather have, with its p-value.
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
        known=None,
        refine=True,
        input_hold="auto",
        n_jobs=None,
        random_state=None,
        verbose=0,
        checkpoint=None,
    ):
        self.estimator = estimator
        self.order = order
        self.observed = observed
        self.known = known
        self.refine = refine
        self.input_hold = input_hold
        self.n_jobs = n_jobs
        self.random_state = random_state
        self.verbose = verbose
        self.checkpoint = checkpoint

    @checkpointed
    def fit(self, x, t=None, groups=None, inputs=None):
        """Identify the laws, the modes and the surface.

        Parameters
        ----------
        x : array-like of shape (n_samples, n_channels), or a list of recordings
            Measured states, NaN where a value is missing. A recording is a dict with ``t``, ``x``
            and, if there are any, ``inputs``; the other arguments are then left out. Or a list of
            tables, with lists of times and inputs. Or many recordings, which are read where they
            are worked on: a Dask bag of them, a list of delayed ones, or of functions without
            arguments that read one or several. Then `states_`, `switch_time_errors_` and `verdict_`
            are not known.
        t : array-like of shape (n_samples,), default=None
            Times, increasing within each recording; they may be uneven and differ in rate. Two
            rows at one time are the left and the right limit of an event.
        groups : array-like of shape (n_samples,), default=None
            Recording of each row. None is one recording, or several where the times begin anew.
        inputs : array-like of shape (n_samples, n_inputs), default=None
            Known at the samples; they jump at an event. `input_hold` says what they do in between.

        Returns
        -------
        self

        Raises
        ------
        ValueError, TypeError
            If a parameter or the data make no sense; the message says what to do.
        """
        order, estimator = check_order(self.order), check_estimator(self.estimator)
        known = both_known(check_known(estimator.known), check_known(self.known))
        many = many_recordings(x, self.n_jobs)
        if many is not None and any(one is not None for one in (t, groups, inputs)):
            raise ValueError("recordings have times and inputs; leave out t, groups and inputs.")
        if many is not None and known is not None:
            raise ValueError("known is held in recordings at hand; leave it out, or give lists.")
        if many is not None:
            x = many.some(_OF_MANY, length_of)
        given = read_given(x, t, groups, inputs)
        warn_of_turns(given)
        pieces = between_jumps(given)
        settings = self.settings.joined(flag("refine", self.refine))
        estimator = seeded(estimator, self.random_state).set_params(n_jobs=self.n_jobs)
        with progress(None, "rounds", bool(verbosity(self.verbose))) as bar:
            holds = holds_of(given, estimator, order, self.input_hold, settings)
            origin = Origin.of(given, estimator, order)
            counted = origin.counted(pieces.given).stepped(holds)
            options = settings, bar.update
            search = Search(
                estimator, counted, order, self.observed, *options,
                knowledge=Knowledge(known, origin),
            )  # fmt: skip
            with handing_over(lambda begun: origin.told(begun).model):
                found, total, walk = search.identified(), None, None
            if many is None:
                found, walk = walking(found, search)
                found = weighted(found, search, origin)
            else:
                found, total = of_all(found, many, origin, holds, order, *options)

            def again(left_out: frozenset[int]) -> StayIdentification:
                other = search.without(left_out, found)
                return weighted(other.identified(), other, origin)

            options = estimator, search.base.noise, settings, search.guard
            self.known_ = checked(found, Again(again, *options))
            found = origin.told(found if total is not None else told_in_modes(found))
        self._keep(given if total is None else None)
        self.input_holds_ = tuple(map(str, holds))
        sure = certainty(found, origin)
        if total is not None:
            sure = total.sure(found, sure)
        self._store(found, search, origin, pieces, sure, walk)
        self.estimator_.covariance_ = sure.covariance
        if total is not None:
            self._store_all(total)
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
        linear between their samples. ``n_draws`` asks for a band by `covariance_`.
        """
        return self._fitted.simulate(x0, t, inputs, **self._with_hold(options))

    @property
    def coef_(self):
        """Laws of the modes, those of `estimator_`."""
        return self._fitted.coef_

    @property
    def covariance_(self):
        """Of all coefficients, as `estimator_` has it; those on a bound stay there."""
        return self._fitted.covariance_

    def equations(self, precision=3, format="text"):
        """The law of every mode; as `SwitchingSystemRegressor.equations`."""
        return self._fitted.equations(precision, format)

    def surface_equations(self, precision=3, format="text"):
        """The surfaces and the modes beside them; as `equations`."""
        return self._fitted.surface_equations(precision, format)

    def to_hybrid_system(self):
        """Laws and surfaces as formulas; as `SwitchingSystemRegressor.to_hybrid_system`."""
        return self._fitted.to_hybrid_system().noted(self.report_)

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
        known = both_known(check_known(estimator.known), check_known(self.known))

        def fitted(rows, n_modes, whole, **options):
            asked = clone(estimator).set_params(**{"n_modes": n_modes, "known": known} | options)
            again = clone(self).set_params(
                estimator=asked, known=None, refine=whole, input_hold=self.input_holds_,
                verbose=0, checkpoint=None,
            )  # fmt: skip
            return again.fit(*given.data(rows))

        held_out = HeldOutTrajectories(self._stepped(given), split, fitted, order)
        return Asked(held_out, estimator.feature_library, estimator.n_modes)

    def _store(
        self, found: StayIdentification, search: Search, origin: Origin, pieces: Pieces,
        sure: Certainty, walk: Walk | None,
    ) -> None:  # fmt: skip
        given = search.given
        recordings = found.estimate.nodes.recordings
        self.estimator_, self.n_modes_ = found.model, len(found.estimate.laws.coef)
        states = origin.states(recordings.joined(states_of(found.estimate)))
        self.states_ = given.by_rows([states])
        self.modes_ = given.by_rows([active_modes_of(found.estimate)])
        stays = found.estimate.nodes.stays
        self.switch_times_, self.switch_time_errors_ = pieces.switches(stays, sure.instants)
        self.coef_errors_, self.surface_errors_ = sure.coef, sure.surface
        self.noise_ = (found.left if walk is None else walk.sensor)[: given.n_channels]
        self.equation_noise_ = None if walk is None else walk.walk
        self.mode_selection_, self.history_ = search.candidates, list(found.history)
        names = found.model.switching_model.feature_map.names_in
        held = hold_sentences(names, self.input_holds_, pieces.given, given)
        self.report_ = reported(search, found, sure, self.modes_, origin, held, self.known_, walk)

    def _store_all(self, total: Total) -> None:
        """What all of many recordings say, of some of which everything else is known."""
        del self.states_, self.switch_time_errors_
        self.modes_ = np.concatenate([one.modes for one in total.parts])
        self.switch_times_ = [one.switch_times for one in total.parts]
        self.noise_ = total.noise[: len(self.noise_)]
        self.report_ = replace(
            self.report_,
            n_recordings=len(total.parts),
            n_samples=len(self.modes_),
            n_switches=sum(map(len, self.switch_times_)),
            shares=np.bincount(self.modes_, minlength=self.n_modes_) / len(self.modes_),
            noise=self.noise_,
        )

    @property
    def _fitted(self) -> SwitchingSystemRegressor:
        check_fitted(self)
        return self.estimator_
