"""The paper's Problem 1 as it stands: dynamics and modes together, a mixed-integer program.

Exact and slow: the search space grows exponentially with the samples. It is the ground truth
for the gap of the alternation on some tens of samples.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array, eye_array, hstack, kron, vstack

from swsysid._checks.arrays import names_of, refuse_vanishing, table
from swsysid._checks.parameters import MOST_MODES, real, whole
from swsysid._data.features import FeatureMap
from swsysid._known.known import known_laws
from swsysid._known.region import Region
from swsysid._results import Array, Status
from swsysid._solvers.conic import mixed_integer_program, require_solution

_NO_SURFACE = "the program has none"
# Gap, relative to the sizes of residuals and targets, that the tolerances of HiGHS may leave.
_PROVED = 1e-6


@dataclass(frozen=True)
class MipResult:
    """Answer of the exact mixed-integer program, `solve_mip`.

    Attributes
    ----------
    objective : float
        Sum of absolute residuals of the best solution found.
    bound : float
        Proved lower bound on the optimum.
    gap : float
        `objective` - `bound`.
    coef : ndarray of shape (n_modes, n_states, n_features_out)
    modes : ndarray of shape (n_samples,), int
    status : Status
    """

    objective: float
    bound: float
    gap: float
    coef: Array
    modes: NDArray[np.intp]
    status: Status


def solve_mip(
    X,
    y,
    n_modes: int = 2,
    *,
    feature_library=None,
    coef_bound: float = 10.0,
    time_limit: float = 60.0,
    known=None,
) -> MipResult:
    r"""Identify dynamics and modes to global optimality (paper, Problem 1 with the l1 cost).

    .. math:: \min_{C, b, \delta} \sum_{i,k} \delta_{ik} \quad\text{s.t.}\quad
        \pm (\dot x_{ik} - c_{jk}^T \Phi(x_i)) \le \delta_{ik} + B_{ik} (1 - b_{ij}), \\
        \sum_j b_{ij} = 1, \; |C| \le \eta, \; \ell \le A c \le u, \; b \in \{0, 1\}

    :math:`B_{ik} = |\dot x_{ik}| + \eta \|\Phi(x_i)\|_1` is the largest residual that the
    coefficient bound :math:`\eta` allows; :math:`\ell \le A c \le u` is what is `known` of all
    coefficients c. Modes are numbered in the order of their first sample.

    Parameters
    ----------
    X : array-like of shape (n_samples, n_states + n_inputs)
        States, then inputs.
    y : array-like of shape (n_samples, n_states)
        Velocities of the states (next states in discrete time).
    n_modes : int, default=2
    feature_library : None, int, transformer or PySINDy library, default=None
        None is the state itself, an integer all monomials up to that degree.
    coef_bound : float, default=10.0
        Bound on every coefficient. The smaller, the faster.
    time_limit : float, default=60.0
        In seconds. When it is reached, the best solution and the proved bound come back.
    known : Known or list of str, default=None
        What is known of the laws before, by the names of the columns of `X` (x0, x1, ... where
        they have none).

    Returns
    -------
    MipResult

    Raises
    ------
    ValueError
        If the data contain NaN or have the wrong shape, a parameter is out of its range, or what
        is known names what is not there or contradicts itself.

    Examples
    --------
    Velocity x on one side, -2x on the other:

    >>> import numpy as np
    >>> from swsysid import solve_mip
    >>> X = np.array([[1.0], [2.0], [3.0], [-1.0], [-2.0], [-3.0]])
    >>> result = solve_mip(X, np.where(X > 0, X, -2.0 * X))
    >>> result.coef.ravel(), result.modes
    (array([ 1., -2.]), array([0, 0, 0, 1, 1, 1]))
    >>> result.status.ok, round(result.gap, 9)
    (True, 0.0)
    """
    laws, given = known_laws(known, _NO_SURFACE), X
    X = table("X", X)
    y = table("y", y, n_rows=len(X))
    for name, values in (("X", X), ("y", y)):
        refuse_vanishing(name, values)
    whole("n_modes", n_modes, most=MOST_MODES)
    real("coef_bound", coef_bound, above=0)
    if not (isinstance(time_limit, float) and time_limit == np.inf):
        real("time_limit", time_limit, above=0)
    feature_map = FeatureMap(feature_library, X, names_of(given, X.shape[1], "x"))
    features, equations = feature_map(X), feature_map.names_in[: y.shape[1]]
    # The solver's tolerances are absolute: targets and features enter in units of their size.
    unit = float(np.abs(y).max()) or 1.0
    feature_units = np.abs(features).max(axis=0)
    feature_units[feature_units == 0] = 1.0
    region = None
    if laws is not None:
        if y.shape[1] > X.shape[1]:
            raise ValueError("known names laws by columns of X, of which y has more than X.")
        region = laws.region(equations, list(map(str, feature_map.names_out)), n_modes)
        if region.cones:
            raise ValueError(
                "known has an energy that never rises, which is no linear program; leave it out, "
                "or say it to SwitchingSystemRegressor(known=...)."
            )
    program = _Program.build(
        features / feature_units, y / unit, n_modes, coef_bound * feature_units / unit
    )
    if region is not None:
        program = program.within(region, unit / feature_units)
    coef, modes, bound, status = program.solve(time_limit)
    if region is not None and status is not Status.FAILED and not np.isfinite(coef).all():
        raise ValueError(
            f"known allows no coefficients up to coef_bound={coef_bound}; give a larger one."
        )
    if status is not Status.TIME_LIMIT:  # then the best point so far, if any, is the answer
        require_solution(status, "mixed-integer program")
    coef = np.clip(coef * unit / feature_units, -coef_bound, coef_bound)
    objective = float(np.abs(y - np.einsum("ikp,ip->ik", coef[modes], features)).sum())
    # No sum of absolute values is below zero, and no bound above a value that is reached.
    bound = min(max(float(bound) * unit, 0.0), objective)
    unproved = objective - bound > _PROVED * (objective + float(np.abs(y).sum()))
    if status is Status.OPTIMAL and unproved:
        status = Status.INACCURATE
    return MipResult(objective, bound, objective - bound, coef, modes, status)


@dataclass(frozen=True)
class _Program:
    """The mixed-integer program in units of order one.

    Variables, in this order: coefficients (mode, state, feature), slacks delta (state, sample),
    binaries b (mode, sample). Rows follow the same habit, the sample running fastest.
    """

    shape: tuple[int, int, int, int]
    matrix: csr_array
    low: Array
    high: Array
    bounds: Array
    knows: bool = False  # rows of what is known stand after those of the program

    def within(self, region: Region, unit: Array) -> _Program:
        """The same with what is known of coefficients in the user's units, `unit` times these."""
        rows = csr_array((region.matrix * unit).reshape(len(region.matrix), -1))
        rows = hstack([rows, csr_array((rows.shape[0], len(self.bounds) - rows.shape[1]))])
        return replace(
            self, matrix=csr_array(vstack([self.matrix, rows])), knows=True,
            low=np.append(self.low, region.lower), high=np.append(self.high, region.upper),
        )  # fmt: skip

    @classmethod
    def build(cls, features, targets, n_modes, coef_bounds) -> _Program:
        """Assemble the program; `coef_bounds` (n_features,) are those of the scaled features."""
        (n_samples, n_features), n_states = features.shape, targets.shape[1]
        n_rows = n_modes * n_states * n_samples
        velocities = targets.T.ravel()
        largest = np.abs(targets) + (np.abs(features) @ coef_bounds)[:, None]
        fields = kron(eye_array(n_modes * n_states), features)
        slacks = kron(np.ones((n_modes, 1)), eye_array(n_states * n_samples))
        switches = kron(
            eye_array(n_modes), vstack([diags_array(largest[:, k]) for k in range(n_states)])
        )
        # delta + C Phi - B b >= xdot - B   and   delta - C Phi - B b >= -xdot - B
        residuals = [hstack([sign * fields, slacks, -switches]) for sign in (1.0, -1.0)]
        low = [np.tile(sign * velocities - largest.T.ravel(), n_modes) for sign in (1.0, -1.0)]
        one_mode, order = _membership_rows(n_modes, n_samples)
        zeros = n_modes * n_states * n_features + n_states * n_samples
        rules = vstack([one_mode, order])
        rules = hstack([csr_array((rules.shape[0], zeros)), rules])
        return cls(
            (n_modes, n_states, n_features, n_samples),
            csr_array(vstack([*residuals, rules])),
            np.concatenate([*low, np.ones(n_samples), np.zeros(order.shape[0])]),
            np.concatenate(
                [np.full(2 * n_rows, np.inf), np.ones(n_samples), np.full(order.shape[0], np.inf)]
            ),
            np.vstack(
                [
                    np.tile(np.column_stack([-coef_bounds, coef_bounds]), (n_modes * n_states, 1)),
                    np.tile([0.0, np.inf], (n_states * n_samples, 1)),
                    np.tile([0.0, 1.0], (n_modes * n_samples, 1)),
                ]
            ),
        )

    def solve(self, time_limit):
        """Coefficients, labels, proved bound and status, in the program's units."""
        n_modes, n_states, n_features, n_samples = self.shape
        n_binaries = n_modes * n_samples
        integrality = np.zeros(len(self.bounds))
        integrality[-n_binaries:] = 1
        found = self._call(integrality, self.bounds, time_limit)
        modes = np.zeros(n_samples, dtype=np.intp)  # what is feasible is so whatever the labels
        if np.isfinite(found.objective):
            modes = found.x[-n_binaries:].reshape(n_modes, n_samples).argmax(axis=0)
        # A binary of 1 - 1e-6 hides a residual behind its large B. With the labels fixed the
        # linear program that is left has none of that.
        fixed = self.bounds.copy()
        labels = (np.arange(n_modes)[:, None] == modes).astype(float).ravel()
        fixed[-n_binaries:] = labels[:, None]
        refined = self._call(np.zeros_like(integrality), fixed, np.inf)
        point = refined.x if np.isfinite(refined.objective) else found.x
        if not np.isfinite(point).all():
            return np.full(self.shape[:3], np.nan), modes, found.bound, found.status
        coef = point[: n_modes * n_states * n_features].reshape(n_modes, n_states, n_features)
        if not self.knows:
            coef[np.bincount(modes, minlength=n_modes) == 0] = 0.0
        return coef, modes, found.bound, found.status

    def _call(self, integrality, bounds, time_limit):
        n_modes, n_states, n_features, n_samples = self.shape
        cost = np.zeros(len(self.bounds))
        first = n_modes * n_states * n_features
        cost[first : first + n_states * n_samples] = 1.0
        return mixed_integer_program(
            cost,
            matrix=self.matrix,
            low=self.low,
            high=self.high,
            integrality=integrality,
            bounds=bounds,
            time_limit=time_limit,
        )


def _membership_rows(n_modes, n_samples):
    """Rows on b: each sample has one mode; a mode opens after the mode before it."""
    # Relabelling the modes changes nothing, so of the n_modes! copies of every solution only the
    # one is kept in which the modes are numbered by their first sample: b[j, i] <= sum of b[j - 1,
    # i'] over i' < i.
    one_mode = kron(np.ones((1, n_modes)), eye_array(n_samples))
    earlier = csr_array(np.tri(n_samples, k=-1))
    order = kron(eye_array(n_modes - 1, n_modes), earlier) - kron(
        eye_array(n_modes - 1, n_modes, k=1), eye_array(n_samples)
    )
    return csr_array(one_mode), csr_array(order)
