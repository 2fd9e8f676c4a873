"""The tables of the quality benchmark in Markdown, from its kept results."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.goals import MISSED
from benchmarks.markdown import table
from benchmarks.quality.cells import SCENARIOS, Cell, Cells, scenario_title
from benchmarks.quality.goals import goals, is_close
from benchmarks.results import origins

__all__ = ["summary", "tables"]

# What one test sample of a small mode weighs; less is no difference between methods.
TIE = 0.002


def summary(parts: dict[str, dict]) -> str:
    """All cells together."""
    found, timing = Cells(parts["cells"]["cells"]), parts.get("timing", {}).get("cells", [])
    lines = goals(found, parts["cells"]["count"], timing)
    head = ["figure", "value", "goal", "verdict", "where it is missed"]
    reached = [[one.figure, one.value, one.goal, one.verdict, one.missed] for one in lines]
    return _sections(
        ("Summary", [*_summary(found), "", origins(parts)]),
        ("Where another method is ahead", _defeats(found)),
        ("Figures to reach", table(head, reached, "l")),
        ("How far the probabilities can be trusted", _reliability(parts)),
        ("Time", _times(timing)),
    )


def tables(parts: dict[str, dict]) -> str:
    """Every method in every case, a section for each corruption; then seconds beside PARC's."""
    found, timing = Cells(parts["cells"]["cells"]), parts.get("timing", {}).get("cells", [])
    title = "# Quality benchmark: all tables\n\n"
    return title + _sections(
        *((scenario_title(name), _details(found, name)) for name in found.scenarios),
        ("Seconds beside PARC's", _all_times(timing)),
    )


def _sections(*sections: tuple[str, list[str]]) -> str:
    shown = [(title, "\n".join(lines)) for title, lines in sections if lines]
    return "\n".join(f"## {title}\n\n{text}\n" for title, text in shown)


def _entry(value: float, form: str) -> str:
    return f"{value:{form}}" if np.isfinite(value) else "not run"


# -- all cells together ------------------------------------------------------------------------


def _summary(found: Cells) -> list[str]:
    """Methods beside each other, a row for each corruption: typical case, and farthest one."""
    lines = [
        "Balanced accuracy of the modes (larger is better), mean of the cases' medians over the "
        "seeds; in brackets the number of cases whose median loss against the oracle is at most "
        "0.005.\n"
    ]
    lines += _pivot(found, _typical, found.methods())
    lines += [
        "\nThe case with the largest median loss of balanced accuracy against the oracle "
        "(smaller is better).\n"
    ]
    others = [name for name in found.methods() if name != "oracle"]
    return lines + _pivot(found, _farthest, others)


def _pivot(
    found: Cells, entry: Callable[[Cells, list[Cell], str], str], shown: list[str]
) -> list[str]:
    """A table for each set of methods that were run in the same corruptions."""
    groups: dict[tuple[str, ...], list[str]] = {}
    for scenario in found.scenarios:
        if scenario in SCENARIOS:
            methods = tuple(name for name in found.methods(scenario) if name in shown)
            groups.setdefault(methods, []).append(scenario)
    lines = []
    for methods, scenarios in groups.items():
        rows = []
        for scenario in scenarios:
            compared = found.with_methods("oracle", *methods)
            cells = [cell for cell in compared if cell[1] == scenario]
            # losses are those against the oracle, which may not have been run
            entries = [entry(found, cells, method) if cells else "" for method in methods]
            rows.append([scenario_title(scenario), *entries])
        head = ["corruption", *(found.title(name, scenarios[0]) for name in methods)]
        lines += [*([""] if lines else []), *table(head, rows)]
    return lines


def _losses(found: Cells, cells: list[Cell], method: str) -> np.ndarray:
    return np.array([found.value(cell, method, "loss")[0] for cell in cells])


def _typical(found: Cells, cells: list[Cell], method: str) -> str:
    mean = f"{np.mean([found.balanced(cell, method) for cell in cells]):.4f}"
    if method == "oracle":
        return mean
    near = np.sum(_losses(found, cells, method) <= SCENARIOS["clean"].median)
    return f"{mean} ({near} of {len(cells)})"


def _farthest(found: Cells, cells: list[Cell], method: str) -> str:
    losses = _losses(found, cells, method)
    worst = int(np.argmax(losses))
    return f"{losses[worst]:.4f} ({cells[worst][0]})"


def _defeats(found: Cells) -> list[str]:
    """The cells in which k-plane or PARC has the better median, the largest difference first."""
    rows = []
    for method in ("k_plane", "parc"):
        for cell in found.with_methods("ours", method):
            theirs, ours = (found.balanced(cell, name) for name in (method, "ours"))
            if theirs > ours + TIE:
                row = [cell[0], scenario_title(cell[1]), found.title(method)]
                rows.append((ours - theirs, [*row, f"{theirs:.4f}", f"{ours:.4f}"]))
    if not found.with_methods("ours"):
        return []
    told = f"Cells where the median is more than {TIE} above that of swsysid"
    if not rows:
        return [f"{told}: none."]
    rows.sort(key=lambda pair: pair[0])
    head = ["case", "corruption", "method", "its median", "swsysid"]
    return [f"{told}.\n", *table(head, [row for _, row in rows])]


def _reliability(parts: dict[str, dict]) -> list[str]:
    """Claimed probability of the predicted mode against how often it is right."""
    if "reliability" not in parts:
        return []
    shares = {name: one["shares"] for name, one in parts["reliability"]["scenarios"].items()}
    names = [name for name in SCENARIOS if name in shares]
    names += [name for name in shares if name not in SCENARIOS]
    columns = list(shares[names[0]])
    rows = [
        [scenario_title(name), *(f"{shares[name][column]:.4f}" for column in columns)]
        for name in names
    ]
    text = (
        "`predict_mode_proba` at the held-out samples, all runs of a corruption together: the "
        "tenth of each run of which the model is least sure, the samples with p < 0.99, and the "
        "others. Claimed is the mean probability of the predicted mode; right is the share of "
        "these samples whose mode is the predicted one. The calibration error (smaller is better) "
        "is the mean distance of the two over eight bins of p below 0.99, weighted by their "
        "numbers of samples; of all samples, the mean over the runs of "
        "`swsysid.metrics.mode_reliability`. "
    )
    part = parts["reliability"]
    seeds = f"{part['seeds']} seed{'s' * (part['seeds'] > 1)}"
    text += f"The runs are {seeds} of each of {len(part['cases'])} systems.\n"
    return [text, *table(["corruption", *columns], rows)]


def _times(timing: list[dict]) -> list[str]:
    """CPU seconds of ours and of PARC, a row for each corruption."""
    rows = []
    for scenario in SCENARIOS:
        seconds = np.array([one["seconds"] for one in timing if one["scenario"] == scenario])
        if len(seconds):
            ratios = seconds[:, :1] / seconds[:, 1:]
            numbers = [*np.median(seconds, axis=0), *np.median(ratios, axis=0), ratios[:, 0].max()]
            rows.append([scenario_title(scenario), *(f"{number:.2f}" for number in numbers)])
    if not rows:
        return []
    head = ["corruption", "swsysid, s", "PARC, kept fit, s", "PARC, all fits, s"]
    head += ["ratio to kept", "ratio to all", "largest ratio to kept"]
    return [
        "CPU seconds of the fit (smaller is better), both in turn in one process on one core "
        "(`--timing`). PARC is fitted ten times and the fit with the smallest training error is "
        "kept: seconds of that fit alone, and of all ten. Medians over the cases of their medians "
        "over the seeds; starting Python, reading and predicting are not timed.\n",
        *table(head, rows),
    ]


def _all_times(timing: list[dict]) -> list[str]:
    rows = []
    for one in timing:
        ours, kept, every = one["seconds"]
        numbers = (ours, kept, every, ours / kept, ours / every)
        title = scenario_title(one["scenario"])
        rows.append([one["case"], title, *(f"{number:.2f}" for number in numbers)])
    head = ["case", "corruption", "swsysid, s", "PARC, kept fit, s", "PARC, all fits, s"]
    head += ["ratio to kept", "ratio to all"]
    return table(head, rows) if rows else []


# -- one corruption ----------------------------------------------------------------------------


def _details(found: Cells, scenario: str) -> list[str]:
    cells = [cell for cell in found.with_methods() if cell[1] == scenario]
    cells = [cell for cell in cells if any(found.of(cell, m) for m in found.methods(scenario))]
    return [
        "Balanced accuracy of the modes (larger is better), median of the seeds (worst seed); and "
        "the loss against the oracle (smaller is better), median (largest).\n",
        *_accuracies(found, cells, scenario),
        "\nVelocity RMSE at all held-out samples / away from the guard, and misclassified samples "
        "of 2000 (smaller is better); medians of the seeds.\n",
        *_by_method(found, cells, scenario, _errors),
        "\nCPU seconds (smaller is better), medians.\n",
        *_by_method(found, cells, scenario, _seconds),
    ]


def _accuracies(found: Cells, cells: list[Cell], scenario: str) -> list[str]:
    methods = found.methods(scenario)
    is_compared = {"oracle", "ours"} <= set(methods)
    head = ["case", *(found.title(name, scenario) for name in methods)]
    rows = []
    for cell in cells:
        row = [cell[0], *(_accuracy(found.of(cell, name)) for name in methods)]
        rows.append(row + _loss(found, cell) * is_compared)
    return table(head + ["loss of swsysid", "close enough"] * is_compared, rows)


def _accuracy(figures: dict) -> str:
    if not figures:
        return "not run"
    median, worst = figures["balanced"][:2]
    return f"{median:.4f} ({worst:.4f})"


def _loss(found: Cells, cell: Cell) -> list[str]:
    ours = found.of(cell, "ours")
    if "loss" not in ours:
        return ["not run", ""]
    median, largest = ours["loss"]
    verdict = "yes" if is_close(found, cell) else MISSED + ", warned" * ours.get("warned", False)
    return [f"{median:+.4f} ({largest:+.4f})", verdict]


def _errors(found: Cells, cell: Cell, method: str) -> str:
    names = ("rmse", "rmse_away", "wrong")
    rmse, away, wrong = (found.value(cell, method, name) for name in names)
    return f"{rmse:.2g} / {away:.2g}, {wrong:.0f}" if np.isfinite(rmse) else "not run"


def _seconds(found: Cells, cell: Cell, method: str) -> str:
    return _entry(found.value(cell, method, "seconds"), ".2f")


def _by_method(
    found: Cells, cells: list[Cell], scenario: str, entry: Callable[[Cells, Cell, str], str]
) -> list[str]:
    methods = found.methods(scenario)
    head = ["case", *(found.title(name, scenario) for name in methods)]
    return table(head, [[cell[0], *(entry(found, cell, m) for m in methods)] for cell in cells])
