"""`EffectSearchCV`: find what a model leaves over, name the effect, add it, report the error."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import wraps
from typing import TypeVar

import numpy as np
from sklearn.base import BaseEstimator, MultiOutputMixin, RegressorMixin

from swsysid._checkpoints import checkpointed
from swsysid._checks.estimators import FittedLater, check_fitted, rows_and_velocities
from swsysid._checks.parameters import function, jobs, random_numbers, real, verbosity, whole
from swsysid._data.records import Records
from swsysid._effect_model.declared import Declared
from swsysid._effect_model.joint_fit import (
    JointFit,
    fit_jointly,
    warn_of_doubts,
    with_decoded_surface,
)
from swsysid._effect_model.models import check_declared, declared_model, unfitted, with_seed
from swsysid._effect_model.velocities import with_quantity
from swsysid._effect_regressor import EffectRegressor
from swsysid._effect_search.contributions import term_covariances
from swsysid._effect_search.findings import Ladder, describe_findings
from swsysid._effect_search.folds import SearchData, Split, split_records
from swsysid._effect_search.outcome import Choices, Outcome, search_beside
from swsysid._effect_search.reading import alarms, listed_effects, read_recordings, read_rows
from swsysid._effect_search.recorded_search import is_of_one_law, searched_recordings
from swsysid._effect_search.recording import Measured, beside_effects, from_states, with_velocities
from swsysid._effect_search.report import EffectReport
from swsysid._effect_search.rollouts import errors_of_all
from swsysid._journal import handing_over, offer
from swsysid._results import IdentificationWarning
from swsysid._stays.search import check_order
from swsysid.exporting import ToOtherTools
from swsysid.metrics._scorers import explained

Answer = TypeVar("Answer")


def _of_the_best(method: Callable[..., Answer]) -> Callable[..., Answer]:
    """A method of the best model as one of the search that has found it."""

    @wraps(method)
    def call(self, *args, **options):
        check_fitted(self, "best_estimator_")
        return method(self.best_estimator_, *args, **options)

    return call


class EffectSearchCV(ToOtherTools, MultiOutputMixin, RegressorMixin, FittedLater, BaseEstimator):
    r"""Find the effects that a declared model lacks, and add them.

    The declared model is fitted, and every effect of a library is tried on what it leaves over:
    at every place, in every state equation, in all modes or in one, its nonlinear parameters
    fitted on training folds only. An effect enters if it predicts held-out stretches of the
    record better than chance would, corrected for the number of candidates; of effects within
    one standard error the one with the fewest parameters. Modes and surface are identified anew
    with the effect inside, since they may have been wrong because it was missing; then all
    effects are questioned in the light of the others. The errors before and after are those on
    trajectories (or stretches) that took no part in any of this.

    Parameters
    ----------
    estimator : estimator or HybridAutomaton
        The declared model: a SwitchingSystemRegressor, a Pipeline that ends in one, a
        TrajectoryIdentifier (which stands for the model that it looks for), a
        HybridAutomatonRegressor, or an automaton that is stated or was found. An automaton keeps
        its modes, its transitions and the terms of its laws; coefficients of these terms are fitted
        with the effects. It needs `t`, and laws without lags.
    effects : "all" or list of Effect, default="all"
        Effects to look for; see `swsysid.effects`.
    cv : int, cross-validation generator or None, default=None
        Folds inside the search. None, which is 5, or an int: whole trajectories or stretches.
    scoring : callable or None, default=None
        ``scoring(y_true, y_pred) -> float`` of `score`; None is R2.
    max_effects : int, default=5
    significance : float, default=0.01
        Of an effect found by chance in the whole search of one.
    order : {1, 2}, default=1
        2: recordings of one law are of positions alone. Their velocities are hidden states, and
        columns behind them in what is fitted; errors are those of the positions.
    input_hold : {"auto", "linear", "zero", "next", "between"} or a sequence, default="auto"
        What inputs of recordings with one law do between two rows, as `TrajectoryIdentifier` takes
        it; of what steps at an instant that is not known a line has the mean.
    n_jobs : int or None, default=None
        Candidates that are tried at a time; whatever it is, the answer is the same.
    random_state : int, RandomState instance or None, default=None
        Of what is held out, and of the estimator where it has none itself. None is 0.
    verbose : int, default=0
        1 shows a progress bar.
    checkpoint : str or path, default=None
        Folder of your own that keeps finished steps: the same fit goes on from there after it was
        stopped, to the same answer. `best_so_far` reads the best until now.

    Attributes
    ----------
    best_estimator_ : EffectRegressor
        The declared model with the effects found, fitted to all rows.
    automaton_ : HybridAutomaton
        Laws and transitions of `best_estimator_`, with hysteresis and resets found.
    declared_estimator_ : EffectRegressor
        The declared model without effects, fitted to all rows.
    effects_ : list of FoundEffect
        The most important first.
    report_ : EffectReport
        What was looked for, found and left over; prints, and writes HTML.
    n_features_in_, feature_names_in_

    Examples
    --------
    >>> from swsysid import EffectSearchCV
    >>> from swsysid.datasets import make_undeclared
    >>> from swsysid.effects import CoulombFriction, Polynomial, QuadraticDrag
    >>> data = make_undeclared("coulomb_friction", system="pendulum", random_state=0)
    >>> library = [CoulombFriction(), QuadraticDrag(), Polynomial()]
    >>> search = EffectSearchCV(data.estimator, effects=library)
    >>> search = search.fit(data.X, data.Xdot, t=data.t, groups=data.groups)
    >>> search.effects_[0].kind, search.effects_[0].target
    ('coulomb_friction', 1)

    A relay with hysteresis whose laws lack a drag:

    >>> import numpy as np
    >>> from swsysid import HybridAutomaton
    >>> switches = [(0, 1, "v >= 2"), (1, 0, "v <= -2")]
    >>> plant = HybridAutomaton.stated(
    ...     [{"v": "3 - 0.3 v^3"}, {"v": "-3 - 0.3 v^3"}], switches, states=["v"]
    ... )
    >>> declared = HybridAutomaton.stated([{"v": "3"}, {"v": "-3"}], switches, states=["v"])
    >>> t, noise = np.arange(0.0, 10.0, 0.02), np.random.default_rng(0)
    >>> runs = [plant.simulate([v], t, mode=0).x for v in (-1.5, -0.5, 0.5, 1.5)]
    >>> recordings = [{"t": t, "x": x + 0.005 * noise.standard_normal(x.shape)} for x in runs]
    >>> search = EffectSearchCV(declared, effects=[CoulombFriction(), Polynomial()])
    >>> [(found.kind, found.place) for found in search.fit(recordings).effects_]
    [('polynomial', 'x0^3')]
    >>> print("\n".join(search.surface_equations(precision=1)))
    mode 0 -> 1 where x0 >= 2.0
    mode 1 -> 0 where x0 <= -2.0
    """

    _declared: Declared  # what is fitted, for the record at hand

    def __init__(
        self, estimator, *, effects="all", cv=None, scoring=None, max_effects=5, significance=0.01,
        order=1, input_hold="auto", n_jobs=None, random_state=None, verbose=0, checkpoint=None,
    ):  # fmt: skip
        self.estimator = estimator
        self.effects = effects
        self.cv = cv
        self.scoring = scoring
        self.max_effects = max_effects
        self.significance = significance
        self.order = order
        self.input_hold = input_hold
        self.n_jobs = n_jobs
        self.random_state = random_state
        self.verbose = verbose
        self.checkpoint = checkpoint

    @checkpointed
    def fit(self, X, y=None, *, t=None, groups=None, signals=None, inputs=None):
        """Search.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_states + n_inputs)
            States, then inputs. Without `y` measured states alone, NaN where a value is missing,
            or a list of recordings as `TrajectoryIdentifier.fit` takes them.
        y : array-like of shape (n_samples,) or (n_samples, n_states), default=None
            Xdot, the measured velocities (next states in discrete time). None for recordings: one
            law is rolled out; where several follow each other velocities are made of the states,
            and neighbours that share their noise count as one. A quantity that the record shows to
            be no rate of the first column (a force, a torque; it needs `t`) is the answer
            of a static law: no column of X is a state then, and nothing is rolled out.
        t : array-like of shape (n_samples,), default=None
            Times in s, increasing along each trajectory.
        groups : array-like of shape (n_samples,), default=None
            Trajectory of each row. Without both rows are exchangeable and without memory.
        signals : array-like of shape (n_samples, n_signals), default=None
            Logged channels that the declared model does not use.
        inputs : array-like of shape (n_samples, n_inputs), default=None
            Inputs beside measured states; with `y` columns of X.

        Returns
        -------
        self

        Raises
        ------
        ValueError, TypeError
            If a parameter or the data make no sense; the message says what to do.

        Examples
        --------
        A recording, without velocities:

        >>> import numpy as np
        >>> from swsysid import EffectSearchCV
        >>> from swsysid.datasets import make_undeclared
        >>> from swsysid.effects import CoulombFriction, DeadZone, Polynomial, QuadraticDrag
        >>> data = make_undeclared("coulomb_friction", system="pendulum", random_state=0)
        >>> x, u = data.X[:, :2], data.X[:, 2:]
        >>> x = x + 0.01 * x.std(axis=0) * np.random.default_rng(0).standard_normal(x.shape)
        >>> library = [CoulombFriction(), DeadZone(), QuadraticDrag(), Polynomial()]
        >>> search = EffectSearchCV(data.estimator, effects=library)
        >>> search = search.fit(x, t=data.t, groups=data.groups, inputs=u)
        >>> [(effect.kind, effect.target) for effect in search.effects_]
        [('coulomb_friction', 1)]
        """
        self._check_parameters()
        seed = 0 if self.random_state is None else self.random_state
        self._seeded, rng = with_seed(self.estimator, seed), random_numbers(seed)
        measured = self._measured(X, y, t, groups, signals, inputs)
        with handing_over(lambda found: self._handed_over(found, measured)):
            return self._found(measured, rng)

    def _found(self, measured, rng):
        """The search in a record that was read."""
        parts = split_records(measured.records, rng, measured.window)
        final = measured.fitted(self._declared)
        self.best_estimator_ = self.declared_estimator_ = self._handed_over(final, measured)
        offer(final)
        of_one = is_of_one_law(self._declared, measured)
        rolled_out = of_one and measured.recorded is not None
        if measured.is_enough(parts, rolled_out):
            rows = parts.of(measured.rows).search
            plain = measured.fitted(self._declared, rows)  # where rolled out it is not what counts
            self._alarms = [] if rolled_out else alarms(self._declared, plain, measured, rows)
            for alarm in self._alarms:
                warnings.warn(alarm, IdentificationWarning, stacklevel=4)
            if of_one:
                final = self._of_one_law(measured, parts, plain)
            else:
                searched = self._between_switches(measured, parts, (plain, final), rng)
                final = self._concluded(*searched)
        else:
            enough = measured.enough(parts, rolled_out)
            told = "samples are too few to hold any out: the declared model is returned unchanged."
            told = f"{len(measured.records)} {told} {enough}"
            warnings.warn(told, IdentificationWarning, stacklevel=4)
            self.effects_, self.report_ = [], EffectReport.nothing_done(measured, enough)
        warn_of_doubts(final, 4)
        return self

    def predict(self, X, *, t=None, groups=None, signals=None):
        """Velocities of the best model, of the shape that `y` had in `fit`."""
        check_fitted(self, "best_estimator_")
        velocity = self.best_estimator_.predict(X, t=t, groups=groups, signals=signals)
        return velocity[:, 0] if self._one_target else velocity

    def score(self, X, y, *, t=None, groups=None, signals=None):
        """R2 of the velocities, or what `scoring` says."""
        check_fitted(self, "best_estimator_")
        targets = rows_and_velocities(self, X, y)[1]
        predicted = self.predict(X, t=t, groups=groups, signals=signals)
        return (self.scoring or explained)(targets, predicted)

    predict_modes = _of_the_best(EffectRegressor.predict_modes)
    simulate = _of_the_best(EffectRegressor.simulate)
    to_hybrid_system = _of_the_best(EffectRegressor.to_hybrid_system)
    equations = _of_the_best(EffectRegressor.equations)
    surface_equations = _of_the_best(EffectRegressor.surface_equations)

    @property
    def automaton_(self):
        """Laws and transitions of the best model; as `EffectRegressor.automaton_`."""
        check_fitted(self, "best_estimator_")
        return self.best_estimator_.automaton_

    def _of_one_law(self, measured: Measured, parts: Split, plain: JointFit) -> JointFit:
        """Effects that recordings of one law ask for, or rows of a quantity that it gives."""
        asked = listed_effects(self.effects), self.input_hold
        limits = self.significance, self.max_effects, self.n_jobs, bool(self.verbose)
        found = searched_recordings(plain, measured, parts, *asked, *limits)
        declared, *ends, final = found.joint_fits
        self.declared_estimator_ = self._handed_over(declared, measured)
        self.best_estimator_ = self._handed_over(final, measured)
        models = [*(self._regressor(one, measured.records) for one in ends), self.best_estimator_]
        self.report_ = found.report(models, self._trajectory_names, self._alarms)
        self.effects_ = [*self.report_.effects]
        return final

    def _between_switches(
        self, measured: Measured, parts: Split, fits: tuple[JointFit, JointFit], rng
    ) -> tuple[Measured, Outcome, JointFit]:
        """The record as it is known, what velocities ask for, the declared model of all rows.

        Without a first effect inside fewer modes and velocities are wrong, and perhaps the effect
        is another one: a record is read anew with it, if that tells more and then shows anything.
        """
        stated, (plain, final) = self._declared, fits
        if measured.records.decoded_modes is not None and self.max_effects:
            first = self._search(measured, parts, plain, rng, 1).structure.fit
            self._declared, better = beside_effects(stated, measured, first)
            if better is not None and better.is_enough(parts):
                start = better.fitted(self._declared, parts.of(better.rows).search)
                found = self._search(better, parts, start, rng, self.max_effects)
                if found.structure.terms:
                    again = better.fitted(self._declared)
                    self.declared_estimator_ = self._handed_over(again, better)
                    return better, found, again
            self._declared = stated
        found = self._search(measured, parts, plain, rng, self.max_effects)
        return measured, found, final

    def _search(self, measured: Measured, parts: Split, plain: JointFit, rng, most) -> Outcome:
        """So many effects at most beside the declared model, fitted alone to the same rows."""
        asked = self.cv, self.significance, self.n_jobs, self.verbose
        choices = Choices(listed_effects(self.effects), *asked)
        return search_beside(self._declared, plain, measured, parts, rng, choices, most)

    def _concluded(self, measured: Measured, found: Outcome, plain: JointFit) -> JointFit:
        """A report of the effects that rollouts do not speak against, and the fit to all rows."""
        while True:
            final, ladder = self._reported(measured, found, plain)
            rollouts, is_given = self.report_.data.rollouts, measured.recorded is None
            if not ladder.n_simulated or not ladder.is_refused(rollouts, is_given):
                return final
            least = ladder.added(ladder.n_simulated - 1)
            found = found.without(*least, errors_of_all(rollouts))

    def _reported(
        self, measured: Measured, found: Outcome, plain: JointFit
    ) -> tuple[JointFit, Ladder]:
        """A report of the effects found, and the fit with them to all rows."""
        records, targets, context = measured.records, measured.targets, found.context
        ladder = Ladder(context, found.structure, found.findings, records, targets, found.split)
        final, whole = plain, SearchData.whole(records, measured.rows, targets)
        if ladder.terms:
            modes = found.structure.fit.modes_along(records, found.split.search)
            rows = whole.rows, whole.targets, modes[whole.rows]
            final = fit_jointly(context.model, ladder.terms, records, *rows)
        self.best_estimator_ = self.declared_estimator_
        if ladder.terms:
            self.best_estimator_ = self._handed_over(final, measured)
        covariances = term_covariances(final, whole)
        self.effects_ = describe_findings(ladder, final, covariances)
        fitted = (self._regressor(ladder.fits[place], records) for place in (0, -1))
        self.report_ = EffectReport.of(
            ladder,
            found.rounds,
            self.effects_,
            [*fitted, self.best_estimator_],
            covariances,
            self._trajectory_names,
            tried=found.tried,
            alarms=self._alarms,
            n_declared=asked if isinstance(asked := self._declared.n_modes, int) else 0,
            measured=measured,
        )
        return final, ladder

    def _measured(self, X, y, t, groups, signals, inputs) -> Measured:
        """Rows with velocities as they are given, or recordings and what follows from them."""
        if y is None:
            recorded = read_recordings(self, X, t, groups, signals, inputs, self.order)
            self._one_target, self._trajectory_names = False, recorded.names
            self._declared = declared_model(self._seeded, recorded.records)
            return from_states(self._declared, recorded.records)
        if self.order == 2:
            raise ValueError("order=2 is for positions whose velocities are hidden; leave y out.")
        records, velocities = read_rows(self, X, y, t, groups, signals, inputs)
        targets, self._one_target = velocities.reshape(len(velocities), -1), velocities.ndim == 1
        self._trajectory_names = None if groups is None else np.unique(groups)
        self._declared = declared_model(self._seeded, records)
        records = with_quantity(self._declared, records, targets, y)
        return with_velocities(self._declared, records, targets)

    def _handed_over(self, fit: JointFit, measured: Measured) -> EffectRegressor:
        """The regressor of a fit to all rows."""
        redrawn = with_decoded_surface(fit, measured.records, measured.rows)
        return self._regressor(redrawn, measured.records)

    def _regressor(self, fit: JointFit, records: Records) -> EffectRegressor:
        regressor = EffectRegressor(unfitted(self._seeded), fit.terms)
        return regressor.around(fit, self, records.names)

    def _check_parameters(self) -> None:
        check_declared(self.estimator)
        listed_effects(self.effects)
        if isinstance(self.cv, (str, bytes)) or not hasattr(self.cv, "split"):
            whole("cv", self.cv, least=2, also=(None,))
        function("scoring", self.scoring, "y_true and y_pred", also=(None,))
        whole("max_effects", self.max_effects, least=0)
        real("significance", self.significance, above=0, below=1)
        check_order(self.order)
        jobs(self.n_jobs)
        random_numbers(self.random_state)
        verbosity(self.verbose)
