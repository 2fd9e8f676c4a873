"""Seeds: planted partitions are found, whatever the order, the units and the repetitions."""

import numpy as np
import pytest
from scipy.special import log_softmax
from sklearn.linear_model import LogisticRegression
from sklearn.preprocessing import PolynomialFeatures

from swsysid._data.rows import thinned_rows
from swsysid._noise import NORMAL, STUDENT
from swsysid._seeding.designs import WhitenedRows, whiten
from swsysid._seeding.experts import (
    em,
    gate_degree_within,
    initial_experts,
    newton_step,
    single_model,
)
from swsysid._seeding.search import same_partition
from swsysid._seeding.seeding import seed_modes
from swsysid._seeding.settings import SeedingSettings
from swsysid._seeding.starts import split_labels

# number of modes, degree of the gate, region of each mode
CASES = {
    "half": (2, 1, lambda x: (x[:, 0] + 0.3 * x[:, 1] > 0.2).astype(int)),
    "circle": (2, 2, lambda x: (np.square(x).sum(axis=1) > 1.2).astype(int)),
    "sectors": (3, 1, lambda x: np.floor(3 * (0.5 + np.arctan2(*x.T) / (2 * np.pi))).astype(int)),
}


def affine_modes(case, corruption="clean", n_samples=600, seed=0):
    """Affine fields in the plane on planted regions: features, targets, coordinates, modes."""
    rng = np.random.default_rng(seed)
    n_modes, degree, region = CASES[case]
    x = rng.uniform(-2, 2, (n_samples, 2))
    modes = region(x)
    features = np.column_stack([np.ones(n_samples), x])
    coef = np.array([[[1, 0.5, -1], [0, 1, 1]], [[-1, -1, 0], [1, 0, -1]], [[0, 1, 1], [-2, 0, 0]]])
    targets = np.einsum("nkp,np->nk", coef[modes], features)
    spread = targets.std(axis=0)
    if corruption == "noise":
        targets = targets + 0.05 * spread * rng.standard_normal(targets.shape)
    if corruption == "outliers":
        hit = rng.random(n_samples) < 0.05
        targets[hit] += 5 * spread * rng.standard_normal((hit.sum(), 2))
    if corruption == "one-sided":
        hit = rng.random(n_samples) < 0.2
        targets[hit] += 50 * spread * rng.uniform(0.8, 1.2, (hit.sum(), 2))
    return features, targets, x, modes, n_modes, degree


def best_seed(case, corruption="clean", **kwargs):
    features, targets, x, modes, n_modes, degree = affine_modes(case, corruption)
    seeds = seed_modes(
        features, targets, x, n_modes=n_modes, gate_degree=degree, random_state=0, **kwargs
    )
    return seeds[0], modes


class TestPlanted:
    @pytest.mark.parametrize("case", CASES)
    def test_exact_data_give_exact_labels(self, case):
        seed, modes = best_seed(case)
        assert same_partition(seed.labels, modes, np.ones(len(modes)), tolerance=0.0)

    # Labels of noisy samples near the guard, and of outliers, are not determined: 2 per cent.
    @pytest.mark.parametrize("corruption", ["noise", "outliers", "one-sided"])
    @pytest.mark.parametrize("case", CASES)
    def test_corrupted_data_give_the_same_partition(self, case, corruption):
        seed, modes = best_seed(case, corruption)
        assert same_partition(seed.labels, modes, np.ones(len(modes)), tolerance=0.02)

    def test_gate_probabilities_generalise(self):
        seed, _ = best_seed("circle", "noise")
        _, _, x, modes, _, _ = affine_modes("circle", n_samples=2000, seed=1)
        guessed = seed.preparation.gate_features(x).evaluate(seed.experts.gate[0]).argmax(axis=0)
        assert same_partition(guessed, modes, np.ones(len(modes)), tolerance=0.03)

    def test_an_easy_problem_stops_after_the_first_batch(self):
        seed, _ = best_seed("half", "noise")
        assert seed.n_starts == 16
        assert seed.hits >= 4

    def test_given_number_of_starts_is_drawn(self):
        assert best_seed("half", n_starts=5)[0].n_starts == 5

    def test_thinned_rows_are_all_labelled(self):
        features, targets, x, modes, n_modes, degree = affine_modes("sectors", "noise", 25_000)
        seeds = seed_modes(
            features, targets, x, n_modes=n_modes, gate_degree=degree, random_state=0
        )
        assert seeds[0].responsibilities.shape == (25_000, 3)
        assert same_partition(seeds[0].labels, modes, np.ones(len(modes)), tolerance=0.01)


class TestInvariance:
    def test_row_order(self):
        features, targets, x, _, _, _ = affine_modes("circle", "noise")
        order = np.random.default_rng(1).permutation(len(x))
        first = seed_modes(features, targets, x, n_modes=2, random_state=0)
        second = seed_modes(features[order], targets[order], x[order], n_modes=2, random_state=0)
        assert len(first) == len(second)
        # the same draws; only sums are rounded in another order
        assert second[0].log_likelihood == pytest.approx(first[0].log_likelihood, rel=1e-6)
        assert same_partition(first[0].labels[order], second[0].labels, np.ones(len(x)), 0.0)

    def test_weights_are_repetitions(self):
        features, targets, x, _, _, _ = affine_modes("circle", "noise", 300)
        counts = np.random.default_rng(2).integers(1, 4, len(x))
        rows = np.repeat(np.arange(len(x)), counts)
        weighted = seed_modes(
            features, targets, x, n_modes=2, sample_weight=counts.astype(float), random_state=0
        )
        repeated = seed_modes(features[rows], targets[rows], x[rows], n_modes=2, random_state=0)
        assert same_partition(weighted[0].labels[rows], repeated[0].labels, np.ones(len(rows)), 0.0)
        # EM stops within 5e-3 nats an iteration, from starts that differ in their neighbours
        assert repeated[0].log_likelihood == pytest.approx(weighted[0].log_likelihood, abs=1.0)

    def test_rows_of_weight_zero_change_nothing(self):
        features, targets, x, _, _, _ = affine_modes("half", "noise", 300)
        weights = np.ones(300)
        weights[::3] = 0.0
        kept = weights > 0
        with_zeros = seed_modes(
            features, targets, x, n_modes=2, sample_weight=weights, random_state=0
        )
        without = seed_modes(features[kept], targets[kept], x[kept], n_modes=2, random_state=0)
        assert (with_zeros[0].labels[kept] == without[0].labels).all()

    def test_units(self):
        features, targets, x, _, _, _ = affine_modes("circle", "outliers", 300)
        units = np.array([1e3, 1e-2])
        plain = seed_modes(features, targets, x, n_modes=2, random_state=0)[0]
        scaled = seed_modes(
            features * [1, 1e2, 1e-3], targets * units, x * [1e2, 1e-3], n_modes=2, random_state=0
        )[0]
        assert (scaled.labels == plain.labels).all()
        expected = plain.log_likelihood - 300 * np.log(units).sum()
        assert scaled.log_likelihood == pytest.approx(expected, abs=1e-3)

    def test_same_random_state_same_answer(self):
        first, _ = best_seed("sectors", "noise")
        second, _ = best_seed("sectors", "noise")
        assert (first.responsibilities == second.responsibilities).all()


class TestDegenerate:
    def test_known_and_constant_outputs_say_nothing(self):
        features, targets, x, _, _, _ = affine_modes("half", "noise", 300)
        plain = seed_modes(features, targets, x, n_modes=2, random_state=0)[0]
        known = np.column_stack([targets[:, 0], x[:, 1], np.full(300, 7.0), targets[:, 1]])
        seed = seed_modes(features, known, x, n_modes=2, random_state=0)[0]
        assert (seed.preparation.informative == [True, False, False, True]).all()
        assert (seed.labels == plain.labels).all()
        assert seed.log_likelihood == pytest.approx(plain.log_likelihood, rel=1e-9)

    def test_data_of_one_exact_model_are_one_mode(self):
        features, _, x, _, _, _ = affine_modes("half", n_samples=50)
        seeds = seed_modes(features, features @ [[1.0], [2.0], [3.0]], x, n_modes=3, random_state=0)
        assert len(seeds) == 1
        assert len(np.unique(seeds[0].labels)) == 1
        assert np.isfinite(seeds[0].responsibilities).all()

    def test_one_mode_is_least_squares(self):
        rng = np.random.default_rng(3)
        features = np.column_stack([np.ones(500), rng.standard_normal((500, 2))])
        noise = rng.uniform(-1, 1, 500)  # no tails: no sample is an outlier
        targets = features @ [1.0, 2.0, 3.0] + noise
        seed = seed_modes(features, targets[:, None], features[:, 1:], n_modes=1)[0]
        assert (seed.responsibilities == 1.0).all()
        basis = seed.preparation.basis.transform
        coef = basis @ seed.experts.coef[0, 0, 0] * seed.preparation.scale[0]
        least_squares = np.linalg.lstsq(features, targets, rcond=None)[0]
        # the outlier class keeps a share of at least 1e-4
        np.testing.assert_allclose(coef, least_squares, atol=1e-3)

    @pytest.mark.parametrize("n_modes", [1, 2, 3])
    @pytest.mark.parametrize("n_samples", [1, 2, 5, 12])
    def test_few_samples(self, n_samples, n_modes):
        rng = np.random.default_rng(n_samples)
        x = rng.standard_normal((n_samples, 3))
        targets = rng.standard_normal((n_samples, 2))
        seeds = seed_modes(x, targets, x, n_modes=n_modes, random_state=0)
        for seed in seeds:
            np.testing.assert_allclose(seed.responsibilities.sum(axis=1), 1.0, atol=1e-12)
            assert seed.responsibilities.shape == (n_samples, n_modes)
            assert np.isfinite(seed.held_out_residuals(x, targets, x)).all()

    @pytest.mark.parametrize("n_coordinates", [1, 15])
    def test_one_and_many_coordinates(self, n_coordinates):
        rng = np.random.default_rng(4)
        x = rng.uniform(-1, 1, (400, n_coordinates))
        modes = (x[:, 0] > 0.1).astype(int)
        targets = np.where(modes == 1, 3 * x[:, 0], -x[:, 0])[:, None] + 0.5 * modes[:, None]
        features = np.column_stack([np.ones(400), x[:, 0]])
        seed = seed_modes(features, targets, x, n_modes=2, random_state=0)[0]
        assert same_partition(seed.labels, modes, np.ones(400))

    def test_gate_degree_follows_the_samples(self):
        assert gate_degree_within(4, 2, 2000, 2) == 4  # 15 monomials
        assert gate_degree_within(4, 2, 60, 2) == 3  # 10 monomials, twelve allowed
        assert gate_degree_within(2, 15, 10_000, 2) == 1  # 136 monomials, fifty allowed
        assert gate_degree_within(2, 15, 3, 3) == 1


class TestHeldOut:
    def test_residuals_are_those_of_the_mode_that_the_coordinates_say(self):
        features, targets, x, _, _, _ = affine_modes("half")
        seed = seed_modes(features, targets, x, n_modes=2, gate_degree=1, random_state=0)[0]
        features, targets, x, modes, _, _ = affine_modes("half", seed=1)
        residuals = seed.held_out_residuals(features, targets, x)
        assert residuals.shape == targets.shape
        right = np.abs(residuals).max(axis=1) < 1e-6  # exact data
        assert right.mean() > 0.98
        # where the gate is wrong, by the difference of the two fields
        affine = features @ np.array([[2, 1.5, -1], [-1, 1, 2]]).T * np.where(modes, -1, 1)[:, None]
        expected = affine[~right] / seed.preparation.scale
        np.testing.assert_allclose(residuals[~right], expected, atol=1e-6)

    def test_residuals_have_no_units(self):
        features, targets, x, _, _, _ = affine_modes("half", "noise", 300)
        plain = seed_modes(features, targets, x, n_modes=2, random_state=0)[0]
        scaled = seed_modes(features, 1e3 * targets, x, n_modes=2, random_state=0)[0]
        np.testing.assert_allclose(
            scaled.held_out_residuals(features, 1e3 * targets, x),
            plain.held_out_residuals(features, targets, x),
            atol=1e-8,
        )


class TestGivenStarts:
    def test_given_labels_join_the_random_starts(self):
        features, targets, x, modes, _, _ = affine_modes("circle", "noise", 300)
        wrong = np.random.default_rng(8).integers(0, 2, 300)
        given = np.array([modes, wrong])
        seed = seed_modes(
            features, targets, x, n_modes=2, n_starts=1, first_labels=given, random_state=0
        )[0]
        assert seed.n_starts == 3
        assert same_partition(seed.labels, modes, np.ones(300), tolerance=0.02)

    def test_number_of_random_starts_is_limited(self):
        rng = np.random.default_rng(9)
        x, noise = rng.standard_normal((400, 2)), rng.standard_normal((400, 2))
        seed = seed_modes(
            x, noise, x, n_modes=4, settings=SeedingSettings(most_starts=16), random_state=0
        )[0]
        assert seed.n_starts == 16

    def test_splits_cut_one_mode_each(self):
        rng = np.random.RandomState(10)
        points, weights = rng.standard_normal((200, 2)), rng.uniform(0.5, 2, 200)
        labels = (points[:, 0] > 0).astype(int)
        splits = split_labels(labels, points, weights, 2, rng)
        assert splits.shape == (4, 200)
        for split, mode in zip(splits, [0, 1, 0, 1], strict=True):
            new = split == 2
            assert (split[~new] == labels[~new]).all()
            assert (labels[new] == mode).all()
            # a share between a fifth and four fifths, one row aside
            share = weights[new].sum() / weights[labels == mode].sum()
            assert 0.18 < share < 0.82


class TestExpectationMaximisation:
    @pytest.mark.parametrize("share", [0.0, 0.02])
    @pytest.mark.parametrize("noise", [STUDENT, NORMAL], ids=["student", "normal"])
    def test_penalised_likelihood_never_falls(self, noise, share):
        features, targets, x, modes, n_modes, _ = affine_modes("sectors", "outliers", 200)
        seed = seed_modes(features, targets, x, n_modes=n_modes, random_state=0, n_starts=1)[0]
        weights = np.random.default_rng(5).integers(1, 3, 200).astype(float)
        samples = seed.preparation(features, targets, x, weights)
        soft = np.random.default_rng(6).dirichlet(np.ones(n_modes), (4, 200)).swapaxes(1, 2)
        experts = initial_experts(samples, soft, single_model(samples)[1], ridge=1e-3)
        experts.outlier_share[:] = share
        _, history = em(samples, experts, noise, ridge=1e-3, max_iter=60, tol=-np.inf)
        assert history.shape == (61, 4)
        # rounding of sums of 200 terms of order ten
        assert (np.diff(history, axis=0) > -1e-7).all()
        assert (history[-1] > history[0] + 1).all()

    @pytest.mark.parametrize("n_modes", [2, 3, 4])
    def test_gate_agrees_with_logistic_regression(self, n_modes):
        rng = np.random.default_rng(n_modes)
        x = rng.standard_normal((300, 2))
        labels = (x @ rng.standard_normal((2, n_modes)) + rng.gumbel(size=(300, n_modes))).argmax(1)
        design = PolynomialFeatures(2).fit_transform(x)
        features = whiten(design, np.ones(300))(design)
        one_hot = np.eye(n_modes)[labels].T[None]
        gate = np.zeros((1, n_modes, 6))
        log_gate = np.full((1, n_modes, 300), -np.log(n_modes))
        for _ in range(30):
            gate, log_gate = newton_step(features, gate, log_gate, one_hot, np.ones(300), 1e-2)
        # 1 / C is the ridge over the sum of losses: 1e-2 * 300. Two classes are one contrast
        # a_1 - a_0 there, whose price in a symmetric softmax is half as high.
        price = 3.0 if n_modes > 2 else 1.5
        independent = LogisticRegression(C=1 / price, fit_intercept=False, tol=1e-10, max_iter=5000)
        expected = independent.fit(features.values.T, labels).predict_proba(features.values.T)
        np.testing.assert_allclose(np.exp(log_gate[0]).T, expected, atol=1e-5)

    def test_gate_step_is_safe_from_a_bad_gate(self):
        rng = np.random.default_rng(7)
        features = WhitenedRows(rng.standard_normal((3, 100)))
        soft = rng.dirichlet(np.ones(3), (5, 100)).swapaxes(1, 2)
        gate = 20 * rng.standard_normal((5, 3, 3))
        gate -= gate.mean(axis=1, keepdims=True)
        log_gate = log_softmax(features.evaluate(gate), axis=1)

        def objective(gate, log_gate):
            return (soft * log_gate).sum(axis=(1, 2)) - 0.5 * np.square(gate).sum(axis=(1, 2))

        for _ in range(10):
            before = objective(gate, log_gate)
            gate, log_gate = newton_step(features, gate, log_gate, soft, np.ones(100), 1e-2)
            assert (objective(gate, log_gate) >= before - 1e-9).all()
            np.testing.assert_allclose(
                log_gate, log_softmax(features.evaluate(gate), axis=1), atol=1e-9
            )


class TestWeightedAlgebra:
    def test_whitened_basis_is_orthonormal_and_nested(self):
        rng = np.random.default_rng(8)
        columns = 1e4 ** rng.uniform(-1, 1, 5) * rng.standard_normal((50, 5))
        design = np.column_stack([columns[:, :3], columns[:, 0] - columns[:, 1], columns[:, 3:]])
        weights = rng.uniform(0.5, 2, 50)
        basis = whiten(design, weights)
        rows = basis(design)
        assert rows.values.shape == (5, 50)  # the dependent column is left out
        np.testing.assert_allclose(rows.gram(weights), weights.sum() * np.eye(5), atol=1e-9)
        assert [basis.count_within(n) for n in range(7)] == [0, 1, 2, 3, 3, 4, 5]

    @pytest.mark.parametrize("limit", [0, 10**9])
    def test_gram_matrices_with_and_without_the_table(self, limit):
        rng = np.random.default_rng(9)
        rows, weights = WhitenedRows(rng.standard_normal((4, 30)), limit), rng.random((2, 3, 30))
        expected = np.einsum("an,bn,rmn->rmab", rows.values, rows.values, weights)
        np.testing.assert_allclose(rows.gram(weights), expected, atol=1e-12)

    def test_thinning_follows_the_weight(self):
        weights = np.random.default_rng(10).uniform(0, 3, 5000)
        rows, counts = thinned_rows(weights, 500)
        assert counts.sum() == 500
        kept = np.zeros(5000)
        kept[rows] = counts / 500
        # a systematic sample: every initial stretch has its share, up to one step
        error = np.abs(np.cumsum(kept) - np.cumsum(weights) / weights.sum())
        assert error.max() <= 1 / 500 + 1e-12

    def test_same_partition_by_hand(self):
        first, second = np.array([0, 0, 1, 1]), np.array([1, 1, 0, 1])
        assert not same_partition(first, second, np.ones(4), tolerance=0.2)
        assert same_partition(first, second, np.ones(4), tolerance=0.25)
        assert same_partition(first, second, np.array([1, 1, 1, 0.0]), tolerance=0.0)
