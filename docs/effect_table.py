"""Print the table of all effects that the page ``effects.md`` holds; ``--write`` puts it there."""

import inspect
import sys
from pathlib import Path

import numpy as np

from swsysid._data.records import make_records
from swsysid.effects import all_effects

PAGE = Path(__file__).parent / "effects.md"
START, END = "<!-- table of effects: docs/effect_table.py --write -->", "<!-- end of the table -->"
NEEDS = {"order": "`groups` or `t`", "time": "`t`", "signals": "`signals`"}


def example_records():
    """A record with two states, an input and a signal: parameters may depend on the data."""
    t = np.linspace(0.0, 10.0, 200)
    X = np.column_stack([np.sin(t), np.cos(t), np.sin(3.0 * t)])
    return make_records(X, 2, t=t, signals=np.cos(2.0 * t), names=["x", "v", "u"])


def row(effect, records):
    """Kind, formula, parameters, needs and meaning of one effect."""
    first = inspect.getdoc(type(effect)).split("\n\n")[0]
    formula = " ".join(first.split()).replace("``", "`").replace("|", "\\|")
    place = next(iter(effect.places(records)))
    theta = dict.fromkeys(effect.theta_names(records, place), 1.0)
    names = effect.physical(theta, dict.fromkeys(effect.terms, 1.0))
    needs = ", ".join(NEEDS[need] for need in sorted(effect.needs)) or "-"
    meaning = effect.describe("x", "the state")
    cells = (f"`{effect.kind}`", formula, ", ".join(names) or "-", needs, meaning)
    return f"| {' | '.join(cells)} |"


def table():
    """The whole table, in Markdown."""
    records = example_records()
    head = ["| kind | formula | parameters | needs | what it means |", "|---|---|---|---|---|"]
    return "\n".join([*head, *(row(effect, records) for effect in all_effects())])


def page_with(text):
    """The page with another table in it."""
    page = PAGE.read_text(encoding="utf-8")
    before, rest = page.split(START)
    return f"{before}{START}\n\n{text}\n\n{END}{rest.split(END)[1]}"


if __name__ == "__main__":
    print(table())
    if "--write" in sys.argv:
        PAGE.write_text(page_with(table()), encoding="utf-8")
