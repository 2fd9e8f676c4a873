"""Every example runs from a clean folder, headless, warnings as errors, and prints what it did."""

import os
import re

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest
from example_output import EXAMPLES, differences, recorded_output, run_example
from example_pictures import complaints

# whole searches of long records, and of many models
LONG = {"plot_mr_damper", "plot_emps", "plot_rc_vehicle", "plot_cascaded_tanks", "plot_grid_search"}


@pytest.mark.parametrize(
    "example",
    [
        pytest.param(path, id=path.stem, marks=[pytest.mark.nightly] if path.stem in LONG else [])
        for path in EXAMPLES
    ],
)
def test_example_prints_what_was_recorded(example, tmp_path):
    done = run_example(example, tmp_path)
    # an example whose data cannot be had ends with the sentence of the error
    if "MeasuredDataError" in done.stderr:
        assert "SWSYSID_DATA" not in os.environ, done.stderr
        pytest.skip(done.stderr.strip().splitlines()[-1])
    assert done.returncode == 0, done.stdout + done.stderr
    assert not list(tmp_path.iterdir()), "an example leaves files behind"
    recorded = recorded_output(example).read_text(encoding="utf-8")
    assert differences(recorded, done.stdout) == []


def test_every_example_is_found():
    assert {path.stem for path in EXAMPLES} >= {
        "plot_damped_oscillator",
        "plot_quartic_oscillator",
        "plot_switching_network",
        "plot_grid_search",
        "plot_emps",
    }


def test_nothing_is_recorded_of_an_example_that_is_gone():
    recorded = {path.stem for path in recorded_output(EXAMPLES[0]).parent.iterdir()}
    assert recorded == {path.stem for path in EXAMPLES}


@pytest.mark.parametrize(
    ("expected", "printed", "same"),
    [
        ("error 0.100 m", "error 0.101 m", True),  # one per cent
        ("error 0.100 m", "error 0.110 m", False),
        ("error 0.0000", "error 0.0001", True),  # the last digit
        ("error 0.0000", "error 0.0002", False),
        ("p = 9e-06", "p = 8e-06", True),
        ("p = 9e-06", "p = 3e-06", False),
        ("169 rows", "168 rows", True),
        ("3 modes", "4 modes", False),
        ("a term in x2^2", "a term in x1^2", False),
        ("found saturation", "found dead zone", False),
        ("one line", "one line\nanother", False),
        ("spread  of columns", "spread of columns", True),
    ],
)
def test_outputs_are_compared_by_words_and_numbers(expected, printed, same):
    assert (differences(expected, printed) == []) is same


def test_pictures_of_nothing_are_noticed():
    figure, (zeros, floor, fine) = plt.subplots(3)
    zeros.plot(np.zeros(5))
    zeros.set_ylabel("mode mismatch")
    floor.semilogy([1.0, 1e-3, 1e-15])
    floor.set_ylabel("objective")
    fine.semilogy([1.0, 1e-3, 1e-5])
    mismatch, objective = complaints(figure)
    plt.close(figure)
    assert mismatch == "mode mismatch: all curves are zero."
    assert objective.startswith("objective: the axis reaches from")


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_pictures_have_the_style_of_the_house(example):
    """Matplotlib's own colours are orange and green next to each other."""
    code = example.read_text(encoding="utf-8")
    if "plt.subplots" in code:
        assert "plt.style.use(STYLE)" in code
    assert not re.search(r"""["'](C\d|tab:\w+|orange|green|red)["']""", code)
