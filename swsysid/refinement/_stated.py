"""Models that are stated instead of fitted: terms with named parameters, surfaces, laws."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, TransformerMixin

from swsysid._checks.arrays import numbers, table, truth_values
from swsysid._checks.parameters import flag, names_of_columns, shown
from swsysid._data.features import FeatureMap
from swsysid._results import Array, Trajectory
from swsysid._simulation.model import SwitchingModel, WithSwitchingModel
from swsysid._surfaces.mode_books import decisions
from swsysid._surfaces.surface import LinearForm, Surface


class ParametricLibrary(TransformerMixin, BaseEstimator):
    """Terms of a law as functions of named columns and named parameters.

    Parameters
    ----------
    functions : dict of str to callable
        Name of each term and its function; the names of its arguments are columns or
        parameters. It is called with arrays and must treat them element by element.
    columns : sequence of str
        Names of the states, then of the inputs.
    parameters : dict of str to float, default=None
        Values of the named parameters.

    Examples
    --------
    >>> import numpy as np
    >>> from swsysid.refinement import ParametricLibrary
    >>> library = ParametricLibrary(
    ...     {"level": lambda x: x, "overflow": lambda x, L: np.maximum(x - L, 0.0)},
    ...     columns=["x"],
    ...     parameters={"L": 2.0},
    ... )
    >>> library.fit_transform([[1.0], [3.0]])
    array([[1., 0.],
           [3., 1.]])
    """

    def __init__(
        self,
        functions: Mapping[str, Callable],
        columns: Sequence[str],
        parameters: Mapping[str, float] | None = None,
    ):
        self.functions = functions
        self.columns = columns
        self.parameters = parameters

    def fit(self, X, y=None):
        """Check that the functions know all their arguments."""
        known = {*self.columns, *(self.parameters or {})}
        for name, function in self.functions.items():
            unknown = [argument for argument in _arguments(function) if argument not in known]
            if unknown:
                raise ValueError(
                    f"the term {name!r} has the argument {unknown[0]!r}, which is neither a column "
                    f"nor a parameter; name it among columns or parameters."
                )
        return self

    def transform(self, X):
        """Values of all terms, shape (n_samples, n_terms)."""
        return self.evaluate(table("X", X), self.parameters or {})

    def evaluate(self, X: Array, parameters: Mapping[str, ArrayLike]) -> Array:
        """Values of all terms for parameters that may differ from row to row."""
        if X.ndim != 2 or X.shape[1] != len(self.columns):
            raise ValueError(
                f"X has shape {X.shape}; give one column for each of {', '.join(self.columns)}."
            )
        values = {**dict(zip(self.columns, X.T, strict=True)), **parameters}
        terms = np.empty((len(X), len(self.functions)))
        for k, function in enumerate(self.functions.values()):
            terms[:, k] = function(*(values[argument] for argument in _arguments(function)))
        return terms

    @property
    def terms(self) -> list[tuple[Callable, str, tuple[int, ...]]]:
        """Each term as a function of columns, its name, and the columns that it takes."""
        return [self._term(name, function) for name, function in self.functions.items()]

    def _term(self, name: str, function: Callable) -> tuple[Callable, str, tuple[int, ...]]:
        wanted, known = _arguments(function), self.parameters or {}
        places = tuple(self.columns.index(one) for one in wanted if one in self.columns)
        given = [one for one in wanted if one not in self.columns]

        def of_columns(*columns: object) -> object:
            values = dict(zip((self.columns[place] for place in places), columns, strict=True))
            return function(**values, **{one: known[one] for one in given})

        return of_columns, name, places

    def get_feature_names_out(self, input_features=None):
        """Names of the terms."""
        return np.array(list(self.functions), dtype=object)

    def __sklearn_is_fitted__(self) -> bool:
        return True


Output = ParametricLibrary | Callable[[Array], ArrayLike]


class StatedSurface:
    """Surfaces that are linear in given coefficients, and the mode on each side of them.

    Parameters
    ----------
    coef : array-like of shape (n_surfaces, n_surface_features)
        Coefficients of the features of `feature_library`.
    feature_library : int, None, transformer or PySINDy library, default=1
        1 means a constant and the columns; see `SwitchingSystemRegressor`.
    mode_book : array-like of shape (n_modes, n_surfaces), default=None
        Sign of each surface in each mode, 0 where it does not matter. None: with one surface,
        mode 0 where it is negative and mode 1 where it is positive.

    Examples
    --------
    Two modes that meet where the second column is zero:

    >>> from swsysid.refinement import StatedSurface
    >>> surface = StatedSurface([[0.0, 0.0, 1.0]])
    >>> surface.predict([[5.0, -1.0], [5.0, 1.0]])
    array([0, 1])
    """

    def __init__(
        self,
        coef: ArrayLike,
        feature_library: BaseEstimator | int | None = 1,
        mode_book: ArrayLike | None = None,
    ):
        given = numbers("coef", coef)
        if given.ndim not in (1, 2) or not given.shape[-1]:
            raise ValueError(
                f"coef has shape {given.shape}; give one row of coefficients for each surface."
            )
        self.coef_ = np.atleast_2d(given)
        self.feature_library = feature_library
        if mode_book is None:
            if len(self.coef_) != 1:
                raise ValueError(
                    f"{len(self.coef_)} surfaces need a mode_book, (n_modes, {len(self.coef_)}) "
                    "signs."
                )
            mode_book = [[-1], [1]]
        self.mode_book_ = numbers("mode_book", mode_book).astype(np.intp)
        if self.mode_book_.ndim != 2 or self.mode_book_.shape[1] != len(self.coef_):
            raise ValueError(
                f"mode_book has shape {self.mode_book_.shape}; give (n_modes, {len(self.coef_)}) "
                "signs."
            )
        self.classes_ = np.arange(len(self.mode_book_))
        self._map: FeatureMap | None = None

    @classmethod
    def of_one_mode(cls) -> StatedSurface:
        """No surface at all."""
        return cls(np.empty((0, 1)), 0, np.empty((1, 0)))

    @property
    def powers(self) -> None:
        """Of no features: a library makes them."""
        return None

    def surface_values(self, X: ArrayLike) -> Array:
        """Values of all surfaces, (n_samples, n_surfaces)."""
        X = table("X", X)
        return self._features(X.shape[1])(X) @ self.coef_.T

    def surface_values_at(self, point: Array) -> Array:
        """Values of all surfaces at one point."""
        return self.coef_ @ self._features(len(point)).at(point)

    def decode(self, values: Array) -> NDArray[np.intp]:
        """Mode for given values of the surfaces."""
        return decisions(values, self.mode_book_).argmax(axis=1)

    def decision_function(self, X: ArrayLike) -> Array:
        """Decision of every mode, (n_samples, n_modes)."""
        return decisions(self.surface_values(X), self.mode_book_)

    def predict(self, X: ArrayLike) -> NDArray[np.intp]:
        """Mode of every sample."""
        return self.decode(self.surface_values(X))

    def linear_form(self, n_columns: int) -> LinearForm:
        """The surfaces as functions of their coefficients, for rows of so many columns."""
        return LinearForm(
            self._features(n_columns).at_rows,
            self.coef_,
            np.ones(len(self.coef_)),
            self.mode_book_,
            self.classes_,
        )

    def use_coef(self, coef: Array) -> None:
        """Take other coefficients."""
        self.coef_ = coef

    def _features(self, n_columns: int) -> FeatureMap:
        """The features of rows of so many columns."""
        if self._map is None:
            names = [f"x{k}" for k in range(n_columns)]
            self._map = FeatureMap(self.feature_library, np.ones((1, n_columns)), names)
            if self._map.n_features_out != self.coef_.shape[1]:
                raise ValueError(
                    f"the surface has {self.coef_.shape[1]} coefficients for "
                    f"{self._map.n_features_out} features of {n_columns} columns; give one "
                    "coefficient for each feature."
                )
        return self._map


class StatedModel(WithSwitchingModel):
    """A switching system stated by its terms and coefficients, to start a refinement from.

    For states that are not measured there are no velocities to fit, so the law is written down
    with rough coefficients, and `refine` makes them fit the measured rollouts.

    Parameters
    ----------
    feature_library : None, int, transformer, PySINDy library or ParametricLibrary
        The feature map Phi of states and inputs.
    coef : array-like of shape (n_modes, n_states, n_features) or (n_states, n_features)
        Coefficients to start from; two dimensions mean one mode.
    states : sequence of str
        Names of the states.
    inputs : sequence of str, default=()
        Names of the inputs.
    surface : StatedSurface or classifier, default=None
        Says which mode is active; None for one mode.
    free : array-like of bool, of the shape of `coef`, default=None
        Coefficients that may change; None means those that are not zero.
    output : callable or ParametricLibrary, default=None
        What the sensors read, from rows (states, inputs) to (n_samples, n_outputs): clipping, an
        absolute value, a direct term. None: they read states.
    discrete_time : bool, default=False
        The law gives the next state instead of the velocity.

    Examples
    --------
    >>> from swsysid.refinement import StatedModel
    >>> model = StatedModel(None, [[0.0, 1.0], [-1.0, -0.1]], states=["q", "v"])
    >>> for equation in model.equations(precision=1):
    ...     print(equation)
    mode 0: q' = 1.0 v
    mode 0: v' = -1.0 q - 0.1 v
    """

    def __init__(
        self,
        feature_library: BaseEstimator | int | None,
        coef: ArrayLike,
        *,
        states: Sequence[str],
        inputs: Sequence[str] = (),
        surface: Surface | None = None,
        free: ArrayLike | None = None,
        output: Output | None = None,
        discrete_time: bool = False,
    ):
        columns = [*names_of_columns("states", states), *names_of_columns("inputs", inputs)]
        flag("discrete_time", discrete_time)
        self.coef_ = numbers("coef", coef).copy()
        self.coef_ = self.coef_[None] if self.coef_.ndim == 2 else self.coef_
        self.feature_map = FeatureMap(feature_library, np.ones((1, len(columns))), columns)
        self.surface: Surface = StatedSurface.of_one_mode() if surface is None else surface
        self.output, self.discrete_time = output, discrete_time
        wanted = (len(states), self.feature_map.n_features_out)
        if self.coef_.ndim != 3 or self.coef_.shape[1:] != wanted:
            raise ValueError(
                f"coef has shape {np.shape(coef)}; give (n_modes, {wanted[0]}, {wanted[1]}): one "
                "row for each state, one column for each feature."
            )
        if surface is not None and not hasattr(surface, "predict"):
            raise TypeError(f"surface={shown(surface)} must be a StatedSurface or a classifier.")
        if surface is None and len(self.coef_) > 1:
            raise ValueError(
                f"coef has {len(self.coef_)} modes and no surface says which of them is active; "
                "give a StatedSurface."
            )
        self.free = self.coef_ != 0.0 if free is None else truth_values("free", free)
        self.free = self.free[None] if self.free.ndim == 2 else self.free
        if self.free.shape != self.coef_.shape:
            raise ValueError(
                f"free has shape {self.free.shape} and coef {self.coef_.shape}; give one truth "
                "value for each coefficient."
            )

    @property
    def switching_model(self) -> SwitchingModel:
        return SwitchingModel(self.coef_, self.feature_map, self.surface, self.discrete_time)

    def predict(self, X: ArrayLike) -> Array:
        """Velocity (next state in discrete time) at every sample, (n_samples, n_states)."""
        return self.switching_model.predict(self._columns(X))

    def predict_modes(self, X: ArrayLike) -> NDArray[np.intp]:
        """Active mode at every sample."""
        return self.surface.predict(self._columns(X))

    def _columns(self, X: ArrayLike) -> Array:
        return table("X", X, n_columns=len(self.feature_map.names_in))

    def equations(self, precision: int = 3, format: str = "text") -> list[str]:
        """The law of every mode as text or LaTeX."""
        return self.switching_model.equations(precision, format)

    def simulate(self, x0, t, inputs=None, *, input_hold="zero", **options) -> Trajectory:
        """Roll the states out, with switches located; see `SwitchingSystemRegressor.simulate`."""
        known = {"covariance": vars(self).get("covariance_"), "input_hold": input_hold}
        return self.switching_model.simulate(x0, t, inputs, **known, **options)

    def measure(self, x: ArrayLike, inputs: ArrayLike | None = None) -> Array:
        """What the sensors read along a trajectory of the states, (n_samples, n_outputs)."""
        x = table("x", x)
        if self.output is None:
            return x
        u = np.empty((len(x), 0)) if inputs is None else table("inputs", inputs, len(x))
        X = np.concatenate([x, u], axis=1)
        output = self.output
        read = output.transform(X) if isinstance(output, ParametricLibrary) else output(X)
        return np.asarray(read, dtype=float).reshape(len(x), -1)


@lru_cache(maxsize=256)
def _arguments(function) -> tuple[str, ...]:
    return tuple(inspect.signature(function).parameters)
