"""`HybridAutomatonRegressor`: hybrid automata from noisy recordings."""

from __future__ import annotations

import warnings

import numpy as np
from sklearn.base import BaseEstimator, clone

from swsysid._automaton.model import HybridAutomaton
from swsysid._automaton.rollouts import band_of
from swsysid._automaton_search import continuous, sampled
from swsysid._automaton_search.answer import IdentifiedAutomaton
from swsysid._automaton_search.crossed import GuardTerms
from swsysid._automaton_search.doubts import strays, untold_switches
from swsysid._automaton_search.held_out import HeldOutAutomata
from swsysid._automaton_search.judged import rollout_score
from swsysid._automaton_search.report import AutomatonReport
from swsysid._checkpoints import checkpointed
from swsysid._checks.arrays import table
from swsysid._checks.estimators import check_fitted
from swsysid._checks.parameters import flag, verbosity, whole
from swsysid._data.trajectories import places_along
from swsysid._known.known import OF_TRANSITIONS, known_laws
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._rendering.progress import progress
from swsysid._results import GuardWarning, MisfitWarning
from swsysid._stays.given import Given, read_given
from swsysid._stays.input_holds import hold_sentences, holds_of
from swsysid._stays.search import check_order
from swsysid._stays.settings import StaySettings
from swsysid._trajectory_identifier import TrajectoryIdentifier
from swsysid._verdict.comparison import Split
from swsysid._verdict.held_out import HeldOutTrajectories
from swsysid._verdict.judge import Asked, JudgedOnRecordings
from swsysid._verdict.words import AUTOMATON
from swsysid._whole_or_nothing import failing_in_words
from swsysid.exporting import ToOtherTools


class HybridAutomatonRegressor(JudgedOnRecordings, ToOtherTools, BaseEstimator):
    r"""Identify a hybrid automaton from recordings: guards that remember, states that jump.

    A `SwitchingSystemRegressor` has one surface between two modes, whichever way it is crossed. An
    automaton has transitions: mode i is left for mode j where the guard :math:`f_{ij}` of states,
    inputs, dwell (the time since the mode was entered) and time rises to zero, and the state may
    jump there. Three steps find it.

    1. *Stays.* With the modes of the samples given, laws, states and switch instants of highest
       likelihood are a smooth problem; with the laws given, the modes are decoded. No surface is
       asked, so the modes may have memory.
    2. *Resets.* Across each switch the law before is followed forwards and the one after backwards,
       and a component of the state that cannot have gone on gets an affine reset of few terms, by
       least absolute deviations.
    3. *Guards.* Each transition i -> j gets the polynomial of fewest columns with

       .. math::

           \min_a \tfrac12 \sum_k \Big( \frac{f_a(c_k)}{|\dot f_a(c_k)| \sigma_k} \Big)^2
           + \tfrac12 \sum_l \Big( \frac{\max(0, f_a(c_l))}{|\dot f_a(c_l)| \sigma} \Big)^2,

       the first sum over its switches, where it is zero, the second over the samples of mode i,
       where it is below zero: the side information of the paper's margin program (section IV),
       measured as time.
    4. *Together.* Laws, guards, resets and starts of highest likelihood, by multiple shooting
       through events and jumps: the instants are those of the automaton's own guards.

    Parameters
    ----------
    n_modes : int or "auto", default="auto"
        "auto" takes the number at which another mode no longer pays, up to `max_modes`.
    order : {1, 2}, default=1
        2 says that the states are positions and their second derivatives obey the laws: speeds are
        states that nobody measures, and jump where a position turns (an impact in a video).
    lags : int or "auto", default=0
        In discrete time: samples before the present one that laws and guards see. "auto" takes the
        fewest whose rollouts of held-out stretches are about as good as any, in each mode.
    discrete_time : bool, default=False
        The laws give the next state instead of the velocity (switched ARX, NARX); dwell and time
        count steps, and a guard is zero anywhere between two samples: it has the largest margin to
        both (the paper's margin program), or is a threshold at a number of few digits that hardly
        lies between them by chance. With noise, modes ask the guards in turn.
    feature_library : None, int, transformer or PySINDy library, default=1
        Features of the laws, as for `SwitchingSystemRegressor`; 1 is affine laws.
    guard_degree : int, default=1
        Degree of the guards.
    sparsity : None, float or "auto", default=None
        Whether the laws leave out terms, as for `SwitchingSystemRegressor`; in continuous time.
    max_modes : int, default=6
    n_jobs : int, default=None
        Starts that run side by side; the answer is the same for any.
    refine : bool, default=True
        In continuous time with noise: refine laws, guards and resets together at last, by multiple
        shooting through events and jumps. It is left out where rollouts of the recordings become
        worse.
    input_hold : {"auto", "linear", "zero", "next", "between"} or a sequence, default="auto"
        What the inputs, or each of them, do between two samples, as of `TrajectoryIdentifier`. In
        discrete time every row acts.
    known : Known or list of str, default=None
        What is known of the laws before, as for `TrajectoryIdentifier`. In discrete time terms
        have names such as ``x0[k]``.
    random_state : int, RandomState instance or None, default=None
    verbose : int, default=0
        1 shows the rounds on standard error.
    checkpoint : str or path, default=None
        Folder of your own in which finished steps are kept: the same fit goes on from there after
        it was stopped, and ends with the same answer. `best_so_far` reads what it has until now.

    Attributes
    ----------
    automaton_ : HybridAutomaton
        What was found; it simulates, prints and can be written to files.
    coef_ : ndarray of shape (n_modes, n_states, n_features_out)
        Laws of the modes, the most populated one first.
    transitions_ : tuple of Transition
        Source, target, guard, reset and support of each.
    n_modes_ : int
    modes_ : ndarray of shape (n_samples,), int
        Mode of every sample, in the order of the data.
    states_ : ndarray of shape (n_samples, n_states)
        States without noise.
    switch_times_ : list of ndarray
        Instants at which each recording switches.
    noise_ : ndarray of shape (n_channels,)
        What the laws leave of the measured states: noise of the sensor.
    equation_noise_ : ndarray of shape (n_states,) or None
        What noise in the equation adds to the states in an interval, None where there is none.
    input_holds_ : tuple of str
        What each input does between two samples; nothing in discrete time.
    coef_errors_ : ndarray of the shape of ``coef_``
        Standard errors of the laws: 0 where fixed, infinite where the recordings tell nothing.
    guard_errors_ : tuple of ndarray
        Of the coefficients of the guard of each transition; the one that sets its scale has none.
        In discrete time those of anywhere between the nearest samples on both sides.
    reset_errors_ : tuple of ndarray or None
        Of offset and matrix of the reset of each transition, (n_states, 1 + n_states).
    verdicts_ : list of TransitionVerdict
        How well each guard tells its switches.
    mode_selection_ : list
        The candidates of ``n_modes="auto"``.
    refinement_ : AutomatonRefinement or None
        What `refine` gained, and standard errors of laws, guards and resets; None where there was
        nothing to refine: no noise, or no transition.
    known_ : tuple of KnownCheck
        For each thing `known` what the recordings would rather have, by the laws of the stays.
    report_ : AutomatonReport
    verdict_ : SwitchingVerdict
        Whether the modes are to be believed, as that of `TrajectoryIdentifier`.

    See Also
    --------
    TrajectoryIdentifier : One surface between modes, from recordings.
    HybridAutomaton : The model, also to be stated by hand.

    Examples
    --------
    A heater that turns off at 22 degrees and on again at 18:

    >>> import numpy as np
    >>> from swsysid import HybridAutomaton, HybridAutomatonRegressor
    >>> plant = HybridAutomaton.stated(
    ...     [{"T": "-0.1 (T - 30)"}, {"T": "-0.1 (T - 10)"}],
    ...     [(0, 1, "T >= 22"), (1, 0, "T <= 18")],
    ...     states=["T"],
    ... )
    >>> t = np.arange(0, 30, 0.1)
    >>> recordings = [{"t": t, "x": plant.simulate([T], t, mode=0).x} for T in (15, 17, 19)]
    >>> found = HybridAutomatonRegressor(random_state=0).fit(recordings)
    >>> print("\n".join(found.equations(precision=2)))
    mode 0: x0' = 3.00 - 0.10 x0
    mode 1: x0' = 1.00 - 0.10 x0
    mode 0 -> 1 where x0 >= 22.00
    mode 1 -> 0 where x0 <= 18.00

    A ball in a video: heights of frames, 30 a second, two millimetres of noise.

    >>> ball = HybridAutomaton.stated(
    ...     [{"h": "v", "v": "-9.81"}], [(0, 0, "h <= 0", {"v": "-0.8 v"})], states=["h", "v"]
    ... )
    >>> t = np.arange(0, 3, 1 / 30)
    >>> heights = ball.simulate([1.4, 0.0], t, mode=0).x[:, :1]
    >>> heights += 0.002 * np.random.default_rng(0).standard_normal(heights.shape)
    >>> found = HybridAutomatonRegressor(order=2, feature_library=1).fit(heights, t)
    >>> [impact] = found.transitions_
    >>> impact.reset.matrix.round(2)
    array([[ 1. ,  0. ],
           [ 0. , -0.8]])
    """

    #: Sizes and limits that a fit takes for granted; a subclass may have others.
    settings = StaySettings()
    #: So many of the inputs, the last, are in the laws alone, in continuous time: guards know none.
    unguarded_inputs = 0

    def __init__(
        self, n_modes="auto", *, order=1, lags=0, discrete_time=False, feature_library=1,
        guard_degree=1, sparsity=None, max_modes=6, n_jobs=None, refine=True, input_hold="auto",
        known=None, random_state=None, verbose=0, checkpoint=None,
    ):  # fmt: skip
        self.n_modes = n_modes
        self.order = order
        self.lags = lags
        self.discrete_time = discrete_time
        self.feature_library = feature_library
        self.guard_degree = guard_degree
        self.sparsity = sparsity
        self.max_modes = max_modes
        self.n_jobs = n_jobs
        self.refine = refine
        self.input_hold = input_hold
        self.known = known
        self.random_state = random_state
        self.verbose = verbose
        self.checkpoint = checkpoint

    @checkpointed
    def fit(self, x, t=None, groups=None, inputs=None):
        """Identify laws, modes, guards and resets.

        Parameters
        ----------
        x : array-like of shape (n_samples, n_states), or a list of recordings
            Measured states, NaN where a value is missing. A recording is a dict with ``t``, ``x``
            and, if there are any, ``inputs``; the other arguments are then left out. Or a list of
            tables, with lists of times and inputs.
        t : array-like of shape (n_samples,), default=None
            Times, increasing within each recording; in discrete time they may be left out. Two
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

        Warns
        -----
        GuardWarning
            If the switches of a transition happen where no guard tells.
        MisfitWarning
            If free rollouts leave a recording of the fit by more than three times its noise: at
            which transition, or in which mode, most do.
        """
        degree = whole("guard_degree", self.guard_degree)
        discrete, order = flag("discrete_time", self.discrete_time), check_order(self.order)
        refine, laws_known = flag("refine", self.refine), known_laws(self.known, OF_TRANSITIONS)
        sampled.check_times(discrete, order, self.lags, self.sparsity, self.input_hold, laws_known)
        if discrete and t is None and not isinstance(x, (list, dict)):
            n_rows = len(table("x", x, missing=True))
            t = np.arange(n_rows) if groups is None else places_along(groups)
        given = read_given(x, t, groups, inputs)
        if discrete and any(len(record.events) for record in given.records):
            raise ValueError(
                "t repeats times, and in discrete time every row is a step; give one row for each."
            )
        estimator, known = self._estimator(), (self.input_hold, self.settings)
        holds = () if discrete else holds_of(given, estimator, order, *known)
        held = given.stepped(holds)
        with progress(None, "rounds", bool(verbosity(self.verbose))) as bar:
            if discrete:
                found = sampled.identified(
                    given, lags=self.lags, library=self.feature_library, n_modes=self.n_modes,
                    max_modes=whole("max_modes", self.max_modes), degree=degree, known=laws_known,
                )  # fmt: skip
            else:
                terms = GuardTerms(degree, self.unguarded_inputs)
                found = continuous.identified(
                    estimator, held, terms, self.settings, bar.update,
                    order=order, refine=refine, known=laws_known,
                )  # fmt: skip
        self.input_holds_ = tuple(map(str, holds))
        self._store(found, given, held)
        self._keep(given)
        return self

    def simulate(self, x0, t, inputs=None, *, mode=None, **options):
        """Roll the automaton out; as `HybridAutomaton.simulate`.

        Inputs keep their value until the next sample if all of them did so in `fit`; else they are
        linear between their samples. ``n_draws`` asks for a band, if `covariance_` is known.
        """
        wishes = self._with_hold(options)
        return band_of(self._fitted, self.covariance_, x0, t, inputs, mode, wishes)

    @property
    def covariance_(self):
        """Of ``automaton_.parameters``, of `refinement_`; None where that was not kept."""
        gained = self.refinement_
        return gained.covariance if gained is not None and gained.kept else None

    @failing_in_words
    def score(self, x, t=None, groups=None, inputs=None):
        """Coefficient of determination of rollouts of recordings that were held out.

        Each rollout begins in the mode and the state that fit the first samples of its recording
        best; the score is the mean over the states.

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
        automaton, given = self._fitted, read_given(x, t, groups, inputs)
        wanted = automaton.n_states // self.order
        if given.n_channels != wanted:
            raise ValueError(
                f"x has {given.n_channels} columns and the model has {wanted} measured states; "
                "give these, in their order."
            )
        return rollout_score(automaton, self._stepped(given))

    def equations(self, precision=3, format="text"):
        """Laws and transitions as text or LaTeX; as `HybridAutomaton.equations`."""
        return self._fitted.equations(precision, format)

    def to_hybrid_system(self):
        """Laws, guards and resets as formulas; as `HybridAutomaton.to_hybrid_system`."""
        return self._fitted.to_hybrid_system().noted(self.report_)

    def to_dict(self):
        """The automaton in types that JSON knows; as `HybridAutomaton.to_dict`."""
        return self._fitted.to_dict()

    @staticmethod
    def from_dict(told):
        """The automaton that `to_dict` wrote; as `HybridAutomaton.from_dict`."""
        return HybridAutomaton.from_dict(told)

    def to_spaceex(self, path, component="automaton", **start):
        """Write a SpaceEx model and how it is run; as `HybridAutomaton.to_spaceex`."""
        self._fitted.to_spaceex(path, component, **start)

    # -- parts of fit ------------------------------------------------------------------------

    def _estimator(self) -> SwitchingSystemRegressor:
        """What stays start from: the modes of derivatives, no surface asked."""
        return SwitchingSystemRegressor(
            self.n_modes, feature_library=self.feature_library, coupling=0.0,
            sparsity=self.sparsity, max_modes=self.max_modes, n_jobs=self.n_jobs,
            random_state=self.random_state,
        )  # fmt: skip

    def _asked(self, given: Given, split: Split) -> Asked:
        lags = self.automaton_.lags if self.discrete_time else 0

        def fitted(rows, n_modes, whole, **options):
            again = clone(self).set_params(
                n_modes=n_modes, lags=lags, verbose=0, checkpoint=None, **options
            )
            return again.set_params(input_hold=self._holds or "auto").fit(*given.data(rows))

        def law(rows, n_modes, whole, **options):
            laws = self._estimator().set_params(n_modes=1, coupling="auto", **options)
            known = {"order": self.order, "input_hold": self._holds}
            return TrajectoryIdentifier(laws, refine=whole, **known).fit(*given.data(rows))

        stepped, laws = self._stepped(given), None
        if not self.discrete_time:
            laws = HeldOutTrajectories(stepped, split, law, self.order, through_jumps=True)
        held_out = HeldOutAutomata(stepped, split, fitted, self, laws)
        return Asked(held_out, self.feature_library, self.n_modes, AUTOMATON)

    def _store(self, found: IdentifiedAutomaton, given: Given, stepped: Given) -> None:
        self.automaton_ = found.automaton
        self.coef_, self.transitions_ = found.automaton.coef, found.automaton.transitions
        self.n_modes_ = found.automaton.n_modes
        self.modes_, self.states_ = stepped.by_rows(found.modes), stepped.by_rows(found.states)
        self.switch_times_, self.noise_ = found.switch_times, found.noise
        self.verdicts_, self.refinement_ = found.verdicts, found.refinement
        self.mode_selection_ = list(found.candidates)
        self.coef_errors_ = found.errors.coef
        self.guard_errors_, self.reset_errors_ = found.errors.guards, found.errors.resets
        self.known_ = found.known
        self.equation_noise_ = None if found.noises is None else found.noises.equation
        names, asked = found.automaton.feature_map.names_in, (self.n_modes, self.max_modes)
        held = hold_sentences(names, self.input_holds_, given, stepped)
        self.report_ = AutomatonReport.of(found, *asked, given.n_samples, held)
        if told := untold_switches(found):
            warnings.warn(told, GuardWarning, stacklevel=4)
        elif told := strays(found):
            warnings.warn(told, MisfitWarning, stacklevel=4)

    @property
    def _fitted(self) -> HybridAutomaton:
        check_fitted(self)
        return self.automaton_
