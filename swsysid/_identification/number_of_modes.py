"""How many modes: held-out joint cost, and parsimony."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import comb

import numpy as np
from numpy.typing import NDArray

from swsysid._data.features import Monomials
from swsysid._data.rows import thinned_rows
from swsysid._identification.settings import ModeCountSettings
from swsysid._noise import mixed_with_outliers, robust_scale
from swsysid._results import Array
from swsysid._seeding.designs import centre_and_scale, whiten
from swsysid._seeding.experts import Samples, single_model
from swsysid._seeding.seeding import Preparation, Seed, seed_modes
from swsysid._seeding.settings import SeedingSettings
from swsysid._seeding.starts import split_labels

DEFAULTS = ModeCountSettings()


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
        noise = DEFAULTS.standard_errors * self.standard_error + DEFAULTS.free_nats
        return self.excess <= noise


@dataclass(frozen=True)
class _Part:
    """Some rows of the problem, thinned."""

    rows: tuple[Array, Array, Array]  # features, targets and coordinates
    points: Array  # standardised coordinates
    weight: Array
    trajectory: NDArray[np.intp]

    def seed(
        self, n_modes, gate_degree, random_state, settings: SeedingSettings, first_labels=None
    ) -> Seed:
        """The most likely partition of these rows."""
        return seed_modes(
            *self.rows,
            n_modes=n_modes,
            gate_degree=gate_degree,
            sample_weight=self.weight,
            first_labels=first_labels,
            random_state=random_state,
            settings=settings,
        )[0]


def compare_mode_counts(problem, search, random_state) -> tuple[ModeCandidate, ...]:
    r"""Held-out costs of 1, 2, ... modes, until two more neither cost less nor fit better.

    A candidate predicts the velocity of a held-out sample from its coordinates alone: they say
    which mode it is in. With residuals :math:`r_{ik}` in units of the noise :math:`s_k`, the
    smallest robust scale of all candidates, the sample costs

    .. math:: -\log\Big(\exp\big(-\tfrac12 \sum_k (r_{ik} / s_k)^2\big) + e^{-c}\Big)
              \quad\text{nats}, \qquad c = \max(3, n_\text{outputs}) :

    the noise is normal with outliers, of a density that bounds the cost, so that a few samples
    beside a guard, or a few outliers, do not decide. The likelihood of the mixture would not do:
    modes that the coordinates cannot tell apart buy likelihood by mending the shape of the noise
    (uniform, heavy-tailed, uneven), but no better prediction.

    Too few modes may all predict badly, and one more be no better: the search for the best
    number goes on while the likelihood still rises by more than its parameters explain.

    A single sample leaves nothing to compare on.
    """
    if len(problem.weight) < 2:
        return ()
    train, test = _split(problem, search.trajectory, random_state)
    residuals: list[Array] = []
    criteria: list[float] = []
    first_labels, settings = None, problem.settings.mode_count
    for n_modes in range(1, search.parameters.max_modes + 1):
        gate = search.gate_degree, random_state, settings.seeding
        seed = train.seed(n_modes, *gate, first_labels)
        first_labels = split_labels(
            seed.labels, train.points, train.weight, settings.n_splits, random_state
        )
        residuals.append(seed.held_out_residuals(*test.rows))
        criteria.append(_information_criterion(seed, train.weight.sum()))
        totals = [float(test.weight @ cost) for cost in _costs(residuals, test.weight, settings)]
        if _exhausted(totals, criteria, patience=settings.patience):
            break
    return tuple(_candidates(_costs(residuals, test.weight, settings), test))


def smooth_rival(problem, search, n_modes: int, random_state) -> int | None:
    """Degree of one polynomial law that predicts held-out samples better than several modes do."""
    # Where the library lacks a smooth term, modes tile the state space and each of them follows the
    # missing term over its tile. Then one law with the library's features and all monomials of the
    # coordinates up to some degree has a smaller held-out cost (`compare_mode_counts`). None if no
    # degree of at most seven has.
    if n_modes == 1 or len(problem.weight) < 2:
        return None
    settings = problem.settings.mode_count
    train, test = _split(problem, search.trajectory, random_state)
    switching = train.seed(n_modes, search.gate_degree, random_state, settings.seeding)
    affordable = min(settings.most_monomials, train.weight.sum() / settings.rows_a_monomial)
    n_columns = train.points.shape[1]
    degrees = [d for d in settings.smooth_degrees if comb(n_columns + d, d) <= affordable]
    residuals = [switching.held_out_residuals(*test.rows)]
    residuals += [_smooth_residuals(switching.preparation, train, test, d) for d in degrees]
    cost, *smooth = (float(test.weight @ each) for each in _costs(residuals, test.weight, settings))
    limit = cost - settings.free_nats
    return next((d for d, own in zip(degrees, smooth, strict=True) if own < limit), None)


def _smooth_residuals(preparation: Preparation, train: _Part, test: _Part, degree: int) -> Array:
    """Held-out residuals of one robust law of features and monomials, in the units of a seed."""
    monomials = Monomials.up_to(degree, train.points.shape[1])

    def design(part: _Part) -> Array:
        return np.hstack([part.rows[0], monomials(part.points)])

    def samples(part: _Part) -> Samples:
        return preparation(*part.rows, part.weight)

    basis = whiten(design(train), train.weight)
    _, coef, _ = single_model(replace(samples(train), features=basis(design(train))))
    return (samples(test).targets - basis(design(test)).evaluate(coef)).T


def smallest_sufficient(candidates: tuple[ModeCandidate, ...]) -> int:
    """The smallest number of modes that is not shown to be worse than the best; 1 of none."""
    return min((candidate.n_modes for candidate in candidates if candidate.sufficient), default=1)


def _exhausted(*criteria: list[float], patience: int = DEFAULTS.patience) -> bool:
    """True if the last counts are worse than an earlier one by each of some criteria."""
    latest_best = max(int(np.argmin(values)) for values in criteria)
    return len(criteria[0]) - 1 - latest_best >= patience


def _information_criterion(seed: Seed, n_samples: float) -> float:
    """Half of the Bayesian one: negative log-likelihood, and the price of the parameters."""
    n_parameters = seed.experts.coef.size + seed.experts.gate[0, 1:].size
    return 0.5 * n_parameters * float(np.log(n_samples)) - seed.log_likelihood


def _costs(
    residuals: list[Array], weight: Array, settings: ModeCountSettings = DEFAULTS
) -> list[Array]:
    """Cost of every held-out sample under every candidate."""
    smallest = np.min([robust_scale(each, weight) for each in residuals], axis=0)
    scaled = np.array(residuals) / np.maximum(smallest, settings.least_scale)
    most = max(settings.most_nats, scaled.shape[2])
    log_density, _ = mixed_with_outliers(-0.5 * np.square(scaled).sum(axis=2), -most, 0.5)
    return list(np.log(0.5 + 0.5 * np.exp(-most)) - log_density)  # nothing for no residual


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
    settings = problem.settings.mode_count
    whole = int(trajectory.max()) + 1 >= settings.trajectories
    blocks = trajectory if whole else np.arange(len(trajectory))
    n_blocks = int(blocks.max()) + 1
    order = random_state.permutation(n_blocks)
    size = np.bincount(blocks, weights=problem.weight, minlength=n_blocks)[order]
    chosen = order[np.cumsum(size) <= settings.held_out * size.sum()]
    held_out = np.isin(blocks, chosen if len(chosen) else order[:1])
    centre, scale = centre_and_scale(problem.coordinates, problem.weight)
    points = (problem.coordinates - centre) / scale

    def part(kept):
        rows, weight = thinned_rows(np.where(kept, problem.weight, 0.0), settings.most_rows)
        taken = problem.features[rows], problem.targets[rows], problem.coordinates[rows]
        return _Part(taken, points[rows], weight, trajectory[rows])

    return part(~held_out), part(held_out)
