"""Rows from files, blocks and Dask arrays: the answer of the array, and refusals in a sentence."""

import weakref

import numpy as np
import pandas as pd
import pytest
from many_rows import Lazily, cut, fitted, oscillator, take_for_many

ENDS = (1, 900, 901, 2700)
LIMITS = pytest.mark.parametrize("whole", [1500, 10**6], ids=["sampled", "whole"])


@pytest.fixture(autouse=True)
def many(monkeypatch):
    take_for_many(monkeypatch)


@pytest.fixture
def da():
    return pytest.importorskip("dask.array")


def mapped(folder, name, array, dtype=float):
    """An array as a file mapped into memory, read only."""
    path = folder / f"{name}.npy"
    np.save(path, array.astype(dtype))
    return np.load(path, mmap_mode="r")


class OnDisk:
    """What h5py and Zarr arrays have: shape, dtype, chunks, and slices that are arrays."""

    def __init__(self, array):
        self.array, self.shape, self.dtype = array, array.shape, array.dtype
        self.chunks = (100, *array.shape[1:])

    def __getitem__(self, rows):
        return self.array[rows].copy()


def assert_same(model, reference):
    assert np.array_equal(model.modes_, reference.modes_)
    assert np.abs(model.coef_ - reference.coef_).max() <= 1e-9
    assert model.objective_ == pytest.approx(reference.objective_, rel=1e-9)


# -- every source is the array -------------------------------------------------------------------


@LIMITS
def test_blocks_of_every_kind(monkeypatch, whole):
    take_for_many(monkeypatch, whole)
    X, Xdot, _ = oscillator()
    reference = fitted(X, Xdot)
    kinds = {
        "list": (cut(X, *ENDS), cut(Xdot, *ENDS)),
        "tuple": (tuple(cut(X, *ENDS)), tuple(cut(Xdot, *ENDS))),
        "lists in lists": ([b.tolist() for b in cut(X, 1500)], cut(Xdot, 1500)),
        "lazily": (Lazily(X, 700), Lazily(Xdot, 700)),
        "with empty ones": (cut(X, 0, 5, 5, 4000), cut(Xdot, 0, 5, 5, 4000)),
        "one block": ([X], [Xdot]),
    }
    for name, (blocks, velocities) in kinds.items():
        model = fitted(blocks, velocities)
        assert_same(model, reference)
        if whole > len(X):
            assert np.array_equal(model.coef_, reference.coef_), name
            assert np.array_equal(model.membership_, reference.membership_), name
            assert model.objective_ == reference.objective_, name


@LIMITS
def test_files(monkeypatch, tmp_path, whole):
    take_for_many(monkeypatch, whole, read_at_once=700)
    X, Xdot, _ = oscillator()
    weight = np.random.default_rng(0).integers(0, 3, len(X)).astype(float)
    on_disk = mapped(tmp_path, "X", X), mapped(tmp_path, "y", Xdot)
    reference, weighted = fitted(X, Xdot), fitted(X, Xdot, sample_weight=weight)
    assert_same(fitted(*on_disk), reference)
    assert_same(fitted(OnDisk(X), OnDisk(Xdot)), reference)
    assert_same(fitted(on_disk[0], Xdot), reference)
    assert_same(fitted(on_disk[0], Xdot.tolist()), reference)
    for given in (weight, weight.tolist(), mapped(tmp_path, "w", weight)):
        assert_same(fitted(*on_disk, sample_weight=given), weighted)


@pytest.mark.parametrize("dtype", [np.float32, np.int64])
def test_other_numbers(tmp_path, dtype):
    """Blocks of integers and of single precision are what the array of them is."""
    X, Xdot, _ = oscillator()
    X, Xdot = ((1000 * array).astype(dtype) for array in (X, Xdot))
    reference = fitted(X, Xdot)
    assert_same(fitted(cut(X, *ENDS), cut(Xdot, *ENDS)), reference)
    assert_same(
        fitted(mapped(tmp_path, "X", X, dtype), mapped(tmp_path, "y", Xdot, dtype)), reference
    )


def test_data_frames():
    X, Xdot, _ = oscillator()
    frame, velocities = pd.DataFrame(X, columns=["q", "v"]), pd.DataFrame(Xdot)
    reference = fitted(frame, Xdot)

    def parts(table):
        return [table.iloc[start : start + 900] for start in range(0, 4000, 900)]

    for model in (
        fitted(parts(frame), parts(velocities)),
        fitted(parts(frame), cut(Xdot, 900, 1800, 2700, 3600)),
    ):
        assert_same(model, reference)
        assert model.feature_names_in_.tolist() == ["q", "v"]
        assert model.predict(frame).shape == Xdot.shape
        assert "q" in model.equations()[0]
    series = fitted(parts(frame), parts(velocities[1]))
    assert series.predict(frame).shape == (len(X),)
    assert_same(series, fitted(X, Xdot[:, 1]))


def test_weights_and_groups_in_blocks():
    X, Xdot, _ = oscillator()
    weight = np.random.default_rng(0).integers(0, 3, len(X)).astype(float)
    weight[1:900] = 0.0  # a whole block
    groups = np.repeat([f"run {number}" for number in range(40)], 100)
    options = {"n_modes": "auto", "max_modes": 3}
    reference = fitted(X, Xdot, sample_weight=weight, groups=groups, **options)
    model = fitted(
        *(cut(array, *ENDS) for array in (X, Xdot)),
        sample_weight=cut(weight, *ENDS),
        groups=cut(groups, *ENDS),
        **options,
    )
    assert_same(model, reference)
    assert model.n_modes_ == 2


@LIMITS
def test_dask_arrays(monkeypatch, da, whole):
    take_for_many(monkeypatch, whole)
    X, Xdot, _ = oscillator()
    weight = np.random.default_rng(0).integers(0, 3, len(X)).astype(float)
    reference, weighted = fitted(X, Xdot), fitted(X, Xdot, sample_weight=weight)
    A = da.from_array(X, chunks=(1100, 2))
    for velocities in (
        da.from_array(Xdot, chunks=(1100, 2)),
        da.from_array(Xdot, chunks=(700, 1)),
        Xdot,
    ):
        assert_same(fitted(A, velocities), reference)
    assert_same(fitted(da.from_array(X, chunks=(1500, 1)), velocities), reference)
    for given in (weight, da.from_array(weight, chunks=300)):
        assert_same(fitted(A, velocities, sample_weight=given), weighted)
    one = fitted(A, da.from_array(Xdot[:, 1], chunks=600))
    assert_same(one, fitted(X, Xdot[:, 1]))
    assert one.predict(X).shape == (len(X),)


def test_dask_arrays_of_unknown_length(da):
    X, Xdot, _ = oscillator()
    kept = X[:, 1] > -2.5
    kept[:1000] = False  # a block without rows
    A, Y = da.from_array(X, chunks=(1000, 2)), da.from_array(Xdot, chunks=(1000, 1))
    chosen = da.from_array(kept, chunks=1000)
    reference = fitted(X[kept], Xdot[kept])
    assert_same(fitted(A[chosen], Y[chosen]), reference)
    weight = da.from_array(np.ones(len(X)), chunks=1000)[chosen]
    assert_same(fitted(A[chosen], Y[chosen], sample_weight=weight), reference)


def test_one_block_is_in_memory_at_a_time():
    class Watched(Lazily):
        alive, most, n_read = (), 0, 0

        def __getitem__(self, index):
            self.alive = [block for block in self.alive if block() is not None]
            self.most, self.n_read = max(self.most, len(self.alive)), self.n_read + 1
            block = super().__getitem__(index)
            self.alive.append(weakref.ref(block))
            return block

    X, Xdot, _ = oscillator(20_000)
    blocks, velocities = Watched(X, 2000), Watched(Xdot, 2000)
    model = fitted(blocks, velocities)
    assert blocks.most == velocities.most == 0  # when the next one was read
    # two samples, a pass for each record of the history, and at most as many that were rejected
    assert blocks.n_read <= 3 + 10 * (2 + 2 * model.n_iter_)


# -- what is refused -----------------------------------------------------------------------------


def refused(error, sentence, *arguments, **options):
    with pytest.raises(error, match=sentence):
        fitted(*arguments, **options)


@LIMITS
def test_blocks_that_do_not_fit_together_are_refused(monkeypatch, whole):
    take_for_many(monkeypatch, whole)
    X, Xdot, _ = oscillator()
    A, Y = cut(X, 1000, 2500), cut(Xdot, 1000, 2500)
    refused(ValueError, "Block 2: X has 1500 rows and y 1499", A, [*Y[:2], Y[2][1:]])
    refused(TypeError, "give y as a sequence of as many blocks", A, Y[:2])
    refused(TypeError, "give y as a sequence of as many blocks", A, Xdot)
    refused(ValueError, "Block 0: X has 1000 rows and y 2", A, Xdot[:3])
    same = "give all blocks the same columns in the same order"
    refused(ValueError, f"Block 2 .* {same}", [*A[:2], np.hstack([A[2], A[2]])], Y)
    refused(ValueError, f"Block 1 .* {same}", A, [Y[0], Y[1][:, :1], Y[2]])
    frames = [pd.DataFrame(block, columns=["q", "v"]) for block in A]
    refused(ValueError, f"'v', 'q'.* {same}", [*frames[:2], frames[2][["v", "q"]]], Y)


@LIMITS
def test_blocks_that_hold_no_numbers_are_refused(monkeypatch, whole):
    take_for_many(monkeypatch, whole)
    X, Xdot, _ = oscillator()
    A, Y = cut(X, 1000, 2500), cut(Xdot, 1000, 2500)
    for place, value in (((7, 1), np.nan), ((7, 0), np.inf)):
        third = A[2].copy()
        third[place] = value
        refused(ValueError, "Block 2: Input X contains", [*A[:2], third], Y)
        third = Y[2].copy()
        third[place] = value
        refused(ValueError, "Block 2: Input y contains", A, [*Y[:2], third])
    refused(ValueError, "Block 2: Expected 2D array", [*A[:2], A[2][:, 0]], Y)
    refused(ValueError, "Block 1: Found array with dim 3", A, [Y[0], Y[1][None], Y[2]])
    flat = [block[:1000, 0] for block in A]  # rows of a table, as far as one can see
    refused(ValueError, "dim 3", flat, [block[:1000] for block in Y])
    refused(ValueError, "Expected 2D array", [], [])
    refused(ValueError, "0 sample", [X[:0]], [Xdot[:0]])


def test_weights_and_groups_that_do_not_fit_are_refused():
    X, Xdot, _ = oscillator()
    A, Y = cut(X, 1000, 2500), cut(Xdot, 1000, 2500)
    ones = [np.ones(len(block)) for block in A]
    refused(TypeError, "give sample_weight as a sequence", A, Y, sample_weight=np.ones(len(X)))
    refused(TypeError, "give groups as a sequence", A, Y, groups=np.ones(len(X)))
    short = [*ones[:2], ones[2][1:]]
    refused(ValueError, "Block 2: sample_weight has shape", A, Y, sample_weight=short)
    refused(ValueError, "Block 2: groups has shape", A, Y, groups=short)
    negative = [*ones[:2], -ones[2]]
    refused(ValueError, "Block 2: .*negative weights", A, Y, sample_weight=negative)
    nothing = [0.0 * each for each in ones]
    refused(ValueError, "give at least one sample a positive", A, Y, sample_weight=nothing)


def test_files_that_do_not_fit_are_refused(tmp_path):
    X, Xdot, _ = oscillator()
    A, Y = mapped(tmp_path, "X", X), mapped(tmp_path, "y", Xdot)
    refused(ValueError, "one row for each of the 4000 rows of X", A, Y[1:])
    weight = np.ones(3999)
    refused(ValueError, "sample_weight has shape .3999,.; it must", A, Y, sample_weight=weight)
    refused(ValueError, "give a two-dimensional array", mapped(tmp_path, "x", X[:, 0]), Y)


def test_dask_arrays_that_do_not_fit_are_refused(da):
    X, Xdot, _ = oscillator()
    A, Y = da.from_array(X, chunks=(1000, 2)), da.from_array(Xdot, chunks=(1000, 2))
    refused(ValueError, "one row for each of the 4000 rows of X", A, Y[1:])
    refused(ValueError, "sample_weight has shape", A, Y, sample_weight=np.ones(3999))
    refused(ValueError, "give a two-dimensional array", A[:, 0], Y)
    unknown = A[A[:, 0] > 0.0]
    refused(ValueError, r"call compute_chunk_sizes\(\) on both", unknown, Y.rechunk((2000, 2)))
    refused(ValueError, r"Block \d: X has \d+ rows and y 1000", unknown, Y)
    third = X.copy()
    third[2007, 1] = np.nan
    refused(ValueError, "Block 2: Input X contains NaN", da.from_array(third, chunks=(1000, 2)), Y)


def test_dask_frames_are_refused_with_what_to_give():
    class Frame:
        dask = to_delayed = to_dask_array = None

    X, Xdot, _ = oscillator()
    refused(TypeError, r"give X.to_dask_array\(lengths=True\)", Frame(), Xdot)


# -- predictions ---------------------------------------------------------------------------------


@pytest.mark.parametrize("one_target", [False, True])
def test_predictions_of_blocks(many, da, tmp_path, one_target):
    X, Xdot, _ = oscillator()
    model = fitted(X, Xdot[:, 1] if one_target else Xdot)
    for predict in (model.predict, model.predict_modes, model.predict_mode_proba):
        expected = predict(X)
        assert np.array_equal(predict(mapped(tmp_path, "X", X)), expected)
        blocks = predict(cut(X, 1000, 2500))
        assert [len(block) for block in blocks] == [1000, 1500, 1500]
        assert np.array_equal(np.concatenate(blocks), expected)
        lazy = predict(da.from_array(X, chunks=(1000, 1)))
        assert isinstance(lazy, da.Array) and lazy.shape == expected.shape
        assert lazy.dtype == expected.dtype and np.array_equal(lazy.compute(), expected)


def test_predictions_of_many_rows_go_in_pieces(many):
    X, Xdot, _ = oscillator()
    model = fitted(X, Xdot)
    many = np.tile(X, (9, 1))  # 36,000 rows are three pieces
    assert np.array_equal(model.predict(many), np.tile(model.predict(X), (9, 1)))
    assert np.array_equal(model.predict_modes(many), np.tile(model.predict_modes(X), 9))
