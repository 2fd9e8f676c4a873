"""The page of the command line says where its defaults differ from those in Python."""

import inspect
import re
from pathlib import Path

import numpy as np
import pytest

from swsysid import PolynomialSurfaceClassifier, SwitchingSystemRegressor
from swsysid._cli.arguments import LIBRARIES, measurement, modes, parser
from swsysid._cli.measurement import Measurement
from swsysid._cli.run import _options as job_options
from swsysid._cli.samples import measure
from swsysid._tables.table import Table
from swsysid.differentiation import differentiate

PAGE = Path(__file__).parents[2] / "docs" / "command_line.md"
ARGUMENTS = parser().parse_args(["log.csv", "--states", "x"])
IN_PYTHON = {
    each.__name__: {name: one.default for name, one in inspect.signature(each).parameters.items()}
    for each in (SwitchingSystemRegressor, PolynomialSurfaceClassifier, differentiate)
}


def _rows():
    """First words in code of each cell: option, its default, parameter, its owner, its default."""
    section = PAGE.read_text("utf-8").split("## Where defaults differ")[1].split("\n## ")[0]
    for line in section.splitlines():
        cells = [re.findall(r"`([^`]+)`", cell) for cell in line.split("|")[1:-1]]
        if len(cells) == 4 and cells[2]:
            option = cells[0][0] if cells[0] else None
            yield option, cells[1][0], *cells[2], cells[3][0]


ROWS = list(_rows())


@pytest.mark.parametrize(("option", "here", "parameter", "owner", "there"), ROWS)
def test_both_defaults_are_those_of_the_page(option, here, parameter, owner, there):
    assert str(IN_PYTHON[owner][parameter]) == there
    assert here != there
    if option == "--library":
        options = job_options(ARGUMENTS, measurement(ARGUMENTS))
        assert options.library_degree == LIBRARIES[here]
    elif option:
        assert str(vars(ARGUMENTS)[option.strip("-").replace("-", "_")]) == here


def test_short_runs_are_dropped_here_and_refused_there():
    t = np.r_[np.linspace(0, 1, 200), np.linspace(2, 3, 200), 4.0, 4.005, 4.01]
    runs = np.repeat([0.0, 1.0, 2.0], [200, 200, 3])
    columns = {"t": t, "x": np.sin(t), "run": runs}
    what = Measurement(states=("x",), time="t", groups="run")
    samples = measure(Table("log.csv", columns, {}), what)
    assert samples.remarks[-1].startswith("Left out: 1 run shorter than")
    with pytest.raises(ValueError, match="samples"):
        differentiate(columns["x"], t, runs)


def test_all_other_shared_defaults_agree():
    told = {(owner, parameter) for _, _, parameter, owner, _ in ROWS}
    shared = {
        ("SwitchingSystemRegressor", "n_modes"): modes(ARGUMENTS.modes),
        ("SwitchingSystemRegressor", "feature_library"): ARGUMENTS.library or "affine",
        ("SwitchingSystemRegressor", "loss"): ARGUMENTS.loss,
        ("SwitchingSystemRegressor", "n_jobs"): ARGUMENTS.jobs,
        ("SwitchingSystemRegressor", "random_state"): ARGUMENTS.random_state,
        ("PolynomialSurfaceClassifier", "degree"): ARGUMENTS.surface_degree,
        ("differentiate", "order"): ARGUMENTS.order,
        ("differentiate", "method"): ARGUMENTS.method,
        ("differentiate", "window"): ARGUMENTS.window,
        ("differentiate", "cutoff"): ARGUMENTS.cutoff,
        ("differentiate", "decimate"): ARGUMENTS.decimate,
    }
    differing = {key for key, value in shared.items() if IN_PYTHON[key[0]][key[1]] != value}
    assert differing == told - {("differentiate", "too_short")}
