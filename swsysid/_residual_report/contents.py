"""What a residual report holds, and what was found in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from swsysid._rendering.parts import Parts, plain
from swsysid._rendering.printing import number, text_table
from swsysid._residual_report.findings import Finding, Peak
from swsysid._residual_report.noise_floor import Size
from swsysid._residual_report.whiteness import Whiteness
from swsysid._results import Array

_MOST_NAMED = 4  # dependences of one equation in its verdict
_MUCH = 0.5  # a share that is no noise and is spoken of, whatever the tests say


@dataclass(frozen=True, eq=False)
class ReportData:
    """Rows behind a report, for pictures of it.

    Attributes
    ----------
    residual : ndarray of shape (n_samples, n_equations)
    channels : dict of str to ndarray of shape (n_samples,)
        Every channel that was tested, NaN where it is not known.
    pairs : dict of str to tuple of two str
        The two channels of every pair.
    frequency : ndarray or None
    periodogram : dict of str to ndarray
    static : bool
        True if the residual is that of a quantity which is no rate.
    """

    residual: Array
    channels: dict[str, Array]
    pairs: dict[str, tuple[str, str]]
    frequency: Array | None
    periodogram: dict[str, Array]
    static: bool = False


@dataclass(frozen=True, eq=False, repr=False)
class ResidualContents(Parts):
    """Fields of a `ResidualReport`, which are described there, and what follows from them."""

    equations: tuple[str, ...]
    n_samples: int
    n_trajectories: int
    significance: float
    n_permutations: int
    size: tuple[Size, ...]
    whiteness: tuple[Whiteness, ...]
    tests: tuple[Finding, ...]
    spectrum: tuple[Peak, ...]
    skipped: dict[str, str]
    data: ReportData

    _parts = tuple(
        "clean equations n_samples n_trajectories significance n_permutations size whiteness "
        "dependence heteroscedasticity surface bias spectrum findings skipped verdicts".split()
    )

    def __getitem__(self, name: str) -> Any:
        return plain(super().__getitem__(name))

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was found: dependences that no stronger one explains, of all rows, means first."""
        found = [test for test in self.tests if test.direct and test.mode is None]
        return tuple(sorted(found, key=lambda test: (test.aspect != "mean", -test.share)))

    def against_channels(self, equation: str) -> list[Finding]:
        """Tests of an equation on all rows against channels, the findings first."""
        of_all = [test for test in self.tests if test.mode is None]
        others = [test for test in of_all if test.kind not in ("lag", "residual lag")]
        return [
            test
            for test in (*self.findings, *others)
            if test.equation == equation and test.channel in self.data.channels
        ]

    @property
    def clean(self) -> bool:
        """True if nothing was found: no dependence of any kind, no mode's, no colour."""
        found = any(test.significant for test in self.tests)
        return not found and not any(test.significant for test in self.whiteness)

    @property
    def dependence(self) -> tuple[Finding, ...]:
        """Tests of the mean against channels and their past."""
        means = [test for test in self.tests if test.aspect == "mean"]
        return tuple(test for test in means if test.kind not in ("bias", "periodic"))

    @property
    def heteroscedasticity(self) -> tuple[Finding, ...]:
        """Tests of the spread against channels."""
        spreads = [test for test in self.tests if test.aspect == "spread"]
        return tuple(test for test in spreads if test.kind != "surface")

    @property
    def surface(self) -> tuple[Finding, ...]:
        """Tests of the spread against the distance from the switching surface."""
        return tuple(test for test in self.tests if test.kind == "surface")

    @property
    def bias(self) -> tuple[Finding, ...]:
        """Tests of the mean against zero."""
        return tuple(test for test in self.tests if test.kind == "bias")

    @property
    def verdicts(self) -> dict[str, str]:
        """One sentence for each equation."""
        return {
            name: _verdict(
                [size for size in self.size if size.equation == name],
                [test for test in self.tests if test.equation == name],
                any(test.significant for test in self.whiteness if test.equation == name),
            )
            for name in self.equations
        }


# What the estimate of the noise has found the rest to be.
_SMOOTH = {
    "neighbours in time": "changes smoothly in time",
    "neighbours in space": "is a smooth function of the columns of X",
}


def table_of_sizes(sizes: Sequence[Size], whiteness: Sequence[Whiteness]) -> list[str]:
    """How large the residuals are, and whether they are white."""
    p_values = {test.equation: test.p_value for test in whiteness}
    white = [p_values.get(size.equation) if size.mode is None else None for size in sizes]
    values = ["<1e-16" if p is not None and p < 1e-16 else number(p, ".2g") for p in white]
    return text_table(
        [
            ("equation", "<8", [size.equation for size in sizes]),
            ("mode", ">4", [_mode(size.mode) for size in sizes]),
            ("rmse", ">10", [f"{size.rmse:.3g}" for size in sizes]),
            ("R2", ">8", [f"{size.r2:.4f}" for size in sizes]),
            ("noise", ">10", [number(size.noise_floor, ".3g") for size in sizes]),
            ("ratio", ">7", [number(size.ratio, ".3g") for size in sizes]),
            ("not noise", ">11", [number(size.explainable, ".0%") for size in sizes]),
            ("white p", ">8", values),
        ]
    )


def table_of_findings(found: Sequence[Finding]) -> list[str]:
    """What the residuals depend on."""
    return text_table(
        [
            ("equation", "<8", [one.equation for one in found]),
            ("mode", ">4", [_mode(one.mode) for one in found]),
            ("depends on", "<10", [_name(one) for one in found]),
            ("what", "<6", [one.aspect for one in found]),
            ("share", ">6", [f"{one.share:.1%}" for one in found]),
            ("p", ">7", [f"{one.p_value:.2g}" for one in found]),
            (" shape", "", [f" {one.shape}" for one in found]),
        ]
    )


def _mode(mode: object) -> str:
    return "all" if mode is None else str(mode)


def _name(finding: Finding) -> str:
    return {"bias": "(offset)", "periodic": "(oscillation)"}.get(finding.kind, finding.channel)


def _verdict(sizes: Sequence[Size], tests: Sequence[Finding], coloured: bool) -> str:
    """One sentence on one equation: its sizes, its tests, and whether it is correlated in time."""
    size = next(size for size in sizes if size.mode is None)
    if size.exact:
        return "nothing is left: the residual is zero to rounding."
    direct = [test for test in tests if test.direct]
    of_all = [test for test in direct if test.mode is None]
    clauses = _means([test for test in of_all if test.aspect == "mean"])
    clauses += _spreads([test for test in of_all if test.aspect == "spread"])
    n_modes = sum(size.mode is not None for size in sizes)
    clauses += _in_some_modes([test for test in direct if test.mode is not None], n_modes)
    share = size.explainable or 0.0
    if not clauses and share >= _MUCH:
        what = f"{share:.0%} of it {_SMOOTH[size.how]}"
        clauses = [f"{what}, though no test names what it depends on"]
    elif not clauses and coloured:
        clauses = ["it is correlated in time, though no test names what it depends on"]
    if not clauses:
        return f"nothing is left; {_size_in_words(size)}."
    return f"{_size_in_words(size)}; {'; '.join(clauses)}."


def _size_in_words(size: Size) -> str:
    if size.ratio is None:
        return f"the residual is {size.size:.3g}"
    if size.ratio >= 1e4:
        return "the residual is all but free of noise"
    digits = 1 if size.ratio < 100 else 0
    return f"the residual is {size.ratio:.{digits}f} times the noise floor"


def _means(found: Sequence[Finding]) -> list[str]:
    channels = [one for one in found if one.kind not in ("bias", "periodic")]
    named = " and on ".join(_detail(one) for one in channels[:_MOST_NAMED])
    clauses = []
    for one in found:
        if one.kind == "bias":
            clauses.append(f"it is off by {one.shape} on average (p<={one.p_value:.2g})")
        elif one.kind == "periodic":
            clauses.append(f"it oscillates at {one.shape} (p<={one.p_value:.2g}, {one.share:.0%})")
        elif one is channels[0]:
            clauses.append(f"it depends on {named}")
    return clauses


def _spreads(found: Sequence[Finding]) -> list[str]:
    return [
        f"it is {one.shape.replace(' it', ' the switching surface')}"
        if one.kind == "surface"
        else f"its spread depends on {_detail(one)}"
        for one in found
    ]


def _in_some_modes(found: Sequence[Finding], n_modes: int) -> list[str]:
    """What is there in some modes but not in all of them."""
    count = {one.channel: sum(two.channel == one.channel for two in found) for one in found}
    first = list(count)
    clauses = [
        f"in mode {one.mode} alone it depends on {_detail(one)}"
        for one in sorted(found, key=lambda one: first.index(one.channel))
        if count[one.channel] < n_modes
    ]
    return clauses[:_MOST_NAMED]


def _detail(finding: Finding) -> str:
    shape = f", {finding.shape}" if finding.shape else ""
    return f"{_name(finding)} (p<={finding.p_value:.2g}, {finding.share:.0%} of it{shape})"
