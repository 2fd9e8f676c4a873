"""The benchmark of undeclared effects: its fast part runs, resumes, and finds what was planted."""

import json

import pytest

from benchmarks.undeclared.__main__ import main


@pytest.mark.nightly
def test_the_fast_part_finds_what_was_planted(tmp_path, capsys):
    main(["--fast", "--output", str(tmp_path)])
    lines = (tmp_path / "undeclared.jsonl").read_text().splitlines()
    records = [json.loads(line) for line in lines]
    planted = [record for record in records if record["cell"][1]]
    clean = [record for record in records if not record["cell"][1]]
    assert len(planted) == 5 and len(clean) == 4
    for record in planted:
        assert record["right"][0] or record["among_rivals"][0], record
        assert record["ratio"] <= 1.15
    assert [record["found"] for record in clean] == [[]] * 4
    capsys.readouterr()
    main(["--fast", "--output", str(tmp_path)])
    printed = capsys.readouterr().out
    assert "| first effect right | 100.0% | 5 | larger | at least 95 % | reached |" in printed
    assert "records with noise 0 and 2 %: oscillator 0.0, pendulum 0.0." in printed
    assert "1/5" not in printed  # nothing is run twice
