"""The golden set: planted answers are told worse, better or equal; what is frozen is whole."""

import copy
import json

import numpy as np
import pytest

from benchmarks.golden.__main__ import main
from benchmarks.golden.comparison import compared, verdict
from benchmarks.golden.files import FROZEN, load, save
from benchmarks.golden.kinds import KINDS, line
from benchmarks.golden.record import answered, estimate, fingerprint, short
from benchmarks.golden.tables import told
from swsysid import load_model

RECORD = {
    "cell": ["contact", 0.01, 4, "told", 1],
    "commit": "abc",
    "data": [100, 1.5],
    "seconds": 10.0,
    "unit": 0.01,
    "right": True,
    "figures": {"modes": 0, "missed": 0.0, "unbalanced": 0.001, "field": 0.01},
    "estimates": {"laws": {"value": [1.0, -2.0, 0.0], "error": [0.01, 0.02, 0.0]}},
}
FOUND = RECORD | {
    "figures": {"effects": 0, "error": 1.0},
    "found": ["drift of t", "bias of 1"],
    "p_values": [1e-9, 1e-3],
    "estimates": {},
}


def changed(base=RECORD, **parts):
    """A record with other entries; figures and laws are given by name and number."""
    one = copy.deepcopy(base)
    one["figures"] |= parts.pop("figures", {})
    for place, value in parts.pop("laws", {}).items():
        one["estimates"]["laws"]["value"][place] = value
    return one | parts


def test_estimates_are_equal_within_two_combined_standard_errors():
    # combined: sqrt(2) * .01
    inside, outside = changed(laws={0: 1.028}), changed(laws={0: 1.029})
    assert verdict(RECORD, inside).word == "equal" and not verdict(RECORD, inside).moved
    assert verdict(RECORD, outside).moved


def test_what_solvers_change_in_an_exact_answer_is_no_difference():
    one = verdict(RECORD, changed(laws={2: 1e-5}))  # its standard error is 0
    assert one.word == "equal" and not one.moved
    assert verdict(RECORD, changed(laws={2: 1e-3})).moved


@pytest.mark.parametrize(
    ("field", "word"), [(0.02, "worse"), (0.011, "equal"), (0.002, "better"), (None, "worse")]
)
def test_where_estimates_moved_their_distance_from_the_truth_decides(field, word):
    one = verdict(RECORD, changed(laws={0: 1.1}, figures={"field": field}))
    assert one.moved and one.word == word
    # within its standard errors an estimate may be nearer to the truth or further by chance
    assert verdict(RECORD, changed(figures={"field": field})).word == "equal"


@pytest.mark.parametrize(("figure", "value"), [("modes", 1), ("missed", 0.1)])
def test_what_is_counted_decides_whether_or_not_estimates_moved(figure, value):
    worse = changed(figures={figure: value})
    assert verdict(RECORD, worse).word == "worse"
    assert verdict(worse, RECORD).word == "better"
    assert f"{figure} {RECORD['figures'][figure]} -> {value}" in verdict(RECORD, worse).changes


def test_a_record_that_is_better_here_and_worse_there_is_worse():
    before = changed(figures={"missed": 0.2})
    assert verdict(before, changed(figures={"modes": 1})).word == "worse"


def test_a_refusal_in_place_of_an_answer_is_worse_and_the_other_way_better():
    refusal = {name: RECORD[name] for name in ("cell", "commit", "data", "seconds", "unit")}
    refusal |= {"right": False, "refused": "ValueError: too few samples."}
    assert verdict(RECORD, refusal).word == "worse"
    assert verdict(refusal, RECORD).word == "better"
    assert verdict(refusal, refusal | {"refused": "ValueError: others."}).word == "equal"


def test_other_effects_moved_and_the_error_decides():
    other = changed(FOUND, found=["lag of u"])
    assert verdict(FOUND, other).moved and verdict(FOUND, other).word == "equal"
    assert verdict(FOUND, changed(other, figures={"error": 1.2})).word == "worse"
    assert verdict(FOUND, changed(other, figures={"error": 0.9})).word == "better"
    assert verdict(FOUND, changed(FOUND, p_values=[1e-3, 1e-9])).moved


def test_a_model_that_predicts_something_else_is_worse():
    exact = changed(figures={}, estimates={"rollout": estimate([1.0, 2.0], [0.0, 0.0])})
    exact["figures"] = {}
    assert verdict(exact, exact).word == "equal"
    other = exact | {"estimates": {"rollout": estimate([1.0, 2.001], [0.0, 0.0])}}
    assert verdict(exact, other).word == "worse"


def test_of_other_data_nothing_is_said():
    one = verdict(RECORD, changed(data=[100, 1.6], figures={"modes": 1}))
    assert one.word == "other data"


def records(n, **parts):
    """Records by their cells, all with these entries."""
    return {json.dumps([number]): changed(cell=[number], **parts) for number in range(n)}


def test_a_kind_may_lose_one_record_and_no_more():
    frozen, worse = records(5), records(5, figures={"modes": 1}, right=False)
    mixed = {n: records(5) | dict(list(worse.items())[:n]) for n in range(3)}
    assert [compared(frozen, mixed[n]).is_worse for n in range(3)] == [False, False, True]
    assert compared(frozen, mixed[1], may_lose=0).is_worse
    assert compared(worse, frozen).count("better") == 5 and not compared(worse, frozen).is_worse


def test_one_more_null_alarm_is_worse():
    frozen = records(5)
    now = frozen | {"[0]": frozen["[0]"] | {"alarm": True}}
    assert compared(frozen, now).is_worse and not compared(now, frozen).is_worse


def test_cpu_time_is_told_in_units_of_the_yardstick_and_decides_nothing():
    slow = records(3, seconds=40.0, unit=0.02)
    comparison = compared(records(3), slow)
    assert not comparison.is_worse
    assert [one.time for one in comparison.verdicts] == pytest.approx([2.0] * 3)
    assert "| 30 -> 120 | 2.00 | 2.00 | holds |" in told({"recordings": comparison})


def test_every_record_that_got_worse_or_better_is_printed_with_both_values():
    frozen = records(3)
    now = frozen | {
        "[0]": changed(cell=[0], figures={"missed": 0.5}),
        "[1]": changed(cell=[1], laws={0: 1.1}, figures={"field": 0.001}),
    }
    text = told({"recordings": compared(frozen, now)})
    assert "- worse: recordings [0]: missed 0.0 -> 0.5" in text
    assert "- better: recordings [1]: field 0.01 -> 0.001; laws by 7.1 standard errors" in text


def test_a_record_keeps_few_digits_and_a_refusal_in_words():
    def refuses():
        raise ValueError("Give more samples.")

    one = answered(["a"], np.ones(4), refuses, dict)
    assert one["refused"] == "ValueError: Give more samples." and not one["right"]
    assert one["data"] == [4, 1.0] and one["seconds"] >= 0.0 < one["unit"]
    assert short([np.pi, np.inf, np.nan]) == [3.14159, None, None]
    assert fingerprint([3.0, 4.0]) == [2, 3.53553]
    kept = answered(["a"], [1.0], lambda: 2.0, lambda x: {"right": True, "figures": {"modes": x}})
    assert kept["figures"] == {"modes": 2.0}


class Planted:
    """A kind of two cells whose answers are given."""

    def __init__(self, **parts):
        self.parts = parts

    def cells(self, part):
        """One of them is quick."""
        return [[0], [1]][: 1 if part == "quick" else 2]

    def run(self, number):
        """The record of a cell."""
        return changed(cell=[number], **self.parts)


def test_the_command_freezes_resumes_compares_and_fails(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(KINDS, "recordings", Planted())
    command = ["--only", "recordings", "--write", str(tmp_path)]
    assert main([*command, "--part", "quick"]) == 0 and main(command) == 0
    assert capsys.readouterr().out.count("10.0 s") == 2  # each cell ran once
    monkeypatch.setitem(KINDS, "recordings", Planted(figures={"modes": 1}, right=False))
    compare = ["--only", "recordings", "--compare", str(tmp_path)]
    assert main([*compare, "--part", "quick"]) == 0  # one may be lost
    assert main(compare) == 1
    assert "| recordings | 2 | 0 | 0 | 0 | 2 | 2 -> 0 |" in capsys.readouterr().out


def test_files_hold_a_record_a_line(tmp_path):
    save(tmp_path, "recordings", records(3))
    assert load(tmp_path, "recordings") == records(3) and load(tmp_path, "automata") == {}
    assert (tmp_path / "recordings.json").read_text().count("\n") == 6


@pytest.mark.parametrize("kind", KINDS)
def test_every_quick_cell_is_frozen_and_nothing_that_is_not_asked(kind):
    frozen = load(FROZEN, kind)
    full = [json.dumps(cell) for cell in KINDS[kind].cells("full")]
    assert len(set(full)) == len(full) and set(frozen) <= set(full)
    assert {json.dumps(cell) for cell in KINDS[kind].cells("quick")} <= set(frozen)
    comparison = compared(frozen, frozen)
    assert comparison.count("equal") == len(frozen) and not comparison.is_worse
    assert all(line(kind, one["cell"]).startswith(kind) for one in frozen.values())


def test_the_frozen_folder_stays_small():
    size = sum(file.stat().st_size for file in FROZEN.rglob("*") if file.is_file())
    assert size < 1.5e6


@pytest.mark.parametrize("file", sorted((FROZEN / "models").glob("*.json")), ids=lambda f: f.stem)
def test_models_that_were_kept_then_are_read_today(file):
    report = getattr(load_model(file), "report_", None)
    assert report is None or str(report)
