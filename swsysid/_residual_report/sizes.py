"""How large a residual is, whether it is white and centred."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swsysid._residual_report.noise_floor import clipped_size, noise_floor
from swsysid._residual_report.records import Finding, Size, Whiteness
from swsysid._residual_report.samples import ResidualSamples, rows_of_modes
from swsysid._residual_report.whiteness import WhitenessTest, bias_p_value, holm, whiteness_test

__all__ = ["biases", "sizes", "whiteness"]

_EXACT = 1e-9  # of the velocities: below it a residual is rounding


def sizes(samples: ResidualSamples) -> list[Size]:
    """All equations in all rows first, then mode by mode."""
    everything = np.arange(len(samples.X))
    found = [_size(samples, i, None, everything) for i in range(len(samples.equations))]
    for mode, rows in rows_of_modes(samples):
        found += [_size(samples, i, mode, rows) for i in range(len(samples.equations))]
    return found


def _size(samples: ResidualSamples, equation: int, mode, rows: NDArray[np.intp]) -> Size:
    residual, target = samples.residual[rows, equation], samples.target[rows, equation]
    # Rows of one mode are not neighbours in time.
    in_time = samples.codes if samples.ordered and mode is None else None
    floor = noise_floor(residual, samples.X[rows], in_time)
    rmse, scale = float(np.sqrt(np.square(residual).mean())), float(target.std())
    unit = scale if scale > 0.0 else float(np.abs(target).max())
    exact = rmse <= _EXACT * unit
    size = clipped_size(residual)
    known = np.isfinite(floor.value) and not exact
    value = max(floor.value, _EXACT * unit) if known else None
    return Size(
        equation=samples.equations[equation],
        mode=mode,
        n_rows=len(rows),
        rmse=rmse,
        r2=1.0 - (rmse / scale) ** 2 if scale > 0.0 else float("nan"),
        size=size,
        noise_floor=value,
        how=floor.how,
        ratio=None if value is None else size / value,
        explainable=None if value is None else max(0.0, 1.0 - (value / size) ** 2),
        exact=bool(exact),
    )


def whiteness(samples, live, n_lags, significance, weight, skipped) -> list[Whiteness]:
    if not samples.ordered or not live:
        return []
    groups = samples.codes
    try:
        tests: list[WhitenessTest] = [
            whiteness_test(samples.residual[:, i], groups, n_lags=n_lags) for i in live
        ]
    except ValueError as error:
        skipped["whiteness"] = str(error).rstrip(".")
        return []
    corrected = np.minimum(1.0, holm([test.p_value for test in tests]) / weight)
    return [
        Whiteness(
            equation=samples.equations[i],
            statistic=test.statistic,
            n_lags=test.n_lags,
            p_value=float(p_value),
            significant=bool(p_value <= significance),
            autocorrelation=test.autocorrelation,
            n_pairs=test.n_pairs,
            coloured_trajectories=tuple(
                samples.trajectories[code] for code in test.coloured_trajectories
            ),
        )
        for i, test, p_value in zip(live, tests, corrected, strict=True)
    ]


def biases(samples, live, significance, weight) -> list[Finding]:
    if not live:
        return []
    codes = samples.codes if samples.ordered else np.arange(len(samples.X))
    residuals = [samples.residual[:, i] for i in live]
    corrected = np.minimum(1.0, holm([bias_p_value(one, codes) for one in residuals]) / weight)
    return [
        Finding(
            equation=samples.equations[i],
            mode=None,
            channel="nothing",
            kind="bias",
            aspect="mean",
            share=float(np.square(residual.mean()) / np.square(residual).mean()),
            p_value=float(p_value),
            significant=bool(p_value <= significance),
            direct=bool(p_value <= significance),
            shape=f"{residual.mean():.3g}" if p_value <= significance else "",
        )
        for i, residual, p_value in zip(live, residuals, corrected, strict=True)
    ]
