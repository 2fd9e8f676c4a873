"""The lower bounds of pyproject.toml as constraints of pip; run as a script, this file prints them.

What these packages need is the newest that they accept, as for somebody who installs them today.
"""

import re
import tomllib
from pathlib import Path

# Matplotlib 3.8 calls names that pyparsing deprecates since, and warnings are errors here.
NEWER_THAN_FORESEEN = ["pyparsing<3.3"]


def constraints(project: dict) -> list[str]:
    """Every dependency at its lower bound, those of the extras as well."""
    listed = [project["dependencies"], *project["optional-dependencies"].values()]
    bounds = {re.sub(r"\[.*\]", "", one) for part in listed for one in part if ">=" in one}
    return [*sorted(one.replace(">=", "==") for one in bounds), *NEWER_THAN_FORESEEN]


if __name__ == "__main__":
    file = Path(__file__).parents[2] / "pyproject.toml"
    print(*constraints(tomllib.loads(file.read_text(encoding="utf-8"))["project"]), sep="\n")
