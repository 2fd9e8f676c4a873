"""What a residual report holds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from swsysid._rendering.parts import Parts, plain
from swsysid._residual_report.findings import Finding, Peak
from swsysid._residual_report.noise_floor import Size
from swsysid._residual_report.text import verdict
from swsysid._residual_report.whiteness import Whiteness
from swsysid._results import Array

__all__ = ["ReportData", "ResidualContents"]


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
    """

    residual: Array
    channels: dict[str, Array]
    pairs: dict[str, tuple[str, str]]
    frequency: Array | None
    periodogram: dict[str, Array]


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

    _parts = (
        "clean",
        "equations",
        "n_samples",
        "n_trajectories",
        "significance",
        "n_permutations",
        "size",
        "whiteness",
        "dependence",
        "heteroscedasticity",
        "surface",
        "bias",
        "spectrum",
        "findings",
        "skipped",
        "verdicts",
    )

    def __getitem__(self, name: str) -> Any:
        return plain(super().__getitem__(name))

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was found: dependences that no stronger one explains, of all rows, means first."""
        found = [test for test in self.tests if test.direct and test.mode is None]
        return tuple(sorted(found, key=lambda test: (test.aspect != "mean", -test.share)))

    @property
    def clean(self) -> bool:
        """True if nothing was found: no dependence of any kind, no mode's, no colour."""
        found = any(test.significant for test in self.tests)
        return not found and not any(test.significant for test in self.whiteness)

    @property
    def dependence(self) -> tuple[Finding, ...]:
        """Tests of the mean against channels and their past."""
        return tuple(
            test
            for test in self.tests
            if test.aspect == "mean" and test.kind not in ("bias", "periodic")
        )

    @property
    def heteroscedasticity(self) -> tuple[Finding, ...]:
        """Tests of the spread against channels."""
        return tuple(
            test for test in self.tests if test.aspect == "spread" and test.kind != "surface"
        )

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
            name: verdict(
                [size for size in self.size if size.equation == name],
                [test for test in self.tests if test.equation == name],
                any(test.significant for test in self.whiteness if test.equation == name),
            )
            for name in self.equations
        }
