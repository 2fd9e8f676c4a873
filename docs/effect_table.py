"""Print the tables of effects that the page ``effects.md`` holds; ``--write`` puts them there."""

import inspect
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from swsysid._data.records import make_records
from swsysid.effects import all_effects, special_effects

PAGE = Path(__file__).parent / "effects.md"
TABLES = {"table of effects": all_effects, "table of special effects": special_effects}
END = "<!-- end of the table -->"
NEEDS = {"order": "`groups` or `t`", "time": "`t`", "signals": "`signals`"}


def example_records():
    """A record with two states, an input and a signal: parameters may depend on the data."""
    t = np.linspace(0.0, 10.0, 200)
    X = np.column_stack([np.sin(t), np.cos(t), np.sin(3.0 * t)])
    return make_records(X, 2, t=t, signals=2.0 + np.cos(2.0 * t), names=["x", "v", "u"])


def row(effect, records):
    """Kind, formula, parameters, needs and meaning of one effect."""
    first = inspect.getdoc(type(effect)).split("\n\n")[0]
    formula = " ".join(first.split()).replace("``", "`").replace("|", "\\|")
    # some act in the law of a force alone, of which the columns are no states
    everywhere = (*effect.places(records), *effect.places(replace(records, quantity="F")))
    place = everywhere[0]
    theta = dict.fromkeys(effect.theta_names(records, place), 1.0)
    names = effect.physical(theta, dict.fromkeys(effect.terms, 1.0))
    needs = ", ".join(NEEDS[need] for need in sorted(effect.needs)) or "-"
    meaning = effect.describe("x", "the state")
    cells = (f"`{effect.kind}`", formula, ", ".join(names) or "-", needs, meaning)
    return f"| {' | '.join(cells)} |"


def table(effects):
    """A whole table, in Markdown."""
    records = example_records()
    head = ["| kind | formula | parameters | needs | what it means |", "|---|---|---|---|---|"]
    return "\n".join([*head, *(row(effect, records) for effect in effects)])


def page_with_tables():
    """The page with its tables made anew."""
    page = PAGE.read_text(encoding="utf-8")
    for name, effects in TABLES.items():
        start = f"<!-- {name}: docs/effect_table.py --write -->"
        before, rest = page.split(start)
        _, after = rest.split(END, 1)
        page = f"{before}{start}\n\n{table(effects())}\n\n{END}{after}"
    return page


if __name__ == "__main__":
    for listed in TABLES.values():
        print(table(listed()))
    if "--write" in sys.argv:
        PAGE.write_text(page_with_tables(), encoding="utf-8")
