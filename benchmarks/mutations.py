"""Do the tests notice when the code is wrong? A sample of small changes, each tried in a copy.

    python -m benchmarks.mutations [--sample 63] [--seed 0] [--rooms metrics ...] [--docs docs]

Cosmic Ray makes the changes: another operator, another number, a condition turned round, a loop
that does nothing. Where each comes from is drawn by place first, then by change, so that a line
with many possible changes counts once. A first round runs the tests of a room and keeps which of
them ran which line, and how long; a change is shown to those that run its line, the shortest
first, until one fails, for at most ``BUDGET`` seconds of theirs. What happens is one of

- *killed*: a test failed,
- *endless*: the tests took more than five times as long as without the change,
- *survived*: every test that runs the line has passed,
- *cut*: those within the budget have passed, and there are longer ones,
- *unseen*: no test of the room runs the line.

Results are kept beside ``--work`` as they come, and a run that was stopped goes on. With ``--docs``
the table goes into ``docs/mutations_table_0.md``, 0 the seed, with the reasons that stand in
``benchmarks/mutations_unnoticed.json`` beside changes that no test could notice.
"""

from __future__ import annotations

import argparse
import ast
import hashlib
import json
import os
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from difflib import unified_diff
from pathlib import Path
from random import Random
from time import perf_counter

from benchmarks.markdown import table

ROOT = Path(__file__).parents[1]
REASONS = ROOT / "benchmarks/mutations_unnoticed.json"
BUDGET = 60.0  # seconds of tests for one change
# Rooms, their tests, and of a large room the files that are its likelihood.
ROOMS = {
    "metrics": "metrics",
    "relaxations": "relaxations",
    "_solvers": "solvers",
    "_surfaces": "surfaces",
    "_automaton": "automaton",
    "_simulation": "simulation",
    "_stays": "stays",
}
LIKELIHOOD = set(
    "arrow condensed decoding descent equations filtering flow lifted nodes samples segments "
    "sensitivities weighted".split()
)
# Changes that somebody could have typed: no shift of a float, no `is` of two numbers.
ARITHMETIC = {"Add", "Sub", "Mul", "Div", "Pow"}
ORDER = {"Eq", "NotEq", "Lt", "LtE", "Gt", "GtE"}
OTHER = set(
    "ReplaceBinaryOperator_BitOr_BitAnd ReplaceBinaryOperator_BitAnd_BitOr "
    "ReplaceComparisonOperator_Is_IsNot ReplaceComparisonOperator_IsNot_Is "
    "ReplaceUnaryOperator_Delete_USub ReplaceUnaryOperator_Delete_Invert "
    "ReplaceUnaryOperator_Delete_Not ReplaceTrueWithFalse ReplaceFalseWithTrue ReplaceAndWithOr "
    "ReplaceOrWithAnd ReplaceBreakWithContinue ReplaceContinueWithBreak ExceptionReplacer "
    "NumberReplacer AddNot ZeroIterationForLoop".split()
)


@dataclass(frozen=True, order=True)
class Change:
    """A change: the file, its line and column, and the operator's how-manieth place it is."""

    room: str
    file: str
    line: int
    column: int
    operator: str
    occurrence: int


# -- the tests that run a line -------------------------------------------------------------------


def pytest_configure(config) -> None:
    """Hook of pytest, with this module as a plugin that says which test runs which line."""
    if "MUTATIONS_LINES" in os.environ:
        config.pluginmanager.register(Lines(Path(os.environ["MUTATIONS_LINES"])))


class Lines:
    """Lines by test, as coverage sees them, and the seconds of each test."""

    def __init__(self, path: Path):
        import coverage

        self.path, self.seconds = path, {}
        self.coverage = coverage.Coverage(
            data_file=None, source=[os.environ["MUTATIONS_ROOM"]], branch=False
        )
        self.coverage.start()

    def pytest_runtest_logstart(self, nodeid, location):
        """A test begins: what runs from here on is its own, fixtures included."""
        self.coverage.switch_context(nodeid)
        self.began = perf_counter()

    def pytest_runtest_logfinish(self, nodeid, location):
        """It ends."""
        self.seconds[nodeid] = perf_counter() - self.began

    def pytest_sessionfinish(self, session):
        """Written as one JSON."""
        self.coverage.stop()
        data = self.coverage.get_data()
        files = {
            str(Path(file).relative_to(Path.cwd())): {
                line: sorted(tests) for line, tests in data.contexts_by_lineno(file).items()
            }
            for file in data.measured_files()
        }
        self.path.write_text(json.dumps({"seconds": self.seconds, "files": files}))


def tested(room: str, work: Path) -> dict:
    """Which tests run which line of a room: measured once, and kept while both are the same."""
    sources = hashlib.sha256()
    for folder in (f"swsysid/{room}", f"tests/{ROOMS[room]}"):
        for file in sorted((work / "copy" / folder).rglob("*.py")):
            sources.update(file.read_bytes())
    path = work / f"lines_{room}_{sources.hexdigest()[:12]}.json"
    if not path.exists():
        print(f"{room}: which test runs which line", file=sys.stderr, flush=True)
        with_lines = {"MUTATIONS_LINES": str(path), "MUTATIONS_ROOM": f"swsysid/{room}"}
        tests = [f"tests/{ROOMS[room]}", f"swsysid/{room}"]
        done = run_tests(work / "copy", ["-p", "benchmarks.mutations", *tests], with_lines, 3600.0)
        if done != 0:
            raise SystemExit(f"The tests of {room} fail as they are (status {done}); mend them.")
    return json.loads(path.read_text())


def run_tests(copy: Path, arguments: list[str], environment: dict, limit: float) -> int | None:
    """The status of pytest in the copy, None where it took too long."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "--no-header", "--tb=no"]
    command += ["-p", "no:cacheprovider", *arguments]
    paths = {"PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1"}
    try:
        done = subprocess.run(
            command, cwd=copy, env={**os.environ, **paths, **environment}, timeout=limit,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return None
    return done.returncode


# -- changes -------------------------------------------------------------------------------------


def plausible(name: str) -> bool:
    """Whether somebody could have typed it."""
    name = name.rpartition("/")[2]
    kind, *sides = name.split("_")
    pairs = {"ReplaceBinaryOperator": ARITHMETIC, "ReplaceComparisonOperator": ORDER}
    return name in OTHER or set(sides) <= pairs.get(kind, set()) and len(sides) == 2


def changes(room: str) -> Iterator[Change]:
    """Every change of a room."""
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.plugins import get_operator, operator_names

    operators = {name: get_operator(name)() for name in operator_names() if plausible(name)}
    for path in sorted((ROOT / "swsysid" / room).rglob("*.py")):
        if room == "_stays" and path.stem not in LIKELIHOOD:
            continue
        source = path.read_text(encoding="utf-8")
        nodes, silent = list(ast_nodes(get_ast(source))), annotations(source)
        for name, operator in operators.items():
            number = -1
            for node in nodes:
                for (line, column), _ in operator.mutation_positions(node):
                    number += 1
                    if not any(first <= (line, column) < last for first, last in silent):
                        file = str(path.relative_to(ROOT))
                        yield Change(room, file, line, column, name, number)


def annotations(source: str) -> list[tuple]:
    """From where to where types are written, which nothing evaluates."""
    nodes = ast.walk(ast.parse(source))
    typed = (getattr(node, "annotation", None) or getattr(node, "returns", None) for node in nodes)
    return [
        ((one.lineno, one.col_offset), (one.end_lineno, one.end_col_offset)) for one in typed if one
    ]


def drawn(room: str, number: int, seed: int) -> list[Change]:
    """Changes of a room: places first, then one of the changes there."""
    places: dict[tuple, list[Change]] = {}
    for change in sorted(changes(room)):
        places.setdefault((change.file, change.line, change.column), []).append(change)
    random = Random(f"{room} {seed}")
    chosen = random.sample(sorted(places), min(number, len(places)))
    return [random.choice(places[place]) for place in chosen]


def text_of(change: Change) -> tuple[str, str]:
    """The file with the change, and what was changed."""
    from cosmic_ray.mutating import mutate_code
    from cosmic_ray.plugins import get_operator

    source = (ROOT / change.file).read_text(encoding="utf-8")
    new = mutate_code(source, get_operator(change.operator)(), change.occurrence)
    lines = [
        line
        for line in unified_diff(source.split("\n"), new.split("\n"), n=0, lineterm="")
        if line[0] in "+-" and line[:3] not in ("+++", "---")
    ]
    return new, "\n".join(lines)


# -- what happens --------------------------------------------------------------------------------


def tried(change: Change, work: Path) -> dict:
    """What the tests say of one change."""
    copy, of_room = work / "copy", tested(change.room, work)
    by_line = of_room["files"].get(change.file, {})
    tests = set(by_line.get(str(change.line), ()))
    if not tests - {""}:  # run at import: whoever uses the file
        tests = {one for line in by_line.values() for one in line} if tests else set()
    new, diff = text_of(change)
    seconds = {one: of_room["seconds"][one] for one in tests - {""}}
    chosen, expected = within_budget(seconds)
    outcome = "unseen"
    if chosen:
        path = copy / change.file
        path.write_text(new, encoding="utf-8")
        try:
            status = run_tests(copy, chosen, {}, 5.0 * expected + 30.0)
        finally:
            shutil.copyfile(ROOT / change.file, path)
        named = {None: "endless", 0: "survived" if len(chosen) == len(seconds) else "cut"}
        outcome = named.get(status, "killed")
    return {**vars(change), "diff": diff, "outcome": outcome, "tests": len(chosen)}


def within_budget(seconds: dict[str, float]) -> tuple[list[str], float]:
    """The shortest tests, file by file so that fixtures are made once, and their seconds."""
    chosen, total = [], 0.0
    for test in sorted(seconds, key=seconds.get):
        total += seconds[test]
        if total > BUDGET and chosen:
            break
        chosen.append(test)
    spent = Counter()
    for test in chosen:
        spent[test.partition("::")[0]] += seconds[test]
    chosen.sort(key=lambda test: (spent[test.partition("::")[0]], test.partition("::")[0]))
    return chosen, sum(spent.values())


def sample(rooms: list[str], number: int, seed: int, work: Path) -> list[dict]:
    """Results of all changes drawn, from where an earlier run has left off."""
    kept = work / f"results_{seed}.json"
    results = json.loads(kept.read_text()) if kept.exists() else {}
    found = []
    for room in rooms:
        for change in drawn(room, -(-number // len(rooms)), seed):
            _, diff = text_of(change)
            key = f"{change.file}:{change.column}\n{diff}"
            if key not in results:
                results[key] = tried(change, work)
                kept.write_text(json.dumps(results, indent=1))
                print(f"{results[key]['outcome']:9} {change.file}:{change.line}", flush=True)
            found.append(results[key])
    return found


def copied(work: Path) -> None:
    """The tree as git knows it, in the folder of work."""
    shutil.rmtree(work / "copy", ignore_errors=True)
    names = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT, capture_output=True, check=True, text=True,
    ).stdout  # fmt: skip
    for name in filter(None, names.split("\0")):
        to = work / "copy" / name
        to.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / name, to)


def page(found: list[dict]) -> str:
    """A line for each room, and every change that was not noticed with the reason, if any."""
    reasons = json.loads(REASONS.read_text()) if REASONS.exists() else {}
    words = ["killed", "endless", "survived", "cut", "unseen"]
    rooms = list(dict.fromkeys(one["room"] for one in found))
    counts = {room: Counter(one["outcome"] for one in found if one["room"] == room)
              for room in rooms}  # fmt: skip
    counts["all"] = sum(counts.values(), Counter())
    lines = [
        [f"`{room}`" if room != "all" else room, *(str(of_room[word]) for word in words),
         f"{(of_room['killed'] + of_room['endless']) / of_room.total():.0%}"]
        for room, of_room in counts.items()
    ]  # fmt: skip
    text = table(["room", *words, "noticed"], lines)
    for one in found:
        if one["outcome"] in words[2:]:
            text += ["", f"`{one['file']}`, {one['outcome']}:", "", "```diff", one["diff"], "```"]
            text += ["", reasons.get(one["diff"], "A test is missing.")]
    return "\n".join(text)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sample", type=int, default=63)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--rooms", nargs="+", default=list(ROOMS), choices=ROOMS, metavar="ROOM")
    parser.add_argument("--work", type=Path, default=ROOT / "build/mutations")
    parser.add_argument("--docs", type=Path)
    arguments = parser.parse_args()
    copied(arguments.work.resolve())
    text = page(sample(arguments.rooms, arguments.sample, arguments.seed, arguments.work.resolve()))
    print(text)
    if arguments.docs:
        (arguments.docs / f"mutations_table_{arguments.seed}.md").write_text(
            text + "\n", encoding="utf-8"
        )
