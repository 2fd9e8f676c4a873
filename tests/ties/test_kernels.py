"""What is printed is the same whatever the processor: the quick part of ``make test-kernels``."""

from pathlib import Path

import pytest
from example_output import EXAMPLES, command
from kernels import Kernels

ANSWERS = Path(__file__).parents[1] / "helpers" / "kernel_answers.py"
# the shortest of the examples
SHORT = [path for path in EXAMPLES if path.stem == "plot_damped_oscillator"]


@pytest.fixture(scope="module")
def kernels():
    """Those of processors far apart; the other tests run with one more."""
    found = Kernels.of_this_processor(["Prescott", "Haswell"])
    if len(found.environments) < 2:
        pytest.skip("; ".join(found.words))
    return found


@pytest.mark.nightly
def test_fits_searches_and_their_ties_are_the_same_on_every_processor(kernels, tmp_path):
    assert kernels.different([str(ANSWERS)], tmp_path) == []


@pytest.mark.nightly
@pytest.mark.parametrize("example", SHORT, ids=lambda path: path.stem)
def test_examples_print_the_same_on_every_processor(kernels, example, tmp_path):
    assert kernels.different(command(example), tmp_path) == []


def test_a_difference_is_told(kernels, tmp_path):
    first, second = kernels.environments
    told = kernels.different(["-c", "import os; print(os.environ['OPENBLAS_CORETYPE'])"], tmp_path)
    assert told[0] == f"{second} instead of {first}: {second!r} instead of {first!r}"
