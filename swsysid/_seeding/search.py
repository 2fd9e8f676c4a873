"""The search for the right basin: batches of soft starts, halved gently, until one repeats."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._data.rows import thinned_rows
from swsysid._noise import NORMAL, Noise, weighted_quantile
from swsysid._results import Array
from swsysid._seeding.experts import Experts, Samples, em, initial_experts, single_model
from swsysid._seeding.misfit import shared_residual
from swsysid._seeding.settings import DEFAULTS, SeedingSettings
from swsysid._seeding.starts import Scene, draw_labels, law_labels
from swsysid.metrics._modes import best_matching, contingency


@dataclass(frozen=True)
class Pool:
    """Mixtures found so far, the most likely first, no two of the same partition."""

    experts: Experts
    hits: NDArray[np.intp]  # (R,): how many starts led to each

    def best(self, count: int) -> Pool:
        """The first of them."""
        return Pool(self.experts.take(slice(count)), self.hits[:count])


def search(
    samples: Samples,
    points: Array,
    *,
    n_modes: int,
    n_starts: int | str,
    first_labels: NDArray[np.intp],
    random_state,
) -> tuple[Pool, int]:
    """Search with Student-t noise, on a part of the rows; also how many starts were drawn."""
    # `points` are standardised coordinates. An int for `n_starts` is that many starts, ``"auto"``
    # draws batches until the best partition was found often enough. `first_labels`, (n_given,
    # n_samples), are starts that join the first batch.
    settings = samples.settings
    rows, weights = thinned_rows(samples.weights, settings.most_searched)
    samples, points, first_labels = samples.take(rows, weights), points[rows], first_labels[:, rows]
    least_squares, single, residuals = single_model(samples)
    if n_modes == 1 or len(samples.targets) == 0:
        one_mode = np.zeros((1, n_modes, len(rows)))
        one_mode[:, 0] = 1.0
        experts = initial_experts(samples, one_mode, single, settings.ridge)
        return Pool(experts, np.ones(1, int)), 1
    typical = np.maximum(weighted_quantile(np.abs(residuals), weights, 0.5), settings.exact)
    scene = Scene(points, (residuals / typical[:, None]).T, weights)
    size = np.minimum(np.abs(least_squares), 1.0) @ weights / weights.sum()
    noise_floor = np.square(settings.coarse_noise * size)
    return _Context(samples, scene, n_modes, single, noise_floor).search(
        n_starts, first_labels, random_state
    )


def refine(samples: Samples, experts: Experts) -> Experts:
    """Final fit: normal noise with the outlier class, the ridge on the gate falling."""
    settings = samples.settings
    share = np.full(len(experts.gate), settings.outlier_share)
    experts = replace(experts.at(samples), outlier_share=share)
    for ridge in settings.final_ridges:
        ridges, max_iter = samples.gate_ridges(ridge), settings.final_iterations
        experts, _ = em(samples, experts, NORMAL, ridge=ridges, max_iter=max_iter)
    return experts


def same_partition(
    first: NDArray[np.intp],
    second: NDArray[np.intp],
    weights: Array,
    tolerance: float = DEFAULTS.same,
) -> bool:
    """True if two labellings differ, up to names, on at most a share of the weight."""
    joint = contingency(first, second, weights)
    return bool(joint[best_matching(joint)].sum() >= (1 - tolerance) * weights.sum())


@dataclass(frozen=True)
class _Context:
    """What all starts of one search share."""

    samples: Samples
    scene: Scene
    n_modes: int
    single: Array  # (n_outputs, n_features): the robust model of all samples
    noise_floor: Array  # (n_outputs,): least variances of the first stages

    def search(self, n_starts, first_labels, random_state) -> tuple[Pool, int]:
        """Draw batches until the best partition was found often enough."""
        settings, limit = self.settings, self._limit(n_starts)
        # Starts from laws draw from a copy: the other starts are the same with and without them.
        law_draws = deepcopy(random_state)
        pools: list[Pool] = []
        drawn = 0
        while drawn < limit:
            indices = range(drawn, min(drawn + settings.batch, limit))
            labels = [draw_labels(self.scene, self.n_modes, i, random_state) for i in indices]
            if not drawn:
                labels += list(first_labels)
            pools.append(self._from_labels(np.array(labels)))
            pools += self._from_laws(self._merged(pools), law_draws)
            drawn = indices.stop
            pool = self._merged(pools)
            needed = settings.hits_at_once if drawn == settings.batch else settings.hits
            if n_starts != "auto" or pool.hits[0] < needed:
                continue
            if not self._leaves_a_field(pool):
                break
            # The residuals are no noise: laws of the rows that are explained badly, once more.
            for _ in range(settings.more_laws):
                pools += self._from_laws(pool, law_draws)
            pool = self._merged(pools)
            if pool.hits[0] >= needed:
                break
        return pool.best(settings.n_kept), drawn + len(first_labels)

    @property
    def settings(self) -> SeedingSettings:
        """Those of the samples."""
        return self.samples.settings

    @property
    def noise(self) -> Noise:
        """Heavy tails: outliers have a bounded pull."""
        return Noise(self.settings.dof)

    def _limit(self, n_starts: int | str) -> int:
        if n_starts != "auto":
            return int(n_starts)
        n_batches = max(len(self.samples.weights) // self.settings.samples_a_batch, 1)
        return min(self.settings.batch * n_batches, self.settings.most_starts)

    def _from_labels(self, labels: NDArray[np.intp]) -> Pool:
        """Soft EM from every start; those that meet before the last stage go on as one."""
        settings, samples = self.settings, self.samples
        coarse = replace(samples, gate_features=samples.gate_features.first(samples.n_coarse))
        soft_labels = self._soft(labels, settings.first_probability)
        experts = initial_experts(coarse, soft_labels, self.single, settings.ridge)
        for iterations, kept in settings.halving:
            experts, history = em(
                coarse, experts, self.noise,
                ridge=settings.ridge, max_iter=iterations, floor=self.noise_floor,
            )  # fmt: skip
            experts = experts.take(np.argsort(-history[-1], kind="stable")[:kept])
        gate = np.zeros((*experts.gate.shape[:2], len(samples.gate_features.values)))
        gate[..., : samples.n_coarse] = experts.gate
        return self._last_stage(replace(experts, gate=gate))

    def _from_laws(self, found: Pool, random_state) -> list[Pool]:
        """Those starts from laws that are soon more likely than all that was found so far."""
        # The stages that tolerate noise would forget that a law is exact, so there are none. The
        # best of many draws are no independent starts: together they find a partition once.
        samples, settings = self.samples, self.settings
        labels = law_labels(samples, self.scene, self.n_modes, random_state)
        ridges, max_iter = samples.gate_ridges(settings.ridge), settings.law_iterations
        experts = initial_experts(samples, self._soft(labels, 1.0), self.single, ridges)
        experts, _ = em(samples, experts, self.noise, ridge=ridges, max_iter=max_iter)
        reached = self._log_likelihood(experts)
        better = reached > self._log_likelihood(found.experts).max() - settings.tied
        if not better.any():
            return []
        pool = self._last_stage(experts.take(better))
        return [replace(pool, hits=np.ones_like(pool.hits))]

    def _last_stage(self, experts: Experts) -> Pool:
        """All gate features, and whatever noise the samples have."""
        pool = self._merged([Pool(experts, np.ones(len(experts.gate), int))])
        ridges = self.samples.gate_ridges(self.settings.ridge)
        max_iter = self.settings.last_iterations
        experts, _ = em(self.samples, pool.experts, self.noise, ridge=ridges, max_iter=max_iter)
        return replace(pool, experts=experts)

    def _soft(self, labels: NDArray[np.intp], share: float) -> Array:
        """Labels (R, N) as probabilities (R, M, N), `share` of them for the label itself."""
        shape = len(labels), self.n_modes, labels.shape[1]
        soft_labels = np.full(shape, (1 - share) / (self.n_modes - 1))
        np.put_along_axis(soft_labels, labels[:, None], share, axis=1)
        return soft_labels

    def _log_likelihood(self, experts: Experts) -> Array:
        return experts.posterior(self.samples, self.noise).log_density @ self.samples.weights

    def _leaves_a_field(self, pool: Pool) -> bool:
        """True if neighbouring samples share what the most likely mixture leaves over."""
        best = pool.experts.take([0])
        labels = best.posterior(self.samples, self.noise).modes[0].argmax(axis=0)
        residuals = best.residuals[0, labels, :, np.arange(len(labels))]
        spread = self.samples.targets.std(axis=1)
        return shared_residual(self.scene.points, residuals, spread, labels).structured

    def _merged(self, pools: list[Pool]) -> Pool:
        """One pool of several, best first: each partition once, with the hits of its starts."""
        settings, weights = self.settings, self.samples.weights
        experts = Experts.concatenate([pool.experts for pool in pools])
        hits = np.concatenate([pool.hits for pool in pools])
        posterior = experts.posterior(self.samples, self.noise)
        value = posterior.log_density @ weights
        labels = posterior.modes.argmax(axis=1)
        leaders: dict[int, int] = {}
        for member in np.argsort(-value, kind="stable"):
            for leader in leaders:
                tied = value[leader] - value[member] <= settings.tied
                tolerance = settings.same_if_tied if tied else settings.same
                if same_partition(labels[leader], labels[member], weights, tolerance):
                    leaders[leader] += hits[member]
                    break
            else:
                leaders[member] = hits[member]
        return Pool(experts.take(list(leaders)), np.array(list(leaders.values())))
