"""What to identify, and the estimator that is asked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from swsysid._classifier import PolynomialSurfaceClassifier
from swsysid._cli.measurement import Measurement
from swsysid._regressor import SwitchingSystemRegressor


@dataclass(frozen=True)
class JobOptions:
    """What to identify."""

    measurement: Measurement
    modes: int | str = 2  # or "auto"
    library_degree: int = 1  # of the law of each mode; 0 is linear without a constant
    waves: bool = False  # the law may have sines and cosines of the columns
    surface_degree: int = 1
    sparsity: str | float | None = None  # "auto" leaves out terms that are not needed
    loss: str = "l1"
    known: Sequence[str] = ()  # sentences of `swsysid.Known`
    position: str = "auto"  # with order 2: "yes" and "no" let the law use the positions or not
    test_fraction: float = 0.3
    random_state: int = 0
    quick: bool = False  # derivatives alone, however noisy
    n_jobs: int | None = None
    verbose: bool = False

    @property
    def has_measured_rates(self) -> bool:
        """Whether rates were measured, so that rows are searched and nothing is rolled out."""
        return bool(self.measurement.derivatives) and self.measurement.quantity is None

    @property
    def is_recording(self) -> bool:
        """Whether times are known and no rates, so that one law can be rolled out or compared."""
        return self.measurement.timed and not self.has_measured_rates

    @property
    def missing(self) -> str:
        """What laws lack that leave more than noise, and what looks for it."""
        told = "a term, a mode, an effect (--diagnose) or an impact (--automaton) is missing"
        return told if self.modes == "auto" else f"{told}; --modes auto tries more modes"

    def regressor(self, n_modes: object, **options) -> SwitchingSystemRegressor:
        """The estimator of so many modes; its other parameters are `options`."""
        return SwitchingSystemRegressor(
            n_modes=n_modes,
            surface=PolynomialSurfaceClassifier(degree=self.surface_degree),
            loss=self.loss,
            sparsity=self.sparsity,
            n_jobs=self.n_jobs,
            random_state=self.random_state,
            verbose=int(self.verbose),
        ).set_params(**options)
