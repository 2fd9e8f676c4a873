"""`PolynomialSurfaceClassifier`: polynomial surfaces between classes, by linear programming."""

from __future__ import annotations

from copy import copy

import numpy as np
from sklearn.base import BaseEstimator, ClassifierMixin

from swsysid._checks.estimators import check_fitted, column_names, rows_and_classes, rows_of
from swsysid._checks.parameters import names_of_columns, random_numbers
from swsysid._data.rows import canonical_rows, check_sample_weight, places_between
from swsysid._rendering.printing import check_format, linear_combination, symbol
from swsysid._solvers.conic import worst_status
from swsysid._surfaces.fitted import FittedSurfaces
from swsysid._surfaces.margins import certify_margin, nonzero_margin
from swsysid._surfaces.mode_books import (
    decisions,
    fit_mode_book,
    resolve_book,
    surface_scale,
    warn_if_doubtful,
)
from swsysid._surfaces.parameters import check_parameters
from swsysid._surfaces.polynomials import surface_basis
from swsysid._surfaces.probability import ModePosterior
from swsysid._surfaces.surface import LinearForm
from swsysid._whole_or_nothing import whole_or_nothing
from swsysid.metrics._scorers import ScoredByAccuracy

_DEFAULT_MARGIN = 1e-2
# The paper's beta in raw coordinates. In standardised ones half of it separates what can be;
# smaller values keep terms that only a few samples next to the surface ask for.
_BETA_RAW, _BETA_STANDARDIZED = 1e-2, 5e-3


class PolynomialSurfaceClassifier(ScoredByAccuracy, ClassifierMixin, BaseEstimator):
    r"""Classes separated by polynomial surfaces, fitted by the margin linear program.

    M classes need L = ceil(log2 M) surfaces :math:`f_\ell(x) = a_\ell^\top \phi(x)`. The
    mode-book gives class j the sign :math:`s_{j\ell}` of surface l; with
    :math:`\sigma_{i\ell} = s_{y_i \ell}` the coefficients solve (paper, problem "surface
    recovery")

    .. math:: \min_{a, \xi \ge 0} \; \sum_{i, \ell} w_i \xi_{i\ell} + \beta \sum_\ell
              \|a_\ell\|_1 \quad \text{s.t.} \quad \sigma_{i\ell} f_\ell(x_i) \ge
              \varepsilon - \xi_{i\ell}, \; |a_\ell| \le \eta .

    The program is solved exactly, on a working set of rows that is checked against all. A
    sample is given to the class of the largest
    :math:`\min_\ell s_{j\ell} f_\ell(x) / m_\ell` over its surfaces, where
    :math:`m_\ell` is the weighted mean of :math:`|f_\ell|` over the training data; this also
    decides sign regions that no class owns.

    Parameters
    ----------
    degree : int, default=2
        Degree of the polynomials; all monomials up to it, constant included, are features.
    margin : float or "auto", default=1e-2
        The paper's epsilon > 0. ``"auto"`` takes the middle of the interval in which the margin
        certificate of the training data proves every surface nonzero, and 1e-2 where there is none.
    beta : float or "auto", default="auto"
        Sparsity, not negative. ``"auto"`` is 5e-3 if standardised, else the paper's 1e-2. It is
        the price of coefficients against the *sum* of slacks and does not grow with the number
        of samples: each sample can then afford to keep its slack zero however many there are.
    coef_bound : float, default=10.0
        The paper's eta: bound on the absolute value of every coefficient.
    mode_book : "auto", "pairwise" or array-like of shape (n_classes, n_surfaces), default="auto"
        Signs in {-1, +1}, a row for each of the sorted classes. ``"auto"`` tries all books up to
        four classes, the most promising ones beyond, and keeps the one of largest weighted
        training accuracy, then of smallest objective. ``"pairwise"`` is a surface for each of the
        M (M - 1) / 2 pairs of classes, with the entry 0 for the classes that it says nothing
        about; ``"auto"`` resorts to it where ceil(log2 M) surfaces of this degree cannot separate
        the classes (three sectors that meet) and the likelihood of labels pays for it (BIC).
    standardize : bool, default=True
        Margin, beta and the box apply to polynomials of the centred and scaled columns of `X`
        (or to the scaled columns of `feature_library`, centred too if it has a constant column),
        so that predictions do not depend on units. False is the paper's program to the letter.
    feature_library : transformer, PySINDy library or int, default=None
        Replaces the monomials: its columns are the surface features.
    relevance : array-like of shape (n_surface_features,), default=None
        How much surfaces need each monomial, from 0 to 1: its coefficient pays beta / relevance,
        0 leaves it out. The monomials are then the user's own, scaled but not centred. None is
        all monomials here; `SwitchingSystemRegressor` then finds a relevance.
    span : array-like of shape (n_surface_features, n_columns), default=None
        Surfaces are sums of these columns of coefficients: ``x - 0.5``, or ``x`` and a constant.
    solver : str, default="auto"
        ``"auto"`` is HiGHS; any other name is a solver of cvxpy.
    random_state : int, RandomState instance or None, default=None
        Starts of the search for mode-books; used only with more than four classes.

    Attributes
    ----------
    coef_ : ndarray of shape (n_surfaces, n_surface_features)
        Coefficients in the user's units: ``surface_values(X)`` is the features of `X` times them.
    mode_book_ : ndarray of shape (n_classes, n_surfaces), -1 or +1, also 0 if pairwise
    classes_ : ndarray of shape (n_classes,)
        Classes of positive weight.
    slack_ : ndarray of shape (n_samples, n_surfaces)
        Slack of every training sample; 0 for samples of weight zero.
    objective_ : float
        Value of the linear program.
    complexity_ : float
        The part of `objective_` that is beta times the absolute coefficients.
    margin_, beta_ : float
        The values used.
    status_ : Status
    feature_names_out_ : ndarray of str
        Names of the surface features.
    n_features_in_ : int
    feature_names_in_ : ndarray of str
        Only where `X` has names of its own.

    See Also
    --------
    swsysid.SwitchingSystemRegressor : Finds the classes as well, as modes of a dynamical system.

    References
    ----------
    K. Iwasaki, S. Teng, A. Bloch, M. Ghaffari, "Learning Hybrid Dynamics via Convex
    Optimizations", section "Recovery of Switching Surfaces".

    Examples
    --------
    >>> import numpy as np
    >>> from swsysid import PolynomialSurfaceClassifier
    >>> x, y = np.meshgrid(np.linspace(-2, 2, 21), np.linspace(-2, 2, 21))
    >>> X = np.column_stack([x.ravel(), y.ravel()])
    >>> inside = (X**2).sum(axis=1) < 1.5
    >>> classifier = PolynomialSurfaceClassifier(degree=2).fit(X, inside)
    >>> classifier.score(X, inside)
    1.0
    >>> classifier.predict([[0.0, 0.0], [2.0, 0.0]])
    array([ True, False])
    """

    def __init__(
        self, degree=2, *, margin=_DEFAULT_MARGIN, beta="auto", coef_bound=10.0, mode_book="auto",
        standardize=True, feature_library=None, relevance=None, span=None, solver="auto",
        random_state=None
    ):  # fmt: skip
        self.degree = degree
        self.margin = margin
        self.beta = beta
        self.coef_bound = coef_bound
        self.mode_book = mode_book
        self.standardize = standardize
        self.feature_library = feature_library
        self.relevance = relevance
        self.span = span
        self.solver = solver
        self.random_state = random_state

    @whole_or_nothing
    def fit(self, X, y, sample_weight=None, *, start=None):
        """Fit the surfaces.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
        y : array-like of shape (n_samples,)
            Class labels.
        sample_weight : array-like of shape (n_samples,), default=None
            Repetitions: weight 2 is two rows, 0 is none; the largest counts for 1 at least.
        start : PolynomialSurfaceClassifier, default=None
            Fitted with these parameters to similar labels: saves time.

        Returns
        -------
        self

        Raises
        ------
        ValueError
            If a parameter or the data make no sense; the sentence says which.
        SolverError
            If the solver is not installed or returns nothing.
        """
        check_parameters(self)
        X, y = rows_and_classes(self, X, y, reset=True)
        weight = check_sample_weight(sample_weight, len(X))
        self.classes_ = np.unique(y[weight > 0])
        # Rows of weight zero are dropped below, whatever index they get here.
        labels = np.minimum(np.searchsorted(self.classes_, y), len(self.classes_) - 1)
        rows = canonical_rows(X, labels, sample_weight=weight).counted
        self._basis = surface_basis(
            self.degree, self.feature_library, rows.arrays[0], rows.weight,
            standardize=self.standardize, relevance=self.relevance, span=self.span,
        )  # fmt: skip
        features, labels = self._basis(rows.arrays[0]), rows.arrays[1]
        default_beta = _BETA_STANDARDIZED if self.standardize else _BETA_RAW
        self.beta_ = default_beta if self.beta == "auto" else float(self.beta)
        self.margin_ = _DEFAULT_MARGIN if self.margin == "auto" else float(self.margin)
        data = features, labels, rows.weight
        starts = () if start is None else start.fitted_surfaces.coef
        rng = random_numbers(self.random_state)
        book = resolve_book(self.mode_book, *data, len(self.classes_), rng, *self._program())
        book, fits = fit_mode_book(*data, [book], *self._program(), starts=starts)
        if self.margin == "auto":
            found = nonzero_margin(features, book[labels], rows.weight, fits, *self._program()[1:])
            self.margin_ = found or _DEFAULT_MARGIN
            book, fits = fit_mode_book(*data, [book], *self._program())
        vars(self).update(self._fitted(features, labels, rows, book, fits))
        return self

    def predict(self, X):
        """Class of every sample, shape (n_samples,)."""
        return self.decode(self.surface_values(X))

    def decode(self, values):
        """Class for given values of the surfaces, (n_samples, n_surfaces) -> (n_samples,)."""
        return self.classes_[self._class_decisions(values).argmax(axis=1)]

    def decision_function(self, X):
        """Decision of every sample.

        Returns
        -------
        ndarray of shape (n_samples,) for two classes, else (n_samples, n_classes)
            For two classes the normalised surface, positive for ``classes_[1]``; else
            min_l s_jl f_l(x) / m_l for every class j.
        """
        decided = self._class_decisions(self.surface_values(X))
        return decided[:, 1] if len(self.classes_) == 2 else decided

    def predict_proba(self, X):
        """Probability of every class, shape (n_samples, n_classes).

        `class_posterior`; for two classes its mean at the same decision, so that both rank alike.
        """
        features = self._features(X)
        if len(self.classes_) != 2:
            return self._posterior(features)
        return self._posterior.of_decisions(features, self._basis(self._places))

    def class_posterior(self, X):
        """Probability of every class from all surfaces that the data allow and training errors."""
        features = self._features(X)
        return self._posterior(features)

    def use_likelihood(self, X, log_likelihood, sample_weight=None):
        """Let `predict_proba` know how sure the labels are; the surfaces stay as they are.

        `log_likelihood` (n_samples, n_classes) counts up to a constant a row. Returns itself.
        """
        rows = canonical_rows(rows_of(self, X), log_likelihood, sample_weight=sample_weight)
        features = self._basis(rows.arrays[0])
        self._posterior = self._posterior.with_likelihood(features, rows.arrays[1], rows.weight)
        return self

    def surface_values(self, X):
        """Values f_l(x) of all surfaces, not normalised, shape (n_samples, n_surfaces)."""
        return self._features(X) @ self._fitted_coef.T  # the user's own may cancel far from zero

    def surface_features(self, X):
        """The user's own monomials (or columns of the library), (n_samples, n_surface_features)."""
        X = rows_of(self, X)
        return self._basis.of_user(X)

    def surface_values_at(self, point):
        """Values of all surfaces at one point, shape (n_surfaces,), without checks."""
        return self._fitted_coef @ self._basis.at(point)

    def mode_penalty(self, X):
        """Slack that each class would cost each sample, shape (n_samples, n_classes).

        ``sum_l max(0, margin - s_jl f_l(x))``; with weights and `complexity_` the LP's objective.
        """
        values = self.surface_values(X)
        return self.fitted_surfaces.penalty(values)

    @property
    def powers(self):
        """Exponents of the columns in each feature of `coef_`; None if these are no monomials."""
        return self._basis.exponents

    @property
    def fitted_surfaces(self):
        """The surfaces and their margin LP, as a pass over many rows needs them."""
        surfaces = self._basis, self._fitted_coef, self.mode_book_, self.classes_
        return FittedSurfaces(*surfaces, *self._program())

    def refitted(self, fits, X, y, sample_weight):
        """A copy with other surfaces, one `SurfaceFit` each, fitted to more rows than these."""
        other, labels = copy(self), np.searchsorted(self.classes_, y)
        rows = canonical_rows(X, labels, sample_weight=sample_weight)
        features = self._basis(rows.arrays[0])
        vars(other).update(self._fitted(features, rows.arrays[1], rows, self.mode_book_, fits))
        return other

    def relabelled(self, names):
        """A copy in which class c is called ``names[c]``; `refitted` makes it a fitted one."""
        other, names = copy(self), names[self.classes_]
        order = np.argsort(names)
        other.classes_, other.mode_book_ = names[order], self.mode_book_[order]
        return other

    def moved(self, offset):
        """A copy with the same surfaces among columns that lie further by `offset`."""
        other, places = copy(self), self._places + offset
        vars(other).update(_basis=self._basis.moved(offset), _places=places)
        other.use_coef(self._fitted_coef)
        return other

    def linear_form(self, n_columns):
        """The surfaces as functions of their coefficients."""
        fitted = self._surface_scale, self.mode_book_, self.classes_
        return LinearForm(self._basis.at_rows, self._fitted_coef, *fitted)

    def use_coef(self, coef):
        """Take other coefficients, in the coordinates of `linear_form`."""
        self._fitted_coef, self.coef_ = coef, self._basis.to_user(coef)

    def margin_certificate(self, X, y):
        """What can be promised about the margin on labelled data.

        Solves the linear program of the paper's remark; see `MarginCertificate` for what it proves.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
        y : array-like of shape (n_samples,)
            Labels among `classes_`.

        Returns
        -------
        MarginCertificate
        """
        X, y = rows_and_classes(self, X, y)
        if (unknown := ~np.isin(y, self.classes_)).any():
            raise ValueError(f"y holds the class {y[unknown][0]!r}, which fit has not seen.")
        rows = canonical_rows(X, np.searchsorted(self.classes_, y))
        signs = self.mode_book_[rows.arrays[1]].astype(float)
        return certify_margin(self._basis(rows.arrays[0]), signs, rows.weight, *self._program())

    def equations(self, precision=3, format="text", input_features=None):
        """The surfaces as equations in the user's units.

        Parameters
        ----------
        precision : int, default=3
            Decimals of coefficients of order one.
        format : "text" or "latex", default="text"
        input_features : sequence of str, default=None
            Names of the columns of `X`, those seen in `fit` by default.

        Returns
        -------
        list of str
            One for each surface, such as ``"f0(x0, x1) = -1.500 + 1.000 x0^2 + 1.000 x1^2"``.
        """
        check_fitted(self)
        check_format(format, precision)
        inputs = column_names(self)
        if input_features is not None:
            inputs = names_of_columns("input_features", input_features, self.n_features_in_)
        arguments = ", ".join(symbol(name, format) for name in inputs)
        head = "f_{{{}}}({}) = {}" if format == "latex" else "f{}({}) = {}"
        coef, names, sizes = self._basis.printed(self.coef_, inputs)
        options = {"precision": precision, "style": format, "sizes": sizes}
        sums = (linear_combination(row, names, **options) for row in coef)
        return [head.format(k, arguments, terms) for k, terms in enumerate(sums)]

    def _program(self):
        return self.margin_, self.beta_, float(self.coef_bound), self.solver

    def _fitted(self, features, labels, rows, book, fits):
        """Attributes that surfaces fitted to some rows have."""
        coef = np.array([fit.coef for fit in fits]).reshape(len(fits), features.shape[1])
        values = features @ coef.T
        scale = surface_scale(values, rows.weight)
        slack = np.maximum(0.0, self.margin_ - book[labels] * values)
        status = worst_status(fit.status for fit in fits)
        warn_if_doubtful(status, coef)
        return {
            "_fitted_coef": coef,
            "_surface_scale": scale,
            "mode_book_": book,
            "_places": places_between(rows.arrays[0]),
            "_posterior": ModePosterior.of_labels(features, labels, rows.weight, coef, book, scale),
            "coef_": self._basis.to_user(coef),
            "feature_names_out_": self._basis.names(column_names(self)),
            "slack_": rows.restore(np.where(book[labels] == 0, 0.0, slack)),
            "objective_": float(sum(fit.objective for fit in fits)),
            "complexity_": float(self.beta_ * np.abs(coef).sum()),
            "status_": status,
        }

    def _features(self, X):
        X = rows_of(self, X)
        return self._basis(X)

    def _class_decisions(self, values):
        return decisions(values, self.mode_book_, self._surface_scale)
