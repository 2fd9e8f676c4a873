"""A residual report in words."""

from __future__ import annotations

from typing import Any

from swsysid._residual_report.records import Finding, Size

__all__ = ["table", "verdict"]

# The table names so many dependences of each equation.
_MOST_NAMED = 4
# Share of a residual that is no noise and has to be spoken of, whatever the tests say.
_MUCH = 0.5
# What the estimate of the noise has found the rest to be.
_SMOOTH = {
    "neighbours in time": "changes smoothly in time",
    "neighbours in space": "is a smooth function of the columns of X",
}


def table(report: Any) -> str:
    """The whole report, about one line for each thing worth reading."""
    trajectories = {0: "rows without order", 1: "1 trajectory"}.get(
        report.n_trajectories, f"{report.n_trajectories} trajectories"
    )
    head = (
        f"Residual report: {report.n_samples} rows, {trajectories}, "
        f"significance {report.significance:g}"
    )
    lines = [head, *_sizes(report), ""]
    found = [test for test in report.tests if test.significant and test.direct]
    if found:
        lines += [*_found(found), ""]
    lines += [f"{name}: {text}" for name, text in report.verdicts.items()]
    lines += [f"skipped: {part} ({reason})" for part, reason in report.skipped.items()]
    return "\n".join(lines)


def _sizes(report: Any) -> list[str]:
    width = max(8, *(len(name) for name in report.equations))
    white = {test.equation: test.p_value for test in report.whiteness}
    lines = [
        f"{'equation':<{width}} {'mode':>4} {'rmse':>10} {'R2':>8} {'noise':>10} {'ratio':>7} "
        f"{'not noise':>11} {'white p':>8}"
    ]
    for size in report.size:
        p_value = white.get(size.equation) if size.mode is None else None
        lines.append(
            f"{size.equation:<{width}} {'all' if size.mode is None else str(size.mode):>4} "
            f"{size.rmse:>10.3g} {size.r2:>8.4f} {_number(size.noise_floor, '.3g'):>10} "
            f"{_number(size.ratio, '.3g'):>7} {_number(size.explainable, '.0%'):>11} "
            f"{_p_value(p_value):>8}"
        )
    return lines


def _number(value: float | None, style: str) -> str:
    return "-" if value is None else format(value, style)


def _p_value(value: float | None) -> str:
    return "<1e-16" if value is not None and value < 1e-16 else _number(value, ".2g")


def _found(found: list[Finding]) -> list[str]:
    names = [_name(finding) for finding in found]
    width = max(10, *(len(name) for name in names))
    equations = max(8, *(len(finding.equation) for finding in found))
    lines = [
        f"{'equation':<{equations}} {'mode':>4} {'depends on':<{width}} {'what':<6} {'share':>6} "
        f"{'p':>7}  shape"
    ]
    for finding, name in zip(found, names, strict=True):
        lines.append(
            f"{finding.equation:<{equations}} "
            f"{'all' if finding.mode is None else str(finding.mode):>4} {name:<{width}} "
            f"{finding.aspect:<6} {finding.share:>6.1%} {finding.p_value:>7.2g}  {finding.shape}"
        )
    return lines


def _name(finding: Finding) -> str:
    return {"bias": "(offset)", "periodic": "(oscillation)"}.get(finding.kind, finding.channel)


def verdict(report: Any, equation: str) -> str:
    """One sentence on one equation."""
    size = next(size for size in report.size if size.equation == equation and size.mode is None)
    if size.exact:
        return "nothing is left: the residual is zero to rounding."
    found = [finding for finding in report.findings if finding.equation == equation]
    clauses = _clauses(found)
    clauses += _in_one_mode(report, equation)
    coloured = any(test.significant for test in report.whiteness if test.equation == equation)
    clauses = clauses or _unnamed(size, coloured)
    if clauses:
        return f"{_size_in_words(size)}; {'; '.join(clauses)}."
    return f"nothing is left; {_size_in_words(size)}."


def _unnamed(size: Size, coloured: bool) -> list[str]:
    """What is there although no test names what it depends on."""
    share = size.explainable or 0.0
    if share >= _MUCH:
        return [f"{share:.0%} of it {_SMOOTH[size.how]}, though no test names what it depends on"]
    return ["it is correlated in time, though no test names what it depends on"] if coloured else []


def _in_one_mode(report: Any, equation: str) -> list[str]:
    """What is there in some modes but not in all of them."""
    examined = {size.mode for size in report.size if size.equation == equation} - {None}
    found: dict[str, list[Finding]] = {}
    for test in report.tests:
        if test.equation == equation and test.mode is not None and test.direct:
            found.setdefault(test.channel, []).append(test)
    return [
        f"in mode {test.mode} alone it depends on {_detail(test)}"
        for tests in found.values()
        for test in tests
        if len(tests) < len(examined)
    ][:_MOST_NAMED]


def _size_in_words(size: Size) -> str:
    if size.ratio is None:
        return f"the residual is {size.size:.3g}"
    if size.ratio < 1e4:
        return (
            f"the residual is {size.ratio:.{1 if size.ratio < 100 else 0}f} times the noise floor"
        )
    return "the residual is all but free of noise"


def _clauses(found: list[Finding]) -> list[str]:
    """What the mean does first, then what the spread does."""
    clauses = []
    means = [finding for finding in found if finding.aspect == "mean"]
    channels = [finding for finding in means if finding.kind not in ("bias", "periodic")]
    for finding in means:
        if finding.kind == "bias":
            clauses.append(f"it is off by {finding.shape} on average (p<={finding.p_value:.2g})")
        elif finding.kind == "periodic":
            clauses.append(
                f"it oscillates at {finding.shape} (p<={finding.p_value:.2g}, {finding.share:.0%})"
            )
        elif finding is channels[0]:
            named = [_detail(channel) for channel in channels[:_MOST_NAMED]]
            clauses.append(f"it depends on {' and on '.join(named)}")
    for finding in found:
        if finding.kind == "surface":
            clauses.append(f"it is {finding.shape.replace(' it', ' the switching surface')}")
        elif finding.aspect == "spread":
            clauses.append(f"its spread depends on {_detail(finding)}")
    return clauses


def _detail(finding: Finding) -> str:
    shape = f", {finding.shape}" if finding.shape else ""
    return f"{_name(finding)} (p<={finding.p_value:.2g}, {finding.share:.0%} of it{shape})"
