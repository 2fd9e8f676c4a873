"""The sample of many rows: which rows, which weights, and that order and blocks change nothing."""

import numpy as np
import pytest
from many_rows import cut
from scipy.stats import chisquare

from swsysid._data.sampling import Thinned, draw_sample, row_numbers
from swsysid._data.sources import row_blocks


def drawn(X, y, weight=None, n_rows=300, most_rows=0):
    return draw_sample(row_blocks(X, y, weight), n_rows, most_rows)


def some_rows(n_samples=40_000, seed=0):
    """More than a source works on at once, with every row of the last quarter twice."""
    rng = np.random.default_rng(seed)
    values = rng.standard_normal((n_samples, 3))
    values[3 * n_samples // 4 :] = values[: n_samples - 3 * n_samples // 4]
    return values[:, :2], values[:, 2:]


def assert_same_sample(one, two):
    assert np.array_equal(one.rows.X, two.rows.X)
    assert np.array_equal(one.rows.targets, two.rows.targets)
    assert np.array_equal(one.rows.weight, two.rows.weight)
    assert one.n_rows == two.n_rows


def test_three_rows_by_hand():
    """Equal rows are one; the smallest numbers of the others win."""
    X, y = np.array([[1.0], [2.0], [1.0], [3.0]]), np.array([[5.0], [6.0], [5.0], [7.0]])
    numbers = row_numbers(np.hstack([X, y]))
    assert numbers[0] == numbers[2] and len(set(numbers)) == 3
    order = [place for place in np.argsort(numbers, kind="stable") if place != 2]
    sample = drawn(X, y, n_rows=2)
    assert sample.place.tolist() == order[:2]
    assert sample.rows.weight.tolist() == [2.0 if place == 0 else 1.0 for place in order[:2]]
    assert not sample.is_everything and sample.n_rows == 4


@pytest.mark.parametrize("seed", [0, 1])
def test_order_changes_nothing(seed):
    X, y = some_rows()
    order = np.random.default_rng(seed).permutation(len(X))
    one, two = drawn(X, y), drawn(X[order], y[order])
    assert_same_sample(one, two)
    assert np.array_equal(X[order][two.place], one.rows.X)


@pytest.mark.parametrize(
    "ends", [(1,), (20_000,), (7, 9000, 9001, 39_999), tuple(range(500, 40_000, 500))]
)
def test_blocks_change_nothing(ends):
    X, y = some_rows()
    one, two = drawn(X, y), drawn(cut(X, *ends), cut(y, *ends))
    assert_same_sample(one, two)
    assert np.array_equal(one.place, two.place)


@pytest.mark.parametrize("blocks", [False, True])
def test_weight_is_repetition(blocks):
    X, y = some_rows(8000)
    weight = np.random.default_rng(2).integers(0, 4, len(X)).astype(float)
    repeated = np.repeat(np.arange(len(X)), weight.astype(int))
    np.random.default_rng(3).shuffle(repeated)
    given = (X, y, weight)
    if blocks:
        given = tuple(cut(array, 100, 5000) for array in given)
    one, two = drawn(*given), drawn(X[repeated], y[repeated])
    assert np.array_equal(one.rows.X, two.rows.X)
    assert np.array_equal(one.rows.targets, two.rows.targets)
    assert np.array_equal(one.rows.weight, two.rows.weight)


def test_rows_without_weight_are_never_drawn():
    X, y = some_rows(4000)
    weight = np.ones(len(X))
    weight[::2] = 0.0
    sample = drawn(X, y, weight, n_rows=3999)
    assert (weight[sample.place] > 0).all()
    assert sample.rows.weight.sum() == weight.sum()  # so many that every row of weight is there


@pytest.mark.parametrize("n_rows", [1, 299, 300, 5000])
def test_places_and_nesting(n_rows):
    """A place is the first of its row, and a smaller sample begins a larger one."""
    X, y = some_rows()
    sample, larger = drawn(X, y, n_rows=n_rows), drawn(X, y, n_rows=6000)
    assert np.array_equal(sample.rows.X, X[sample.place])
    assert np.array_equal(sample.rows.targets, y[sample.place])
    assert np.array_equal(sample.place, larger.place[:n_rows])
    assert (sample.place < 30_000).all()  # the rows after are repetitions
    assert np.array_equal(sample.rows.weight, 1.0 + (sample.place < 10_000))


@pytest.mark.parametrize(
    "values",
    [
        np.arange(50_000.0),
        np.linspace(0.0, 1.0, 50_000),
        np.sin(np.linspace(0.0, 20.0, 50_000)),
        np.arange(50_000.0) * 2.0**-60,
        np.random.default_rng(0).standard_normal(50_000).astype(np.float32).astype(float),
    ],
    ids=["integers", "grid", "trajectory", "tiny", "single"],
)
def test_sample_is_spread_evenly(values):
    """Chi-square over twenty stretches of the record: a uniform draw fails one test in 10000."""
    X, y = values[:, None], np.zeros((len(values), 1))
    sample = drawn(X, y, n_rows=5000)
    counts = np.bincount(sample.place * 20 // len(values), minlength=20)
    assert chisquare(counts).pvalue > 1e-4
    neighbours = np.bincount(np.diff(np.sort(sample.place)).clip(max=20), minlength=21)[1:]
    share = 0.1 * 0.9 ** np.arange(19)  # gaps of a uniform draw of one in ten
    expected = np.append(share, 1.0 - share.sum()) * neighbours.sum()
    assert chisquare(neighbours, expected).pvalue > 1e-4


def test_few_rows_are_all_returned_as_they_are():
    X, y = some_rows(400)
    weight = np.arange(400.0) % 3
    for given in ((X, y, weight), tuple(cut(array, 150, 151) for array in (X, y, weight))):
        sample = drawn(*given, n_rows=10, most_rows=400)
        assert sample.is_everything
        assert np.array_equal(sample.place, np.arange(400))
        for name, array in (("X", X), ("targets", y), ("weight", weight)):
            assert np.array_equal(getattr(sample.rows, name), array)
    assert not drawn(X, y, weight, n_rows=10, most_rows=399).is_everything


def test_zero_has_no_sign():
    X = np.array([[0.0, 1.0], [-0.0, 1.0]])
    assert drawn(X, np.array([[-0.0], [0.0]]), n_rows=2).rows.weight.tolist() == [2.0]


def test_groups_come_along():
    X, y = some_rows(5000)
    groups = np.array([f"run {number}" for number in range(5)]).repeat(1000)
    whole = draw_sample(row_blocks(X, y, None, groups), 200, 0)
    assert np.array_equal(whole.rows.groups, groups[whole.place])
    ends = (10, 3000)
    parts = draw_sample(row_blocks(cut(X, *ends), cut(y, *ends), None, cut(groups, *ends)), 200, 0)
    assert np.array_equal(parts.rows.groups, whole.rows.groups)


def test_nothing_to_draw_is_refused():
    X, y = np.empty((0, 2)), np.empty((0, 1))
    with pytest.raises(ValueError, match="0 sample"):
        drawn([X, X], [y, y])
    ones = np.ones((3, 2))
    with pytest.raises(ValueError, match="give at least one sample a positive weight"):
        drawn([ones, ones], [ones, ones], [np.zeros(3), np.zeros(3)])


@pytest.mark.parametrize("share", [0.02, 0.3])
def test_thinned_rows_are_those_of_the_smallest_numbers(share):
    X, y = some_rows()
    numbers = row_numbers(np.hstack([X, y]))
    chosen = numbers < share * 2.0**64
    for ends in ((), (7, 9000, 9001, 39_999)):
        source = row_blocks(cut(X, *ends), cut(y, *ends)) if ends else row_blocks(X, y)
        blocks = list(Thinned(source, share).map(lambda rows: rows))
        assert np.array_equal(np.concatenate([block.X for block in blocks]), X[chosen])
        assert np.array_equal(np.concatenate([block.targets for block in blocks]), y[chosen])
    # 30,000 distinct rows: five deviations of a binomial share
    expected = share * 30_000
    assert abs(len(np.unique(numbers[chosen])) - expected) < 5 * np.sqrt(expected)
    smaller = drawn(X, y, n_rows=300)
    assert chosen[smaller.place].all()


def test_blocks_of_which_no_row_is_chosen_are_left_out():
    X, y = some_rows(200)
    blocks = Thinned(row_blocks(cut(X, *range(1, 200)), cut(y, *range(1, 200))), 0.1)
    chosen = row_numbers(np.hstack([X, y])) < 0.1 * 2.0**64
    sizes = list(blocks.map(len))
    assert sizes == [1] * np.count_nonzero(chosen) and 0 < len(sizes) < 200
