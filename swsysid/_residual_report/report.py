"""`ResidualReport`: what a residual holds, as an object, a dict, a table and a picture."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from swsysid._residual_report.records import Finding, Peak, Size, Whiteness
from swsysid._residual_report.text import table, verdict
from swsysid._results import Array

__all__ = ["ReportData", "ResidualReport", "plain"]


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


_PARTS = (
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


@dataclass(frozen=True, eq=False, repr=False)
class ResidualReport(Mapping):
    """What a fitted model leaves over; see `residual_report`.

    An object with the attributes below, and a mapping from their names (and those of the
    properties) to plain lists, dicts, numbers and strings: ``report["whiteness"]``,
    ``dict(report)``, ``json.dumps(report.to_dict())``.

    Attributes
    ----------
    equations : tuple of str
        States whose velocities are explained.
    n_samples, n_trajectories : int
        No trajectories if rows have no order.
    significance : float
    n_permutations : int
    size : tuple of Size
        Residual and noise floor of every equation, then of every equation and mode.
    whiteness : tuple of Whiteness
    tests : tuple of Finding
        Every dependence that was tested, the largest share first.
    spectrum : tuple of Peak
    skipped : dict of str to str
        What was not tested, and why.
    data : ReportData
        Arrays for `plot`; not part of the dict.
    """

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
        return {name: verdict(self, name) for name in self.equations}

    def __getitem__(self, name: str) -> Any:
        if name not in _PARTS:
            raise KeyError(f"{name!r} is no part of the report; these are: {', '.join(_PARTS)}.")
        return plain(getattr(self, name))

    def __iter__(self) -> Iterator[str]:
        return iter(_PARTS)

    def __len__(self) -> int:
        return len(_PARTS)

    def to_dict(self) -> dict[str, Any]:
        """Everything but `data`, in types that JSON knows; NaN becomes None."""
        return {name: self[name] for name in self}

    def plot(self, equation: str | None = None, *, ax=None):
        """Draw the residual of one equation; see `swsysid.plotting.ResidualReportDisplay`."""
        from swsysid._displays.residual_report import ResidualReportDisplay

        return ResidualReportDisplay.from_report(self, equation=equation, ax=ax)

    def __str__(self) -> str:
        return table(self)

    __repr__ = __str__


def plain(value: Any) -> Any:
    """The same in types that JSON knows; what is not finite becomes None."""
    if isinstance(value, np.generic):
        value = value.item()
    if hasattr(value, "__dataclass_fields__"):
        return plain(asdict(value))
    if isinstance(value, Mapping):
        return {str(name): plain(entry) for name, entry in value.items()}
    if isinstance(value, (tuple, list)):
        return [plain(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
