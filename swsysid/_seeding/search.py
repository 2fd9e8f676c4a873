"""The search for the right basin: batches of soft starts, halved gently, until one repeats."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._data.matching import best_matching, contingency
from swsysid._noise import weighted_quantile
from swsysid._results import Array
from swsysid._seeding.experts import (
    VARIANCE_FLOOR,
    Experts,
    Noise,
    Samples,
    em,
    initial_experts,
    single_model,
)
from swsysid._seeding.laws import law_labels
from swsysid._seeding.misfit import shared_residual
from swsysid._seeding.starts import Scene, draw_labels, some_rows

__all__ = ["GAUSSIAN", "MOST_STARTS", "Pool", "refine", "same_partition", "search"]

STUDENT = Noise(3.0)
GAUSSIAN = Noise(np.inf)

_BATCH = 16
# Starts from laws of neighbourhoods that go with every batch.
_LAWS, _LAW_ITERATIONS = 3, 10
# How often more of them are drawn where the answer leaves over more than noise.
_SECOND_LOOKS = 4
MOST_STARTS = 6 * _BATCH
_SAMPLES_A_BATCH = 100  # small problems are searched with fewer batches
_HALVING = ((10, 10), (20, 6))  # iterations, and how many starts are kept after them
_LAST_ITERATIONS = 40
_MAX_ROWS = 3000
_KEPT = 3
_HITS_AT_ONCE, _HITS = 4, 3

_SOFT = 0.98
_RIDGE = 1e-2
_FINAL_RIDGES = (1e-2, 1e-3, 1e-4)
_FINAL_ITERATIONS = 25
# Ridge on what polynomials of degree two cannot say: noisy labels do not determine it, and a
# gate that is free to is fitted to them.
_FINE_RIDGE = 0.1
# Noise assumed by the first stages, as a share of the single model's residual. With less, a
# start on exact data freezes with a few per cent of the samples written off as outliers.
_COARSE_NOISE = 0.1
_OUTLIER_START = 0.02
_TOLERANCE = 5e-3

# Two partitions are the same if they differ on at most this share of the weight; or, where
# noise makes labels fuzzy, on the larger share if their likelihoods agree within _NATS.
_SAME, _SAME_IF_TIED, _NATS = 0.005, 0.03, 2.0


@dataclass(frozen=True)
class Pool:
    """Mixtures found so far, the most likely first, no two of the same partition.

    Attributes
    ----------
    experts : Experts
    hits : ndarray of shape (R,), int
        How many starts led to each.
    """

    experts: Experts
    hits: NDArray[np.intp]


def search(
    samples: Samples,
    points: Array,
    *,
    n_modes: int,
    n_starts: int | str,
    most_starts: int,
    first_labels: NDArray[np.intp],
    n_coarse: int,
    random_state,
) -> tuple[Pool, int]:
    """Search with Student-t noise, on at most 3000 rows.

    Parameters
    ----------
    samples : Samples
    points : ndarray of shape (n_samples, n_coordinates)
        Standardised coordinates.
    n_modes : int
    n_starts : int or "auto"
        An int is that many starts. ``"auto"`` draws batches of sixteen until the best partition
        was found four times in the first or three times in several.
    most_starts : int
        Limit of ``"auto"``.
    first_labels : ndarray of shape (n_given, n_samples), int
        Starts that join the first batch.
    n_coarse : int
        How many gate features span the polynomials up to degree two; the first stages use
        only those.
    random_state : RandomState

    Returns
    -------
    pool : Pool
        At most three members.
    n_starts : int
        How many starts were drawn.
    """
    rows, weights = some_rows(points, samples.weights, _MAX_ROWS, random_state)
    samples = samples.take(rows, weights)
    least_squares, single, residuals = single_model(samples)
    if n_modes == 1 or len(samples.targets) == 0:
        one_mode = np.zeros((1, n_modes, len(rows)))
        one_mode[:, 0] = 1.0
        return Pool(initial_experts(samples, one_mode, single, _RIDGE), np.ones(1, int)), 1
    typical = np.maximum(weighted_quantile(np.abs(residuals), weights, 0.5), 1e-7)
    scene = Scene(points[rows], (residuals / typical[:, None]).T, weights)
    size = np.minimum(np.abs(least_squares), 1.0) @ weights / weights.sum()
    floor = np.maximum(np.square(_COARSE_NOISE * size), VARIANCE_FLOOR)
    limit = _limit(n_starts, most_starts, len(rows))
    # Starts from laws draw from a copy: the other starts are the same with and without them.
    draws = deepcopy(random_state)
    pools: list[Pool] = []
    drawn = 0
    while drawn < limit:
        indices = range(drawn, min(drawn + _BATCH, limit))
        labels = [draw_labels(scene, n_modes, index, random_state) for index in indices]
        if not drawn:
            labels += list(first_labels[:, rows])
        soft_labels = _soften(np.array(labels), n_modes, _SOFT)
        pools.append(_run_batch(samples, soft_labels, single, n_coarse, floor))
        laws = _soften(law_labels(samples, scene, n_modes, _LAWS, draws), n_modes, 1.0)
        pools += _run_laws(samples, laws, single, n_coarse, _merge(samples, pools))
        drawn = indices.stop
        pool = _merge(samples, pools)
        needed = _HITS_AT_ONCE if drawn == _BATCH else _HITS
        if n_starts == "auto" and pool.hits[0] >= needed:
            if not _leaves_a_field(samples, pool, points[rows]):
                break
            # The residuals are no noise: laws of the rows that are explained badly, once more.
            pools += _second_look(samples, scene, n_modes, single, n_coarse, pool, draws)
            pool = _merge(samples, pools)
            if pool.hits[0] >= needed:
                break
    return Pool(pool.experts.take(slice(_KEPT)), pool.hits[:_KEPT]), drawn + len(first_labels)


def refine(samples: Samples, experts: Experts, n_coarse: int) -> Experts:
    """Final fit: Gaussian noise with the outlier class, the ridge on the gate falling."""
    share = np.full(len(experts.gate), _OUTLIER_START)
    experts = replace(experts.at(samples), outlier_share=share)
    for ridge in _FINAL_RIDGES:
        experts, _ = em(
            samples,
            experts,
            GAUSSIAN,
            ridge=_gate_ridge(samples, ridge, n_coarse),
            max_iter=_FINAL_ITERATIONS,
            tol=_tolerance(samples),
        )
    return experts


def same_partition(
    first: NDArray[np.intp], second: NDArray[np.intp], weights: Array, tolerance: float = _SAME
) -> bool:
    """True if two labellings differ, up to names, on at most a share of the weight."""
    joint = contingency(first, second, weights)
    return bool(joint[best_matching(joint)].sum() >= (1 - tolerance) * weights.sum())


def _limit(n_starts, most_starts, n_samples) -> int:
    if n_starts != "auto":
        return int(n_starts)
    return min(_BATCH * max(n_samples // _SAMPLES_A_BATCH, 1), most_starts)


def _soften(labels, n_modes, share) -> Array:
    """Labels (R, N) as probabilities (R, M, N), `share` of them for the label itself."""
    soft_labels = np.full((len(labels), n_modes, labels.shape[1]), (1 - share) / (n_modes - 1))
    np.put_along_axis(soft_labels, labels[:, None], share, axis=1)
    return soft_labels


def _run_batch(samples, soft_labels, single, n_coarse, floor) -> Pool:
    """Soft EM from every start; those that meet before the last stage go on as one."""
    coarse = replace(samples, gate_features=samples.gate_features.first(n_coarse))
    tol = _tolerance(samples)
    experts = initial_experts(coarse, soft_labels, single, _RIDGE)
    for iterations, keep in _HALVING:
        experts, history = em(
            coarse, experts, STUDENT, ridge=_RIDGE, max_iter=iterations, tol=tol, floor=floor
        )
        experts = experts.take(np.argsort(-history[-1], kind="stable")[:keep])
    gate = np.zeros((*experts.gate.shape[:2], len(samples.gate_features.values)))
    gate[..., :n_coarse] = experts.gate
    experts = replace(experts, gate=gate)
    return _last_stage(samples, Pool(experts, np.ones(len(gate), int)), n_coarse)


def _run_laws(samples, soft_labels, single, n_coarse, rival: Pool) -> list[Pool]:
    """Those starts from laws that are soon more likely than all that was found so far.

    The stages that tolerate noise would forget that a law is exact, so there are none. The best of
    many draws are no independent starts: together they find a partition once.
    """
    ridge = _gate_ridge(samples, _RIDGE, n_coarse)
    experts = initial_experts(samples, soft_labels, single, ridge)
    tol = _tolerance(samples)
    experts, _ = em(samples, experts, STUDENT, ridge=ridge, max_iter=_LAW_ITERATIONS, tol=tol)
    reached = _log_likelihood(samples, experts)
    better = np.flatnonzero(reached > _log_likelihood(samples, rival.experts).max() - _NATS)
    if not better.size:
        return []
    found = _last_stage(samples, Pool(experts.take(better), np.ones(better.size, int)), n_coarse)
    return [replace(found, hits=np.ones_like(found.hits))]


def _second_look(samples, scene, n_modes, single, n_coarse, rival: Pool, random_state):
    """Pools of some more starts from laws, without those less likely than the best so far."""
    pools: list[Pool] = []
    for _ in range(_SECOND_LOOKS):
        laws = _soften(law_labels(samples, scene, n_modes, _LAWS, random_state), n_modes, 1.0)
        pools += _run_laws(samples, laws, single, n_coarse, rival)
    return pools


def _leaves_a_field(samples, pool: Pool, points) -> bool:
    """True if neighbouring samples share what the most likely mixture leaves over."""
    best = pool.experts.take([0])
    labels = best.posterior(samples, STUDENT).modes[0].argmax(axis=0)
    residuals = best.residuals[0, labels, :, np.arange(len(labels))]
    spread = samples.targets.std(axis=1)
    return shared_residual(points, residuals, spread, labels).structured


def _last_stage(samples, pool: Pool, n_coarse) -> Pool:
    pool = _merge(samples, [pool])
    ridge = _gate_ridge(samples, _RIDGE, n_coarse)
    tol = _tolerance(samples)
    experts, _ = em(samples, pool.experts, STUDENT, ridge=ridge, max_iter=_LAST_ITERATIONS, tol=tol)
    return replace(pool, experts=experts)


def _log_likelihood(samples, experts: Experts) -> Array:
    return experts.posterior(samples, STUDENT).log_density @ samples.weights


def _gate_ridge(samples, ridge, n_coarse) -> Array:
    ridges = np.full(len(samples.gate_features.values), max(ridge, _FINE_RIDGE))
    ridges[:n_coarse] = ridge
    return ridges


def _tolerance(samples) -> float:
    return max(_TOLERANCE, 1e-6 * samples.weights.sum())


def _merge(samples, pools) -> Pool:
    """One pool of several: best first, each partition once, with the hits of all that share it."""
    experts = Experts.concatenate([pool.experts for pool in pools])
    hits = np.concatenate([pool.hits for pool in pools])
    posterior = experts.posterior(samples, STUDENT)
    value = posterior.log_density @ samples.weights
    labels = posterior.modes.argmax(axis=1)
    leaders: dict[int, int] = {}
    for member in np.argsort(-value, kind="stable"):
        for leader in leaders:
            tied = value[leader] - value[member] <= _NATS
            tolerance = _SAME_IF_TIED if tied else _SAME
            if same_partition(labels[leader], labels[member], samples.weights, tolerance):
                leaders[leader] += hits[member]
                break
        else:
            leaders[member] = hits[member]
    return Pool(experts.take(list(leaders)), np.array(list(leaders.values())))
