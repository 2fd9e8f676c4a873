"""The tables of the quality benchmark in Markdown, from its records."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
from quality_goals import goals, is_close
from quality_records import SCENARIOS, TITLES, Cell, Records

__all__ = ["summary", "tables"]

# What one test sample of a small mode weighs; less is no difference between methods.
TIE = 0.002


def summary(records: list[dict], timings: list[dict]) -> str:
    """All cells together; seconds are compared in `timings` where there are any."""
    found, timed = Records(records), Records(timings or records)
    return _sections(
        ("Summary", _summary(found)),
        ("Where another method is ahead", _defeats(found)),
        ("Figures to reach", [f"- {line}" for line in goals(found, timed)]),
        ("How far the probabilities can be trusted", _reliability(found)),
        ("Time", _times(timed, is_apart=bool(timings))),
    )


def tables(records: list[dict], timings: list[dict]) -> str:
    """Every method in every case, a section for each corruption; then seconds beside PARC's."""
    found = Records(records)
    return _sections(
        *((_title(name), _details(found, name)) for name in found.scenarios),
        ("Seconds beside PARC's", _all_times(Records(timings or records))),
    )


def _sections(*sections: tuple[str, list[str]]) -> str:
    shown = [(title, "\n".join(lines)) for title, lines in sections if lines]
    return "\n".join(f"## {title}\n\n{text}\n" for title, text in shown)


def _table(head: list[str], rows: Iterable[list[str]]) -> list[str]:
    """A Markdown table, the first column left, the others right."""
    lines = ["| " + " | ".join(head) + " |", "|---" + "|---:" * (len(head) - 1) + "|"]
    return lines + ["| " + " | ".join(row) + " |" for row in rows]


def _title(scenario: str) -> str:
    return SCENARIOS[scenario].told if scenario in SCENARIOS else scenario


def _number(value: float, form: str) -> str:
    return f"{value:{form}}" if np.isfinite(value) else "-"


# -- all cells together ------------------------------------------------------------------------


def _summary(found: Records) -> list[str]:
    """Methods beside each other, a row for each corruption: typical case, and farthest one."""
    scenarios = [name for name in found.scenarios if name in SCENARIOS]
    head = ["corruption", *(TITLES[name] for name in found.methods)]

    def pivot(entry: Callable[[Records, list[Cell], str], str]) -> list[str]:
        rows = []
        for scenario in scenarios:
            row = [_title(scenario)]
            for method in found.methods:
                cells = [c for c in found.cells_with("oracle", method) if c[1] == scenario]
                row.append(entry(found, cells, method) if cells else "-")
            rows.append(row)
        return _table(head, rows)

    return [
        "Balanced accuracy of the modes, mean of the cases' medians over the seeds; in brackets "
        "the number of cases whose median loss against the oracle is at most 0.005.\n",
        *pivot(_typical),
        "\nThe case with the largest median loss of balanced accuracy against the oracle.\n",
        *pivot(_farthest),
        "\nSeeds: " + ", ".join(_seeds(found, method) for method in found.methods) + ".",
    ]


def _losses(found: Records, cells: list[Cell], method: str) -> np.ndarray:
    return np.array([np.median(found.differences(cell, method)) for cell in cells])


def _typical(found: Records, cells: list[Cell], method: str) -> str:
    mean = np.mean([found.median(cell, method, "balanced") for cell in cells])
    near = np.sum(_losses(found, cells, method) <= SCENARIOS["clean"].median)
    return f"{mean:.4f} ({near} of {len(cells)})"


def _farthest(found: Records, cells: list[Cell], method: str) -> str:
    losses = _losses(found, cells, method)
    worst = int(np.argmax(losses))
    return f"{losses[worst]:.4f} ({cells[worst][0]})" if method != "oracle" else ""


def _seeds(found: Records, method: str) -> str:
    counts = [
        len(found.rows(cell, method)) for cell in found.cells_with(method) if cell[1] in SCENARIOS
    ]
    low, high = min(counts), max(counts)
    return f"{TITLES[method]} {low}" + (f" to {high}" if high > low else "")


def _defeats(found: Records) -> list[str]:
    """The cells in which k-plane or PARC has the better median, the largest difference first."""
    rows = []
    for method in ("k_plane", "parc"):
        for cell in found.cells_with("ours", method):
            theirs, ours = (found.median(cell, name, "balanced") for name in (method, "ours"))
            if theirs > ours + TIE:
                row = [cell[0], _title(cell[1]), TITLES[method], f"{theirs:.4f}", f"{ours:.4f}"]
                rows.append((ours - theirs, row))
    if not found.cells_with("ours"):
        return []
    told = f"Cells where the median is more than {TIE} above that of swsysid"
    if not rows:
        return [f"{told}: none."]
    rows.sort(key=lambda pair: pair[0])
    head = ["case", "corruption", "method", "its median", "swsysid"]
    return [f"{told}.\n", *_table(head, [row for _, row in rows])]


def _reliability(found: Records) -> list[str]:
    """Claimed probability of the predicted mode against how often it is right."""
    rows = []
    for scenario in found.scenarios:
        chosen = [
            row
            for row in found.with_method("ours")
            if row["scenario"] == scenario and "reliability" in row
        ]
        if chosen:
            rows.append([_title(scenario), *_claims(chosen)])
    head = ["corruption", "least sure 10 %: claimed", "right", "p < 0.99: share of all"]
    head += ["claimed", "right", "calibration error", "p >= 0.99: right"]
    head += ["all samples: calibration error"]
    return [] if not rows else [
        "`predict_mode_proba` at the held-out samples, all cases and seeds of a corruption "
        "together: the tenth of each run of which the model is least sure, the samples with "
        "p < 0.99, and the others. Claimed: mean probability of the predicted mode; right: share "
        "of these samples whose mode is the predicted one. Calibration error: the mean distance "
        "of the two over eight bins of p below 0.99, weighted by their numbers of samples; of all "
        "samples, the mean over the runs of `swsysid.metrics.mode_reliability`.\n",
        *_table(head, rows),
    ]  # fmt: skip


def _claims(chosen: list[dict]) -> list[str]:
    bins = np.sum([row["reliability"] for row in chosen], axis=0)
    number, claimed, right = bins[:-1].T  # the last bin holds the samples it is sure of
    total = max(number.sum(), 1)
    shares = [
        np.mean([row["least_claimed"] for row in chosen]),
        np.mean([row["least_right"] for row in chosen]),
        number.sum() / bins[:, 0].sum(),
        claimed.sum() / total,
        right.sum() / total,
        np.abs(claimed - right).sum() / total,
        bins[-1, 2] / max(bins[-1, 0], 1),
        np.mean([row["calibration"] for row in chosen]),
    ]
    return [f"{share:.4f}" for share in shares]


def _times(timed: Records, is_apart: bool) -> list[str]:
    """CPU seconds of ours and of PARC, a row for each corruption."""
    rows = []
    for scenario in timed.scenarios:
        cells = [cell for cell in timed.cells_with("ours", "parc") if cell[1] == scenario]
        if cells:
            seconds = np.array([_seconds_beside_parc(timed, cell) for cell in cells])
            ratios = seconds[:, :1] / seconds[:, 1:]
            numbers = [*np.median(seconds, axis=0), *np.median(ratios, axis=0), ratios[:, 0].max()]
            rows.append([_title(scenario), *(f"{number:.2f}" for number in numbers)])
    source = (
        "Both in turn in one process on one core (`--timing`)."
        if is_apart
        else "From the runs of the tables, which may have shared the machine with others."
    )
    head = ["corruption", "swsysid, s", "PARC, kept fit, s", "PARC, all fits, s"]
    head += ["ratio to kept", "ratio to all", "largest ratio to kept"]
    return [] if not rows else [
        f"CPU seconds of the fit. {source} PARC is fitted ten times and the fit with the "
        "smallest training error is kept: seconds of that fit alone, and of all ten. Medians "
        "over the cases of their medians over the seeds; starting Python, reading and predicting "
        "are not timed.\n",
        *_table(head, rows),
    ]  # fmt: skip


def _seconds_beside_parc(timed: Records, cell: Cell) -> list[float]:
    columns = (("ours", "seconds"), ("parc", "seconds"), ("parc", "seconds_all"))
    return [timed.median(cell, *column) for column in columns]


def _all_times(timed: Records) -> list[str]:
    """A row for each cell that has both."""
    rows = []
    for cell in timed.cells_with("ours", "parc"):
        ours, kept, every = seconds = _seconds_beside_parc(timed, cell)
        numbers = (*seconds, ours / kept, ours / every)
        rows.append([cell[0], _title(cell[1]), *(f"{number:.2f}" for number in numbers)])
    head = ["case", "corruption", "swsysid, s", "PARC, kept fit, s", "PARC, all fits, s"]
    head += ["ratio to kept", "ratio to all"]
    return _table(head, rows) if rows else []


# -- one corruption ----------------------------------------------------------------------------


def _details(found: Records, scenario: str) -> list[str]:
    cells = found.cells_of(scenario)
    return [
        "Balanced accuracy of the modes, median of the seeds (worst seed).\n",
        *_accuracies(found, cells),
        "\nVelocity RMSE at all held-out samples / away from the guard, and misclassified samples "
        "of 2000; medians of the seeds.\n",
        *_errors(found, cells),
        "\nCPU seconds, medians.\n",
        *_seconds(found, cells),
    ]


def _accuracies(found: Records, cells: list[Cell]) -> list[str]:
    head = ["case", *(TITLES[name] for name in found.methods)]
    has_gap = bool(found.cells_with("oracle", "ours"))
    rows = []
    for cell in cells:
        row = [cell[0], *(_accuracy(found.values(cell, m, "balanced")) for m in found.methods)]
        rows.append(row + _gap(found, cell) * has_gap)
    return _table(head + ["loss of swsysid", "reached"] * has_gap, rows)


def _accuracy(values: np.ndarray) -> str:
    return f"{np.median(values):.4f} ({values.min():.4f})" if len(values) else "-"


def _gap(found: Records, cell: Cell) -> list[str]:
    gaps = found.differences(cell, "ours") if found.rows(cell, "ours") else np.array([])
    if not len(gaps):
        return ["-", "-"]
    verdict = "yes" if is_close(found, cell) else "**no**"
    return [f"{np.median(gaps):+.4f} ({gaps.max():+.4f})", verdict]


def _errors(found: Records, cells: list[Cell]) -> list[str]:
    def entry(cell: Cell, method: str) -> str:
        rmse, away, wrong = (
            found.median(cell, method, column) for column in ("rmse", "rmse_away", "wrong")
        )
        return f"{rmse:.2g} / {away:.2g}, {wrong:.0f}" if np.isfinite(rmse) else "-"

    return _by_method(found, cells, entry)


def _seconds(found: Records, cells: list[Cell]) -> list[str]:
    def entry(cell: Cell, method: str) -> str:
        return _number(found.median(cell, method, "seconds"), ".2f")

    return _by_method(found, cells, entry)


def _by_method(found: Records, cells: list[Cell], entry: Callable[[Cell, str], str]) -> list[str]:
    head = ["case", *(TITLES[name] for name in found.methods)]
    return _table(head, [[cell[0], *(entry(cell, m) for m in found.methods)] for cell in cells])
