"""`SwitchingSystemRegressor`: the public estimator."""

from __future__ import annotations

from sklearn.base import BaseEstimator, MultiOutputMixin, RegressorMixin

from swsysid._checkpoints import checkpointed
from swsysid._checks.arrays import other_names
from swsysid._checks.estimators import check_fitted, column_names, rows_and_velocities, rows_of
from swsysid._checks.parameters import random_numbers
from swsysid._classifier import PolynomialSurfaceClassifier
from swsysid._data.features import FeatureMap
from swsysid._data.sources import holds_blocks, over_blocks
from swsysid._identification.doubts import Doubts, examine, warn_about
from swsysid._identification.identify import (
    Answer,
    answer_of_all,
    answer_of_many,
    fitted_surface,
    identify,
)
from swsysid._identification.problem import attach_likelihood
from swsysid._identification.settings import IdentificationSettings
from swsysid._identification.setup import (
    TrainingRows,
    build_problem,
    build_search,
    check_parameters,
    checked_rows,
)
from swsysid._identification.terms import surface_candidates
from swsysid._journal import handing_over, offer
from swsysid._simulation.model import SwitchingModel, WithSwitchingModel
from swsysid.metrics._scorers import ScoredByR2
from swsysid.relaxations import get_relaxation
from swsysid.relaxations._base import one_hot
from swsysid.relaxations._certificates import certify


class SwitchingSystemRegressor(
    WithSwitchingModel, ScoredByR2, MultiOutputMixin, RegressorMixin, BaseEstimator
):
    r"""Identify a switching system: the law of every mode and the surface between them.

    From states (and inputs) `X` and measured velocities `Xdot` it solves

    .. math::

        \min_{C, \lambda, a} \; \sum_i w_i \Big\| \dot x_i - \sum_j \lambda_{ij} C_j \Phi(x_i)
        \Big\| / s + \kappa \Big( \sum_{i, \ell} w_i \xi_{i\ell} + \beta \| a \|_1 \Big)

    over vector fields with :math:`|C| \le` `coef_bound`, memberships
    :math:`\lambda_i \in \{e_1, \dots, e_M\}` and polynomial surfaces :math:`f_\ell = a_\ell^\top
    \phi` with the slacks :math:`\xi` of the margin LP, by alternating the three convex programs
    (paper, section "Bilevel convex optimizations") from several starts. With ``coupling=0`` the
    surface is fitted after the modes, as in the paper.

    Parameters
    ----------
    n_modes : int or "auto", default=2
        Number of modes; ``"auto"`` chooses up to `max_modes` on held-out data.
    feature_library : None, int, transformer or PySINDy library, default=None
        The feature map Phi. None is Phi(x) = x; an int d is all monomials of states and inputs
        up to degree d, the constant included.
    relaxation : {"exact", "simplex", "moment"} or Relaxation, default="exact"
        Relaxation of the mode constraint.
    loss : {"l1", "l2", "squared"}, default="l1"
    coef_bound : float, default=None
        Bound on every coefficient, in the user's units.
    sparsity : None, "auto" or float, default=None
        ``"auto"`` removes insignificant terms from each equation; a number removes the
        coefficients below it in size (sequential thresholding).
    known : Known or list of str, default=None
        What is known of the laws before, which holds exactly; up to 40,000 rows.
    surface : classifier, default=None
        Classifier of the modes; None is ``PolynomialSurfaceClassifier()``.
    coupling : float or "auto", default="auto"
        Price of disagreeing with the surface, in nats for one unit of slack; ``"auto"`` is one
        nat for each margin, 0 if the surface offers no penalty.
    init : {"auto", "random"} or array, default="auto"
        ``"auto"`` seeds by a mixture of experts with a polynomial gate; an array is either labels
        (n_samples,) or coefficients (n_modes, n_states, n_features_out).
    n_init : int or "auto", default="auto"
        Number of starts.
    max_modes : int, default=6
        Largest number of modes tried by ``n_modes="auto"``.
    max_iter : int, default=100
        Largest number of iterations from one start.
    tol : float, default=1e-6
        Relative improvement below which an alternation stops.
    solver : str, default="auto"
        ``"auto"`` uses the structured solvers; a name such as ``"clarabel"`` sends every program
        through cvxpy.
    discrete_time : bool, default=False
        `Xdot` holds next states; `simulate` iterates the map.
    n_jobs : int, default=None
        Starts run in parallel; the result does not depend on it.
    random_state : int, RandomState instance or None, default=None
    verbose : int, default=0
    checkpoint : str or path, default=None
        Folder of your own in which finished steps are kept: the same fit goes on from there after
        it was stopped, and ends with the same answer. `best_so_far` reads what it has until now.

    Attributes
    ----------
    coef_ : ndarray of shape (n_modes_, n_states, n_features_out)
        Vector fields, the most populated mode first.
    modes_ : ndarray of shape (n_samples,), int
        Mode of every training sample.
    membership_ : ndarray of shape (n_samples, n_modes_)
        Membership before hardening.
    surface_ : classifier
        Fitted to the modes of the training samples. A `PolynomialSurfaceClassifier` whose
        `relevance` is None is given the monomials that the samples ask for, if these explain the
        velocities better than all do (not with ``coupling=0`` or ``standardize=False``).
    surface_candidates_ : list of SurfaceCandidate
        `surface_`; after it, where few monomials and all nearly tie, the other of the two.
    objective_ : float
        Weighted sum of the losses of the hard modes, in the user's units.
    history_ : list of IterationRecord
        The iterations of the winning start; of more than 40,000 rows, the passes over them.
    stability_ : float
        Fraction of the starts that found the winner.
    guard_score_ : float
        Balanced accuracy of the surface on the samples whose residuals decide their mode by
        themselves: close to 1 if the switching is a function of the state, else down to
        1 / `n_modes_`. NaN where too few decide, or for one mode.
    residual_share_ : float
        What neighbouring samples share of their residuals: about 0 for noise, close to 1 if a
        vector field is left over (wrong modes, a missing term).
    mode_selection_ : list of ModeCandidate
        The candidates of ``n_modes="auto"``, empty otherwise.
    n_modes_, n_iter_, n_features_in_ : int
    converged_ : bool
    covariance_ : ndarray of shape (n_parameters, n_parameters) or None
        Of ``coef_.ravel()``, then the surfaces' coefficients in the coordinates of their fit; 0
        where fixed, infinite where nothing tells. Of `TrajectoryIdentifier` and `refine`, else None
    feature_names_in_ : ndarray of str, if `X` has column names
    feature_names_out_ : ndarray of str
        Names of the features Phi.

    Examples
    --------
    >>> import numpy as np
    >>> from swsysid import SwitchingSystemRegressor
    >>> X = np.random.default_rng(0).uniform(-1, 1, (200, 2))
    >>> damping = np.where(X[:, 0] > 0, 0.1, 0.5)
    >>> Xdot = np.column_stack([X[:, 1], -X[:, 0] - damping * X[:, 1]])
    >>> model = SwitchingSystemRegressor(n_modes=2, random_state=0).fit(X, Xdot)
    >>> for equation in sorted(model.equations(precision=1)):
    ...     print(equation[8:])
    x0' = 1.0 x1
    x1' = -1.0 x0 - 0.1 x1
    x0' = 1.0 x1
    x1' = -1.0 x0 - 0.5 x1
    """

    #: Sizes and limits that a fit takes for granted; a subclass may have others.
    settings = IdentificationSettings()

    def __init__(
        self, n_modes=2, *, feature_library=None, relaxation="exact", loss="l1", coef_bound=None,
        sparsity=None, known=None, surface=None, coupling="auto", init="auto", n_init="auto",
        max_modes=6, max_iter=100, tol=1e-6, solver="auto", discrete_time=False, n_jobs=None,
        random_state=None, verbose=0, checkpoint=None,
    ):  # fmt: skip
        self.n_modes = n_modes
        self.feature_library = feature_library
        self.relaxation = relaxation
        self.loss = loss
        self.coef_bound = coef_bound
        self.sparsity = sparsity
        self.known = known
        self.surface = surface
        self.coupling = coupling
        self.init = init
        self.n_init = n_init
        self.max_modes = max_modes
        self.max_iter = max_iter
        self.tol = tol
        self.solver = solver
        self.discrete_time = discrete_time
        self.n_jobs = n_jobs
        self.random_state = random_state
        self.verbose = verbose
        self.checkpoint = checkpoint

    @checkpointed
    def fit(self, X, y, sample_weight=None, *, groups=None):
        """Identify the modes and the surface.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_states + n_inputs)
            States, then inputs. Also a memory map, a Dask array, or a sequence of blocks of rows;
            the other arguments are then of the same kind.
        y : array-like of shape (n_samples,) or (n_samples, n_states)
            Xdot, the measured velocities (next states in discrete time).
        sample_weight : array-like of shape (n_samples,), default=None
            A weight of 2 means the row twice, 0 no row. A common factor means nothing: where all
            are below 1 the largest counts as 1, where all are above it the smallest.
        groups : array-like of shape (n_samples,), default=None
            Trajectory of each row, kept whole where data are held out (``n_modes="auto"``).

        Returns
        -------
        self

        Raises
        ------
        ValueError, TypeError
            If a parameter or the data make no sense; the message says what to do.
        SolverError
            If a named solver is not installed.
        """
        check_parameters(self)
        rows, self._one_target = checked_rows(self, X, y, sample_weight, groups)
        feature_map = self._fit_features(rows)
        problem = build_problem(self, rows.distinct, feature_map)
        search = build_search(self, rows.distinct, rows.sample)

        found = identify(problem, search, random_numbers(self.random_state))
        if rows.sample.is_everything:
            answer = answer_of_all(rows, found, feature_map)
        else:
            self.coef_, self.n_modes_ = found.best.coef, len(found.best.coef)
            self.surface_ = fitted_surface(found.problem, found.best.modes)
            with handing_over(lambda of_the_sample: of_the_sample):
                offer(self)
            answer = answer_of_many(rows, found, feature_map, search)
        doubts = examine(answer, rows, default_library=self.feature_library is None)

        self._store(answer, doubts)
        names = other_names(y, column_names(self)[: self.coef_.shape[1]])
        self._given_names = None if self.discrete_time or holds_blocks(X) else names
        warn_about(self, answer, doubts)
        return self

    def predict(self, X):
        """Velocity of the active mode, of the shape that `y` had in `fit`.

        If `X` has blocks, so has the answer: a Dask array gives a Dask array, a sequence a list.
        """
        check_fitted(self)
        columns = () if self._one_target else (self.coef_.shape[1],)
        return over_blocks(self._predicted, X, float, *columns)

    def predict_modes(self, X):
        """Mode of every sample according to the surface, shape (n_samples,)."""
        check_fitted(self)
        modes = self.switching_model.modes
        return over_blocks(lambda part: modes(rows_of(self, part)), X, int)

    def predict_mode_proba(self, X):
        """Probability of every mode, shape (n_samples, `n_modes_`).

        All the surfaces that the data allow have a say in it, not the fitted one alone. It is 0
        or 1 if the surface has no ``predict_proba``.
        """
        check_fitted(self)
        probabilities = self.switching_model.mode_probabilities
        return over_blocks(lambda part: probabilities(rows_of(self, part)), X, float, self.n_modes_)

    def mode_velocities(self, X):
        """Velocity of every mode at every sample, (`n_modes_`, n_samples, n_states)."""
        check_fitted(self)
        return self.switching_model.velocities(rows_of(self, X))

    def equations(self, precision=3, format="text"):
        """The law of every mode as text.

        Parameters
        ----------
        precision : int, default=3
        format : {"text", "latex"}, default="text"

        Returns
        -------
        list of str
            One equation for each mode and state, mode by mode. Where `y` had other names than the
            states in `fit`, such as that of a force, these stand on the left.
        """
        check_fitted(self)
        given = vars(self).get("_given_names")  # not in files of before
        return self.switching_model.equations(precision, format, quantities=given)

    def surface_equations(self, precision=3, format="text"):
        """The surfaces as text, with the modes on their two sides; parameters as `equations`.

        One line for each surface, with the names of the columns of `X`.
        """
        check_fitted(self)
        return self.switching_model.surface_equations(precision, format)

    def simulate(self, x0, t, inputs=None, *, input_hold="zero", **options):
        """Roll the identified system out from a state, with switching events located.

        Parameters
        ----------
        x0 : array-like of shape (n_states,)
        t : array-like of shape (n_times,)
            Increasing times (sample numbers in discrete time).
        inputs : array-like of shape (n_times, n_inputs), default=None
            Needed if the system has inputs.
        input_hold : {"zero", "linear", "next"}, default="zero"
            What the inputs do between the samples: keep their value, go on a line, or have that of
            the next one, as what a logger writes at the end of an interval.
        **options
            ``max_switches``, ``rtol``, ``atol`` (default: 1e-10 of the spread of each state in
            the data of the fit) and ``state_bound`` (default: 1e9 of it) of the integration.
            ``n_draws``, with ``confidence`` and ``random_state``, asks for a band (`Trajectory`).

        Returns
        -------
        Trajectory
            Its ``status`` says why the simulation ended.
        """
        check_fitted(self)
        n_states = self.coef_.shape[1]
        if n_states > self.n_features_in_:
            raise ValueError(
                f"The model has {n_states} velocities but only {self.n_features_in_} columns in "
                "X; simulate needs the states themselves as the first columns of X."
            )
        known = {"covariance": vars(self).get("covariance_"), "input_hold": input_hold}
        return self.switching_model.simulate(x0, t, inputs, **known, **options)

    def certificate(self, X, y):
        """How far the vector fields and the modes can be from optimal on some data.

        Returns
        -------
        FitCertificate
            Gap between the hard assignment and its simplex relaxation for the fitted vector
            fields, dual certificates and rounding bounds of the samples, and the duality gap of
            the dynamics program.
        """
        check_fitted(self)
        X, y = rows_and_velocities(self, X, y)
        return certify(
            self.switching_model.feature_map(X), y.reshape(len(y), -1), self.coef_, self.loss,
            solver=self.solver, coef_bound=self.coef_bound,
        )  # fmt: skip

    def set_params(self, **params):
        """Set parameters, those of the default surface and relaxation included.

        ``surface__degree`` reaches the default surface although `surface` is None, and
        ``relaxation__order`` the relaxation although it is given by name.
        """
        nested = {key.partition("__")[0] for key in params if "__" in key}
        if "surface" in nested and params.get("surface", self.surface) is None:
            params = params | {"surface": PolynomialSurfaceClassifier()}
        if "relaxation" in nested:
            relaxation = get_relaxation(params.get("relaxation", self.relaxation))
            params = params | {"relaxation": relaxation}
        return super().set_params(**params)

    def _fit_features(self, rows: TrainingRows) -> FeatureMap:
        given = rows.in_memory
        samples, names = given.X[given.weight > 0], column_names(self)
        self._feature_map = FeatureMap(self.feature_library, samples, names)
        self.feature_names_out_ = self._feature_map.names_out
        return self._feature_map

    def _store(self, answer: Answer, doubts: Doubts) -> None:
        found, best = answer.found, answer.found.best
        self.coef_, self.surface_, self.modes_ = best.coef, answer.surface, answer.modes
        self._membership, self.objective_ = answer.membership, answer.objective
        self.history_, self.n_iter_ = answer.history, len(answer.history)
        self.converged_, self.n_modes_, self.covariance_ = best.converged, len(best.coef), None
        self.stability_, self.mode_selection_ = found.stability, list(found.candidates)
        self.guard_score_, self.residual_share_ = doubts.guard.score, doubts.shared.share
        attach_likelihood(self.surface_, found.problem, best.coef, best.modes)
        self.surface_candidates_ = surface_candidates(
            found.problem, found.monomials, self.surface_, best.modes
        )

    @property
    def membership_(self):
        """Membership before hardening, shape (n_samples, `n_modes_`)."""
        kept = self._membership
        return one_hot(self.modes_, self.n_modes_) if kept is None else kept

    def _predicted(self, X):
        velocity = self.switching_model.predict(rows_of(self, X))
        return velocity[:, 0] if self._one_target else velocity

    def use_features(self, feature_map: FeatureMap) -> None:
        """Let the coefficients be those of other features.

        A library that learns from its data, such as one that scales them, is another one in every
        fit.
        """
        self._feature_map = feature_map

    @property
    def switching_model(self) -> SwitchingModel:
        """Vector fields, feature map and surface of the fit as one system."""
        return SwitchingModel(self.coef_, self._feature_map, self.surface_, self.discrete_time)
