"""Modes of rows beside smooth laws of one mode, by the rates of rows that none has seen."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import clone

from swsysid._checks.estimators import column_names, in_fitted_form, rows_and_velocities
from swsysid._checks.parameters import shown
from swsysid._data.trajectories import group_labels
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._results import Array
from swsysid._verdict.comparison import Comparison, Rival, Split, count_switches, hold_out
from swsysid._verdict.same import is_same
from swsysid._verdict.settings import JUDGING
from swsysid._verdict.terms import Terms
from swsysid._verdict.verdict import SwitchingVerdict

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Rows:
    """States and inputs, which may have names; rates; and the trajectory of each row."""

    X: Array | pd.DataFrame
    Xdot: Array
    groups: NDArray
    n_known: int = 0  # rates, the first, that follow a law which is known

    def fitted(
        self, estimator: SwitchingSystemRegressor, some: NDArray
    ) -> SwitchingSystemRegressor:
        """A fit to some rows for comparison: what it warns about is no news of the model."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return estimator.fit(self.of(some), self.Xdot[some], groups=self.groups[some])

    def of(self, some: NDArray) -> Array | pd.DataFrame:
        """States and inputs of some rows."""
        return self.X[some]


def compared_rows(
    model: SwitchingSystemRegressor,
    rows: Rows,
    split: Split,
    terms: Terms,
    estimator: Callable[[Terms, int], SwitchingSystemRegressor],
) -> Comparison:
    """The modes of a model, searched for in the training rows alone, against smooth laws.

    `estimator` gives the one, not fitted, of so many modes whose laws have some terms.
    """
    Xdot, train = rows.Xdot, split.train
    shares = np.bincount(model.modes_[train], minlength=model.n_modes_) / train.sum()
    is_seen = shares >= JUDGING.rare_mode
    judged = split.test & is_seen[model.modes_]
    judged = judged if judged.any() else split.test

    def errors(each: Terms, n_modes: int) -> Array:
        asked = estimator(each, n_modes)
        if each != terms:  # what is known is said of the declared terms
            asked = asked.set_params(known=None)
        fitted = rows.fitted(asked, train)
        left = Xdot[judged] - fitted.predict(rows.of(judged))
        return np.asarray(left[:, rows.n_known :])

    smooth = [terms, *terms.richer(int(train.sum()))]
    predicted = model.predict_modes(rows.X)
    constant = bool(model.n_modes_ > 1 and (predicted == predicted[0]).all())
    laws = model.mode_velocities(rows.of(judged))
    told = Xdot[judged] - laws[model.modes_[judged], np.arange(judged.sum())]
    columns = np.asarray(rows.of(judged), dtype=float)

    def rival(each: Terms) -> Rival:
        return Rival(each, errors(each, 1), is_same(each, terms, columns, predicted[judged]))

    return Comparison(
        errors=errors(terms, int(is_seen.sum())),
        rivals=tuple(map(rival, smooth)),
        spread=Xdot[judged, rows.n_known :].std(axis=0),
        n_switches=count_switches(predicted, rows.groups),
        constant=constant,
        told_by_rates=None if np.isnan(model.guard_score_) else told[:, rows.n_known :],
        untested=tuple(int(mode) for mode in np.flatnonzero(~is_seen)),
    )


def switching_verdict(
    model: SwitchingSystemRegressor,
    X: ArrayLike,
    Xdot: ArrayLike,
    groups: ArrayLike | None = None,
) -> SwitchingVerdict:
    """Whether the modes of a fitted regressor are to be believed, judged on rows held out.

    Of five trajectories or more three tenths are held out whole, of fewer the last three tenths of
    each. Modes, and smooth laws of one mode (the same terms, one and two degrees more, and sines),
    are fitted without them, and their errors of the velocities compared. Recordings without
    velocities are judged by rollouts: `TrajectoryIdentifier.verdict_`.

    Parameters
    ----------
    model : SwitchingSystemRegressor
        Fitted to these rows.
    X : array-like or data frame of shape (n_samples, n_states + n_inputs)
    Xdot : array-like of shape (n_samples, n_states) or (n_samples,)
        Measured velocities (next states in discrete time).
    groups : array-like of shape (n_samples,), default=None
        Trajectory of each row, rows in time order. None is one trajectory.

    Returns
    -------
    SwitchingVerdict
        Prints as a table of errors and a sentence; ``trusted`` is the answer.

    Raises
    ------
    TypeError, ValueError
        If the model is none or was fitted to other rows, or the data make no sense.

    Examples
    --------
    Two stiffnesses, and a spring that is cubic:

    >>> import numpy as np
    >>> from swsysid import SwitchingSystemRegressor
    >>> from swsysid.diagnosis import switching_verdict
    >>> rng = np.random.default_rng(0)
    >>> X = rng.uniform(-1, 1, (1500, 1))
    >>> noise = 0.3 * rng.standard_normal(X.shape)
    >>> for Xdot in (-np.where(X > 0, 5.0, 1.0) * X, -X - 3.0 * X**3):
    ...     model = SwitchingSystemRegressor(feature_library=1, random_state=0)
    ...     verdict = switching_verdict(model.fit(X, Xdot + noise), X, Xdot + noise)
    ...     print(verdict.trusted, verdict.kind.name, verdict.best_law)
    True SWITCHES quadratic
    False SMOOTH cubic
    """
    if not isinstance(model, SwitchingSystemRegressor):
        raise TypeError(f"model={shown(model)} must be a fitted SwitchingSystemRegressor.")
    rates = rows_and_velocities(model, X, Xdot)[1]
    rates = rates.reshape(len(rates), -1)
    if len(rates) != len(model.modes_):
        raise ValueError(
            f"X has {len(rates)} rows and the model was fitted to {len(model.modes_)}; give those."
        )
    rows = Rows(in_fitted_form(model, X), rates, group_labels(groups, len(rates)))
    split = hold_out(rows.groups, JUDGING.fraction, 0)

    # labels that a fit began from are those of all rows
    common = {"init": model.init if isinstance(model.init, str) else "auto", "verbose": 0}

    def estimator(terms: Terms, n_modes: int) -> SwitchingSystemRegressor:
        library = terms.library(model.n_features_in_)
        return clone(model).set_params(n_modes=n_modes, feature_library=library, **common)

    terms = Terms.of(model.feature_library, model.n_features_in_)
    comparison = compared_rows(model, rows, split, terms, estimator)
    rate = "{}" if model.discrete_time else "{}'"
    names = column_names(model)[: rates.shape[1]]
    return SwitchingVerdict(
        comparison,
        model.n_modes_,
        model.n_modes,
        tuple(rate.format(name) for name in names),
        str(terms),
        int(split.train.sum()),
        split.whole_groups,
        model.n_modes_ > 1,
    )
