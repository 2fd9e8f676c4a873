"""How many modes: held-out joint cost, and parsimony."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import comb

import numpy as np
from numpy.typing import NDArray

from swsysid._noise import weighted_quantile
from swsysid._results import Array
from swsysid._seeding.designs import centre_and_scale, monomials, whiten
from swsysid._seeding.experts import Samples, single_model
from swsysid._seeding.seeding import Preparation, Seed, held_out_residuals, seed_modes
from swsysid._seeding.starts import some_rows, split_labels

__all__ = ["ModeCandidate", "compare_mode_counts", "smallest_sufficient", "smooth_rival"]

# Fraction of the samples held out, and how many rows of either part are looked at.
_HELD_OUT = 0.25
_MOST_ROWS = 3000
# Whole trajectories are held out where there are this many.
_TRAJECTORIES = 4
# Differences of fewer standard errors than this, and this many nats, are noise.
_STANDARD_ERRORS, _FREE_NATS = 2.0, 2.0
# Counts tried beyond the best one before the search gives up.
_PATIENCE = 2
# A count is searched with two batches of random starts and these cuts of every smaller mode.
_STARTS, _SPLITS = 32, 2
# Residuals below this share of an output's typical deviation are none: on exact data the
# comparison must not be about rounding errors.
_FLOOR = 1e-4
# Median size of a standard normal variable.
_NORMAL_MEDIAN = 0.6745
# A sample costs at most this many nats, or one for every output if these are more.
_MOST_NATS = 3.0
# One law with all monomials up to these degrees is compared with several modes, as long as there
# are not too many monomials for the rows.
_SMOOTH_DEGREES, _MOST_MONOMIALS, _ROWS_A_MONOMIAL = (2, 3, 5, 7), 60, 10


@dataclass(frozen=True)
class ModeCandidate:
    """One number of modes, judged on held-out samples.

    Attributes
    ----------
    n_modes : int
    cost : float
        Sum over the held-out samples, in nats.
    excess : float
        How much dearer it is than the cheapest candidate, in nats.
    standard_error : float
        Of `excess`, from the paired differences of the samples, or of the trajectories if
        these vary more.
    """

    n_modes: int
    cost: float
    excess: float
    standard_error: float

    @property
    def sufficient(self) -> bool:
        """True if the data do not show that another candidate is better."""
        return self.excess <= _STANDARD_ERRORS * self.standard_error + _FREE_NATS


@dataclass(frozen=True)
class _Part:
    """Some rows of the problem, thinned; `points` are standardised coordinates."""

    features: Array
    targets: Array
    coordinates: Array
    points: Array
    weight: Array
    trajectory: NDArray[np.intp]


def compare_mode_counts(problem, search, random_state) -> tuple[ModeCandidate, ...]:
    r"""Held-out costs of 1, 2, ... modes, until two more neither cost less nor fit better.

    A candidate predicts the velocity of a held-out sample from its coordinates alone: they say
    which mode it is in. With residuals :math:`r_{ik}` in units of the noise :math:`s_k`, the
    smallest median residual of all candidates, the sample costs

    .. math:: c \left(1 - \exp\Big(-\frac{1}{2c} \sum_k (r_{ik} / s_k)^2\Big)\right)
              \quad\text{nats}, \qquad c = \max(3, n_\text{outputs}) .

    The likelihood of the mixture would not do: modes that the coordinates cannot tell apart
    buy likelihood by mending the shape of the noise (uniform, heavy-tailed, uneven), but no
    better prediction. And the bound keeps a few samples beside a guard, or a few outliers, from
    deciding.

    Too few modes may all predict badly, and one more be no better: the search for the best
    number goes on while the likelihood still rises by more than its parameters explain.

    A single sample leaves nothing to compare on.
    """
    if len(problem.weight) < 2:
        return ()
    train, test = _split(problem, search.trajectory, random_state)
    residuals: list[Array] = []
    criteria: list[float] = []
    labels = np.zeros(len(train.weight), dtype=np.intp)
    for n_modes in range(1, search.max_modes + 1):
        seed = seed_modes(
            train.features,
            train.targets,
            train.coordinates,
            n_modes=n_modes,
            gate_degree=search.gate_degree,
            sample_weight=train.weight,
            most_starts=_STARTS,
            first_labels=split_labels(labels, train.points, train.weight, _SPLITS, random_state)
            if n_modes > 1
            else None,
            random_state=random_state,
        )[0]
        labels = seed.labels
        residuals.append(held_out_residuals(seed, test.features, test.targets, test.coordinates))
        criteria.append(_information_criterion(seed, train.weight.sum()))
        totals = [float(test.weight @ cost) for cost in _costs(residuals, test.weight)]
        if _exhausted(totals, criteria):
            break
    return tuple(_candidates(_costs(residuals, test.weight), test))


def smooth_rival(problem, search, n_modes: int, random_state) -> int | None:
    """Degree of one polynomial law that predicts held-out samples better than several modes do.

    Where the library lacks a smooth term, modes tile the state space and each of them follows the
    missing term over its tile. Then one law with the library's features and all monomials of the
    coordinates up to some degree has a smaller held-out cost (`compare_mode_counts`). None if no
    degree of at most seven has.
    """
    if n_modes == 1 or len(problem.weight) < 2:
        return None
    train, test = _split(problem, search.trajectory, random_state)
    switching = seed_modes(
        train.features,
        train.targets,
        train.coordinates,
        n_modes=n_modes,
        gate_degree=search.gate_degree,
        sample_weight=train.weight,
        most_starts=_STARTS,
        random_state=random_state,
    )[0]
    degrees = [degree for degree in _SMOOTH_DEGREES if _affordable(train, degree)]
    residuals = [held_out_residuals(switching, test.features, test.targets, test.coordinates)]
    residuals += [_smooth_residuals(switching.preparation, train, test, d) for d in degrees]
    cost, *smooth = (float(test.weight @ each) for each in _costs(residuals, test.weight))
    better = (d for d, own in zip(degrees, smooth, strict=True) if own + _FREE_NATS < cost)
    return next(better, None)


def _affordable(train: _Part, degree: int) -> bool:
    n_monomials = comb(train.points.shape[1] + degree, degree)
    return n_monomials <= min(_MOST_MONOMIALS, train.weight.sum() / _ROWS_A_MONOMIAL)


def _smooth_residuals(preparation: Preparation, train: _Part, test: _Part, degree: int) -> Array:
    """Held-out residuals of one robust law of features and monomials, in the units of a seed."""

    def design(part: _Part) -> Array:
        return np.hstack([part.features, monomials(part.points, degree)])

    def samples(part: _Part) -> Samples:
        return preparation(part.features, part.targets, part.coordinates, part.weight)

    basis = whiten(design(train), train.weight)
    _, coef, _ = single_model(replace(samples(train), features=basis(design(train))))
    return (samples(test).targets - basis(design(test)).evaluate(coef)).T


def smallest_sufficient(candidates: tuple[ModeCandidate, ...]) -> int:
    """The smallest number of modes that is not shown to be worse than the best; 1 of none."""
    return min((candidate.n_modes for candidate in candidates if candidate.sufficient), default=1)


def _exhausted(*criteria: list[float]) -> bool:
    """True if the last counts are worse than an earlier one by each of some criteria."""
    latest_best = max(int(np.argmin(values)) for values in criteria)
    return len(criteria[0]) - 1 - latest_best >= _PATIENCE


def _information_criterion(seed: Seed, n_samples: float) -> float:
    """Half of the Bayesian one: negative log-likelihood, and the price of the parameters."""
    n_parameters = seed.experts.coef.size + seed.experts.gate[0, 1:].size
    return 0.5 * n_parameters * float(np.log(n_samples)) - seed.log_likelihood


def _costs(residuals: list[Array], weight: Array) -> list[Array]:
    """Cost of every held-out sample under every candidate."""
    sizes = np.abs(residuals)
    median = weighted_quantile(sizes.swapaxes(1, 2), weight, 0.5).min(axis=0)
    scale = np.maximum(median / _NORMAL_MEDIAN, _FLOOR)
    most = max(_MOST_NATS, sizes.shape[2])
    return list(most * -np.expm1(-np.square(sizes / scale).sum(axis=2) / (2.0 * most)))


def _candidates(costs: list[Array], test: _Part) -> Iterator[ModeCandidate]:
    best = min(costs, key=lambda cost: test.weight @ cost)
    for n_modes, cost in enumerate(costs, start=1):
        excess = cost - best
        yield ModeCandidate(
            n_modes=n_modes,
            cost=float(test.weight @ cost),
            excess=float(test.weight @ excess),
            standard_error=_standard_error(excess, test),
        )


def _standard_error(values: Array, part: _Part) -> float:
    """Of the weighted sum of values: rows of one trajectory may vary together."""
    deviation = values - (part.weight @ values) / part.weight.sum()
    of_rows = part.weight @ np.square(deviation)
    of_trajectories = np.square(np.bincount(part.trajectory, part.weight * deviation)).sum()
    return float(np.sqrt(max(of_rows, of_trajectories)))


def _split(problem, trajectory: NDArray[np.intp], random_state) -> tuple[_Part, _Part]:
    """Rows to fit and rows to judge on: whole trajectories, or single samples of few."""
    n_trajectories = int(trajectory.max()) + 1
    blocks = trajectory if n_trajectories >= _TRAJECTORIES else np.arange(len(trajectory))
    n_blocks = int(blocks.max()) + 1
    order = random_state.permutation(n_blocks)
    size = np.bincount(blocks, weights=problem.weight, minlength=n_blocks)[order]
    chosen = order[np.cumsum(size) <= _HELD_OUT * size.sum()]
    held_out = np.isin(blocks, chosen if len(chosen) else order[:1])
    centre, scale = centre_and_scale(problem.coordinates, problem.weight)
    points = (problem.coordinates - centre) / scale

    def part(kept):
        rows, weight = some_rows(
            points, np.where(kept, problem.weight, 0.0), _MOST_ROWS, random_state
        )
        taken = problem.features, problem.targets, problem.coordinates, points
        return _Part(*(values[rows] for values in taken), weight, trajectory[rows])

    return part(~held_out), part(held_out)
