"""Work that is stopped goes on where it was, and ends as the one that never was stopped."""

import errno
import os
import shutil
import signal
import stat
import time
from pathlib import Path

import numpy as np
import pytest
from resumed_work import WORK, digest, done, killed, started
from sklearn.model_selection import GridSearchCV

import swsysid._checkpoints
from swsysid import FunctionLibrary, SwitchingSystemRegressor, TrajectoryIdentifier, best_so_far
from swsysid._journal import handing_over, journal, offer, resumable, step

RNG = np.random.default_rng(0)
X = RNG.uniform(-1.0, 1.0, (200, 2))
XDOT = np.column_stack([X[:, 1], -X[:, 0] - np.where(X[:, 0] > 0.0, 0.1, 0.5) * X[:, 1]])


def switching(folder, **options):
    return SwitchingSystemRegressor(**{"random_state": 0, "checkpoint": folder} | options)


def steps_of(folder):
    return sorted(Path(folder).rglob("*-*.step"))


@step
def drawn(source, n):
    """Random numbers, and a file that says they were drawn."""
    with open("drawn", "a", encoding="utf-8") as file:
        file.write("x")
    return source.standard_normal(n)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path / "checkpoint"


# -- killed ------------------------------------------------------------------------------------


def ends_with_the_same_bits(name, folder, n_kills, seed):
    """Whether work that is killed so often, wherever it is, has the answer of a plain run."""
    began = time.monotonic()
    plain = digest(WORK[name](None))
    usual, rng = time.monotonic() - began, np.random.default_rng(seed)
    for _ in range(n_kills):
        while not killed(name, folder, folder.with_name("answer"), rng.uniform(0.0, 0.7) * usual):
            shutil.rmtree(folder)
    return done(name, folder, folder.with_name("answer")) == plain


@pytest.mark.parametrize("name", sorted(WORK))
def test_killed_work_ends_with_the_same_bits(folder, name):
    assert ends_with_the_same_bits(name, folder, 1, seed=sorted(WORK).index(name))


@pytest.mark.nightly
@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("name", sorted(WORK))
def test_work_that_is_killed_twice_ends_with_the_same_bits(folder, name, seed):
    assert ends_with_the_same_bits(name, folder, 2, seed=100 * sorted(WORK).index(name) + seed)


@pytest.mark.parametrize("name", ["rows", "trajectory", "effects"])
def test_steps_that_are_lost_at_any_place_are_done_anew(folder, name):
    """What any kill leaves is some of the files, perhaps the last of them torn."""
    plain = digest(WORK[name](None))
    WORK[name](str(folder))
    rng = np.random.default_rng(0)
    for _ in range(3):
        files = steps_of(folder)
        for lost in rng.choice(len(files), len(files) // 2, replace=False):
            files[lost].unlink()
        torn = steps_of(folder)[-1]
        torn.write_bytes(torn.read_bytes()[:-1])
        with pytest.warns(RuntimeWarning, match="is torn or another fit's: that step is done"):
            assert digest(WORK[name](str(folder))) == plain


def test_jobs_do_not_matter(folder):
    plain = digest(WORK["rows"](None))
    WORK["rows"](str(folder), n_jobs=2)
    for path in steps_of(folder)[::2]:
        path.unlink()
    assert digest(WORK["rows"](str(folder), n_jobs=1)) == plain


def test_what_is_finished_is_not_done_again(folder):
    began = time.monotonic()
    WORK["trajectory"](str(folder))
    first, began = time.monotonic() - began, time.monotonic()
    WORK["trajectory"](str(folder))
    assert time.monotonic() - began < 0.5 * first  # about a fifth: the data are made, too


@pytest.mark.nightly
def test_no_step_of_a_long_search_takes_half_a_minute(tmp_path):
    """So much is lost at most: between two steps that are written nothing takes longer."""
    from swsysid import EffectSearchCV
    from swsysid.datasets import make_undeclared

    data = make_undeclared("coulomb_friction", system="oscillator", random_state=0)
    written, before = [], Path.write_bytes

    def noted(path, content):
        written.append(time.monotonic())
        return before(path, content)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Path, "write_bytes", noted)
        search = EffectSearchCV(data.estimator, checkpoint=tmp_path / "checkpoint")
        search.fit(data.X, data.Xdot, t=data.t, groups=data.groups)
    assert len(written) > 100 and np.diff(written).max() < 30.0


# -- stopped by hand ---------------------------------------------------------------------------


def test_control_c_says_what_there_is(tmp_path):
    folder, answer = tmp_path / "checkpoint", tmp_path / "answer"
    process = started("effects", folder, answer)
    end = time.monotonic() + 60.0
    while not (folder / "best.step").exists() and time.monotonic() < end:
        time.sleep(0.02)
    time.sleep(0.2)  # the file is there a moment before the step is done with
    process.send_signal(signal.SIGINT)
    told = process.communicate(timeout=30)[1]
    assert process.returncode != 0 and not answer.exists()
    assert f"finished steps are in {str(folder)!r}" in told.splitlines()[-1]
    assert "the same call goes on from there; best_so_far" in told.splitlines()[-1]
    model = best_so_far(folder)
    assert model.predict(np.zeros((1, 3))).shape == (1, 2)
    assert not children_of(process.pid)


def children_of(pid):
    """Processes that one has left behind."""
    left = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text("utf-8").rsplit(")", 1)[1].split()
        except OSError:
            continue
        if int(fields[1]) == pid:
            left.append(path.parent.name)
    return left


def test_interrupted_before_any_step(folder):
    with pytest.raises(KeyboardInterrupt, match="no step was finished yet"):
        with journal(folder, {}):
            for path in steps_of(folder):
                path.unlink()
            raise KeyboardInterrupt


# -- steps -------------------------------------------------------------------------------------


def test_a_step_is_done_once_and_its_source_goes_on(folder):
    answers = []
    for _ in range(2):
        with journal(folder, {"seed": "0"}):
            source = np.random.RandomState(0)
            answers.append([drawn(source, 2), drawn(source, 3), source.standard_normal()])
    assert Path("drawn").read_text("utf-8") == "xx"
    source = np.random.RandomState(0)
    expected = [source.standard_normal(2), source.standard_normal(3), source.standard_normal()]
    for answer in answers:
        assert all(map(np.array_equal, answer, expected))


def test_numpys_own_source_goes_on(folder):
    def work():
        np.random.standard_normal()
        return resumable(np.random.standard_normal)(), np.random.standard_normal()

    np.random.seed(1)
    with journal(folder, {}):
        first = work()
    np.random.seed(2)
    with journal(folder, {}):
        assert work() == first


def test_steps_within_a_finished_step_are_done_with(folder):
    @step
    def outer():
        return [drawn(np.random.RandomState(0), 1) for _ in range(3)]

    with journal(folder, {}):
        outer()
        assert not (folder / "outer-1").exists() and (folder / "outer-1.step").exists()


def test_the_steps_of_an_unfinished_step_are_kept(folder):
    @step
    def outer(stop):
        answer = drawn(np.random.RandomState(0), 1)
        if stop:
            raise ArithmeticError
        return answer

    with pytest.raises(ArithmeticError), journal(folder, {}):
        outer(True)
    with journal(folder, {}):
        outer(False)
    assert Path("drawn").read_text("utf-8") == "x"


def test_without_a_journal_a_step_is_its_function(folder):
    drawn(np.random.RandomState(0), 1)
    drawn(np.random.RandomState(0), 1)
    assert Path("drawn").read_text("utf-8") == "xx" and resumable(len) is len
    offer(1)  # to nobody


def test_a_full_disk_costs_the_checkpoint_and_not_the_fit(folder, monkeypatch):
    plain = switching(None).fit(X, XDOT)
    before = os.replace

    def full(source, target):
        if str(target).endswith(".step"):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        before(source, target)

    monkeypatch.setattr(os, "replace", full)
    with pytest.warns(RuntimeWarning, match="could not be written to .No space left on device"):
        model = switching(folder).fit(X, XDOT)
    assert np.array_equal(model.coef_, plain.coef_)
    files = [path.name for path in folder.rglob("*") if path.is_file()]
    assert files == ["checkpoint.json"]  # no draft is left


# -- refused -----------------------------------------------------------------------------------


def test_a_checkpoint_of_other_data_is_refused(folder):
    switching(folder).fit(X, XDOT)
    before = [path.read_bytes() for path in steps_of(folder)]
    with pytest.raises(ValueError, match=r"is of another fit \(data differs\); name another"):
        switching(folder).fit(X, XDOT + 1e-12)
    with pytest.raises(ValueError, match=r"another fit \(data differs\)"):
        switching(folder).fit(X, XDOT, np.full(len(X), 2.0))
    assert [path.read_bytes() for path in steps_of(folder)] == before


def test_a_checkpoint_of_other_blocks_is_refused(folder):
    blocks = [np.array_split(each, 4) for each in (X, XDOT)]
    switching(folder).fit(*blocks)
    switching(folder, n_jobs=2, verbose=0).fit(*blocks)
    blocks[1][3] = blocks[1][3] + 1e-12
    with pytest.raises(ValueError, match=r"another fit \(data differs\)"):
        switching(folder).fit(*blocks)


def test_a_checkpoint_of_other_recordings_is_refused(folder):
    t = np.arange(0.0, 3.0, 0.1)
    noise = 0.01 * RNG.standard_normal((2, len(t), 1))
    recordings = [{"t": t, "x": np.exp(-t)[:, None] + own} for own in noise]
    identifier = TrajectoryIdentifier(
        SwitchingSystemRegressor(1, random_state=0), checkpoint=folder
    )
    first = identifier.fit([lambda one=one: one for one in recordings]).estimator_.coef_
    again = identifier.fit([lambda one=one: one for one in recordings]).estimator_.coef_
    assert np.array_equal(first, again)
    recordings[1]["x"][3] += 1e-9
    with pytest.raises(ValueError, match=r"another fit \(data differs\)"):
        identifier.fit([lambda one=one: one for one in recordings])


OTHERS = {"n_modes": 3, "loss": "l2", "random_state": 1,
          "feature_library": FunctionLibrary([lambda x: x])}  # fmt: skip


@pytest.mark.parametrize("option", OTHERS)
def test_a_checkpoint_of_other_parameters_is_refused(folder, option):
    switching(folder).fit(X, XDOT)
    with pytest.raises(ValueError, match=rf"another fit \({option}"):
        switching(folder, **{option: OTHERS[option]}).fit(X, XDOT)


def test_a_checkpoint_of_another_version_is_refused(folder, monkeypatch):
    switching(folder).fit(X, XDOT)
    others = swsysid._checkpoints.versions() | {"swsysid": "another text", "numpy": "1.0"}
    monkeypatch.setattr(swsysid._checkpoints, "versions", lambda: others)
    with pytest.raises(ValueError, match=r"another fit \(swsysid, numpy differ\)"):
        switching(folder).fit(X, XDOT)


def test_a_step_of_another_work_is_none_of_this(folder, tmp_path):
    """It is read only where the seal of this work is on it."""
    other = tmp_path / "other"
    switching(other).fit(X, 2.0 * XDOT)
    plain = switching(folder).fit(X, XDOT)
    for path in steps_of(folder):
        path.write_bytes((other / path.relative_to(folder)).read_bytes())
    with pytest.warns(RuntimeWarning, match="torn or another fit's"):
        assert np.array_equal(switching(folder).fit(X, XDOT).coef_, plain.coef_)


def test_a_folder_of_other_things_is_refused(folder):
    folder.mkdir()
    (folder / "notes.txt").write_text("mine", "utf-8")
    with pytest.raises(ValueError, match="holds other files; name a new or an empty folder"):
        switching(folder).fit(X, XDOT)


def test_what_is_no_folder_is_refused(folder):
    folder.write_text("a file", "utf-8")
    with pytest.raises(ValueError, match="cannot be written .File exists"):
        switching(folder).fit(X, XDOT)
    with pytest.raises(TypeError, match="checkpoint=3 must be None or the name of a folder"):
        switching(3).fit(X, XDOT)


@pytest.mark.skipif(os.name != "posix", reason="rights of others are told by POSIX")
def test_a_folder_that_others_write_to_is_refused(folder):
    switching(folder).fit(X, XDOT)
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    folder.chmod(0o770)
    for reading in (lambda: switching(folder).fit(X, XDOT), lambda: best_so_far(folder)):
        with pytest.raises(ValueError, match="may be written to by others, and reading it runs"):
            reading()


def test_a_clone_on_other_rows_needs_a_folder_of_its_own(folder):
    grid = GridSearchCV(switching(folder), {"loss": ["l1"]}, cv=2, error_score="raise")
    with pytest.raises(ValueError, match="another fit"):
        grid.fit(X, XDOT)


# -- the best until now ------------------------------------------------------------------------


def test_the_best_until_now(folder):
    with pytest.raises(ValueError, match="is no checkpoint .No such file or directory"):
        best_so_far(folder)
    with journal(folder, {}):
        with pytest.raises(ValueError, match="has no answer yet; let the fit go on"):
            best_so_far(folder)
        with handing_over(str):
            offer(3)
            assert best_so_far(folder) == "3"
            with handing_over(len):  # of a fit within the fit
                offer("no answer of this one")
            with handing_over(None), handing_over(lambda found: None):
                offer("nothing to hand over yet")
        assert best_so_far(folder) == "3"
    model = switching(folder / "fit").fit(X, XDOT)
    assert np.array_equal(best_so_far(folder / "fit").coef_, model.coef_)


def test_a_function_of_the_users_own_is_kept(folder):
    library = FunctionLibrary([lambda x: x, lambda x: x**2], ["{}", "{}^2"])
    plain = switching(None, feature_library=library).fit(X, XDOT)
    for _ in range(2):
        model = switching(folder, feature_library=library).fit(X, XDOT)
        assert np.array_equal(model.coef_, plain.coef_)
