"""Every fitted object goes into a file and comes back; nothing is lost if it cannot be written."""

import json
import subprocess
import sys

import numpy as np
import pytest
from sklearn.pipeline import make_union

from swsysid import (
    EffectSearchCV,
    FunctionLibrary,
    HybridAutomaton,
    HybridAutomatonRegressor,
    Recording,
    SwitchingSystemRegressor,
    TrajectoryIdentifier,
    load_model,
    save_model,
)
from swsysid._automaton_search.certificates import Certificate
from swsysid._saving.values import read_objects, write_objects
from swsysid._verdict.comparison import Verdict
from swsysid._whole_or_nothing import write_text, written_beside
from swsysid.effects import CoulombFriction, QuadraticDrag

T = np.arange(0.0, 20.0, 0.2)
RELAY = HybridAutomaton.stated(
    [{"T": "-0.1 (T - 30)"}, {"T": "-0.1 (T - 10)"}],
    [(0, 1, "T >= 22"), (1, 0, "T <= 18")],
    states=["T"],
)


def relay_recordings():
    noise = np.random.default_rng(0)
    runs = [RELAY.simulate([start], T, mode=0).x for start in (15.0, 17.0, 19.0)]
    return [{"t": T, "x": x + 0.02 * noise.standard_normal(x.shape)} for x in runs]


def there_and_back(model, folder):
    """The model of a file, which is the same file when it is saved again."""
    path = folder / "model.json"
    save_model(model, path)
    written, same = path.read_bytes(), load_model(path)
    save_model(same, path)
    assert path.read_bytes() == written
    return same


@pytest.fixture(scope="module")
def found_automaton():
    return HybridAutomatonRegressor(2, random_state=0).fit(relay_recordings())


def test_an_automaton_comes_back_with_standard_errors_and_report(found_automaton, tmp_path):
    same, x0 = there_and_back(found_automaton, tmp_path), [16.0]
    assert same.equations() == found_automaton.equations()
    assert str(same.report_) == str(found_automaton.report_)
    assert same.verdicts_ == found_automaton.verdicts_
    assert str(same.refinement_) == str(found_automaton.refinement_)
    rolled = [each.simulate(x0, T, mode=0).x for each in (found_automaton, same)]
    np.testing.assert_array_equal(*rolled)
    recordings = relay_recordings()
    assert same.score(recordings) == found_automaton.score(recordings)
    again = same.fit(recordings)
    np.testing.assert_array_equal(again.coef_, found_automaton.coef_)


def test_the_model_and_its_document_are_loaded(found_automaton, tmp_path):
    assert there_and_back(found_automaton.automaton_, tmp_path).equations() == (
        found_automaton.equations()
    )
    path = tmp_path / "automaton.json"
    path.write_text(json.dumps(found_automaton.to_dict()), encoding="utf-8")
    assert load_model(path).equations() == found_automaton.equations()
    path.write_text(json.dumps(found_automaton.to_dict() | {"laws": "none"}), encoding="utf-8")
    with pytest.raises(ValueError, match="this automaton is damaged"):
        load_model(path)


def test_an_identifier_comes_back_with_standard_errors_and_report(tmp_path):
    t = np.arange(0.0, 6.0, 0.1)
    noise = np.random.default_rng(0)
    x = [np.exp(-0.5 * t)[:, None] * start for start in (1.0, -2.0)]
    recordings = [{"t": t, "x": each + 0.01 * noise.standard_normal(each.shape)} for each in x]
    model = TrajectoryIdentifier(SwitchingSystemRegressor(1, random_state=0)).fit(recordings)
    same = there_and_back(model, tmp_path)
    for name in ("coef_errors_", "states_", "modes_", "noise_"):
        np.testing.assert_array_equal(getattr(same, name), getattr(model, name))
    assert str(same.report_) == str(model.report_)
    assert same.estimator_.equations() == model.estimator_.equations()
    assert same.score(recordings) == model.score(recordings)


def test_a_search_comes_back_with_its_report(tmp_path):
    t = np.arange(0.0, 40.0, 0.1)
    v, u = np.sin(t)[:, None], np.cos(0.7 * t)[:, None]
    rate = -0.4 * v + u - 0.3 * np.sign(v)
    rate += 0.01 * np.random.default_rng(0).standard_normal(rate.shape)
    search = EffectSearchCV(
        SwitchingSystemRegressor(1), effects=[CoulombFriction(), QuadraticDrag()]
    ).fit(np.hstack([v, u]), rate, t=t)
    assert [one.kind for one in search.effects_] == ["coulomb_friction"]
    same = there_and_back(search, tmp_path)
    assert str(same.report_) == str(search.report_)
    assert same.report_.to_dict() == search.report_.to_dict()
    assert same.equations() == search.equations()
    X = np.hstack([v, u])
    np.testing.assert_array_equal(same.predict(X, t=t), search.predict(X, t=t))


def test_laws_with_sines_are_written_as_a_document():
    waves = make_union(FunctionLibrary([np.sin, np.cos]), FunctionLibrary([np.square]))
    plant = HybridAutomaton.stated(
        [[[0.0, -1.0, 0.0, 0.0, 0.0, 0.5], [-2.0, 0.0, 0.0, 0.0, 0.0, 0.0]]],
        states=["q", "v"],
        feature_library=waves,
    )
    same = HybridAutomaton.from_dict(json.loads(json.dumps(plant.to_dict())))
    assert same.equations() == plant.equations()
    np.testing.assert_array_equal(same.simulate([0.3, 0.1], T).x, plant.simulate([0.3, 0.1], T).x)


@pytest.mark.parametrize(
    ("recording", "kind", "sentence"),
    [
        ("a.csv", TypeError, "recording='a.csv' must be a swsysid.Recording"),
        (Recording(smoothing={"window": np.nan}), ValueError, "give texts, finite numbers"),
        (Recording(units={"x": object()}), TypeError, "give texts, finite numbers"),
    ],
)
def test_what_a_file_cannot_tell_of_the_data_is_refused(recording, kind, sentence, tmp_path):
    with pytest.raises(kind, match=sentence):
        save_model(RELAY, tmp_path / "model.json", recording=recording)
    assert not list(tmp_path.iterdir())


# -- whole or not at all ---------------------------------------------------------------------------

FULL_DISK = """
import resource, signal, sys
from swsysid import HybridAutomaton, load_model, save_model
plant = HybridAutomaton.stated([{"x": "-x"}], [], states=["x"])
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (50, resource.RLIM_INFINITY))
try:
    {call}
except OSError as error:
    print(error)
"""


@pytest.mark.parametrize(
    "call", ["save_model(plant, sys.argv[1])", "plant.to_spaceex(sys.argv[1])"]
)
def test_a_full_disk_keeps_the_file_that_was_there(call, tmp_path):
    path = tmp_path / "kept"
    path.write_text("as it was", encoding="utf-8")
    script = FULL_DISK.replace("{call}", call)
    done = subprocess.run(
        [sys.executable, "-c", script, str(path)], capture_output=True, text=True, check=True
    )
    assert done.stdout == f"[Errno 27] File too large: '{path}'\n"
    assert path.read_text(encoding="utf-8") == "as it was"
    assert list(tmp_path.iterdir()) == [path]


def test_an_interruption_keeps_the_file_that_was_there(tmp_path):
    path = tmp_path / "kept.txt"
    path.write_text("as it was", encoding="utf-8")
    with pytest.raises(KeyboardInterrupt), written_beside(path) as draft:
        draft.write_text("half of", encoding="utf-8")
        raise KeyboardInterrupt
    assert path.read_text(encoding="utf-8") == "as it was" and list(tmp_path.iterdir()) == [path]


def test_permissions_links_and_pipes_stay_what_they_are(tmp_path):
    path, link = tmp_path / "model.json", tmp_path / "link"
    write_text(path, "first")
    usual = tmp_path / "usual"
    usual.write_text("", encoding="utf-8")
    assert path.stat().st_mode == usual.stat().st_mode
    path.chmod(0o640)
    link.symlink_to(path)
    write_text(link, "second")
    assert link.is_symlink() and path.read_text(encoding="utf-8") == "second"
    assert path.stat().st_mode & 0o777 == 0o640
    write_text("/dev/null", "nothing")
    with pytest.raises(IsADirectoryError):
        write_text(tmp_path, "nothing")
    with pytest.raises(FileNotFoundError, match="absent"):
        write_text(tmp_path / "absent" / "file", "nothing")


def test_records_of_all_kinds_come_back():
    """Dataclasses, named tuples, enumerations and sets are named by their place here."""
    record = FunctionLibrary(
        [Certificate(0.25, np.inf), Verdict.SMOOTH, frozenset({2, 1}), {"b", "a"}]
    )
    table = json.loads(json.dumps(write_objects(record)))
    same = read_objects(table).functions
    assert same == record.functions and type(same[0]) is Certificate and same[1] is Verdict.SMOOTH
    told = [one["class"] for one in table]
    assert told == ["swsysid._automaton_search.certificates.Certificate", "FunctionLibrary"]


def test_a_record_is_found_where_its_room_keeps_it_today():
    was = "swsysid._automaton_search.a_file_of_an_earlier_version.Certificate"
    state = {"margin": 0.25, "largest": 0.5}
    assert read_objects([{"class": was, "state": state}]) == Certificate(**state)


@pytest.mark.parametrize(
    "name",
    [
        "swsysid._automaton_search.certificates.Nothing",
        "swsysid._cli.output.Path",  # imported there, not ours
        "swsysid._automaton_search.certificates.linear_program",  # a function
        "swsysid._regressor.SwitchingSystemRegressor",  # no record: it has a name of its own
        "swsysid.nowhere.Certificate",
        "swsysid..os.system",
        "swsysidious.Certificate",
        "os.system",
    ],
)
def test_nothing_but_records_is_named_by_its_place(name):
    with pytest.raises((KeyError, ImportError, TypeError)):
        read_objects([{"class": name, "state": {}}])
