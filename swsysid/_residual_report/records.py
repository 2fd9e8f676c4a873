"""Records that a residual report is made of."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Finding", "Peak", "Size", "Whiteness"]


@dataclass(frozen=True)
class Size:
    """How large the residual of one equation is, and how much of it is noise.

    Attributes
    ----------
    equation : str
    mode : int or None
        None is all rows.
    n_rows : int
    rmse, r2 : float
    size : float
        Root mean square after cutting off at two robust standard deviations, as the noise.
    noise_floor : float or None
        Noise of the velocities, estimated as `how` says.
    how : str
    ratio : float or None
        `size` over `noise_floor`.
    explainable : float or None
        Share of the residual's variance above the floor.
    exact : bool
        The residual is zero to rounding; nothing is tested.
    """

    equation: str
    mode: object
    n_rows: int
    rmse: float
    r2: float
    size: float
    noise_floor: float | None
    how: str
    ratio: float | None
    explainable: float | None
    exact: bool


@dataclass(frozen=True)
class Whiteness:
    """Ljung-Box test of one equation; see `whiteness_test`."""

    equation: str
    statistic: float
    n_lags: int
    p_value: float
    significant: bool
    autocorrelation: tuple[float, ...]
    n_pairs: tuple[int, ...]
    coloured_trajectories: tuple


@dataclass(frozen=True)
class Finding:
    """One test of whether the residual of an equation depends on something.

    Attributes
    ----------
    equation : str
    mode : int or None
        Mode whose rows were tested, None for all.
    channel : str
        What it may depend on; ``"time"`` for a peak of the spectrum, ``"nothing"`` for a bias.
    kind : str
        ``"state"``, ``"input"``, ``"time"``, ``"signal"``, ``"mode"``, ``"pair"``, ``"lag"``,
        ``"residual lag"``, ``"surface"``, ``"periodic"`` or ``"bias"``.
    aspect : str
        ``"mean"`` or ``"spread"`` (the size of what is left when all means are taken away).
    share : float
        Share of the variance of the residual (of its size, for the spread) that it explains,
        beyond what chance does.
    p_value : float
        Corrected for all tests of the report.
    significant : bool
    direct : bool
        Significant, and not explained by stronger ones.
    shape : str
        A few words, empty if it is not significant.
    """

    equation: str
    mode: object
    channel: str
    kind: str
    aspect: str
    share: float
    p_value: float
    significant: bool = False
    direct: bool = False
    shape: str = ""


@dataclass(frozen=True)
class Peak:
    """Strongest peak of the spectrum of one equation.

    Attributes
    ----------
    equation : str
    frequency : float
        In Hz if the times are in s.
    share : float
        Share of the residual's variance in it.
    p_value : float
        Probability that noise has a peak as strong anywhere, corrected for all tests.
    significant : bool
    """

    equation: str
    frequency: float
    share: float
    p_value: float
    significant: bool
