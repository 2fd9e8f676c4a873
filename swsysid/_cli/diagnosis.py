"""``--diagnose``: what a law lacks, searched in the recordings as they were measured."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swsysid._cli.options import JobOptions
from swsysid._cli.samples import Samples, measure
from swsysid._cli.saving import save_diagnosis, units_of_displays
from swsysid._cli.terms import Terms
from swsysid._cli.text import described, preparation
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._tables.table import Table, TableError
from swsysid.diagnosis import EffectSearchCV
from swsysid.effects import Effect, all_effects, special_effects


def run_diagnosis(
    table: Table,
    options: JobOptions,
    effects: Sequence[Effect],
    folder: Path,
    page: Path,
    checksum: str,
) -> int:
    """Search for what one law lacks, print and save."""
    samples = measure(table, options.measurement)
    columns = tuple(range(samples.X.shape[1]))
    if options.position == "no":
        columns = columns[samples.n_known :]
    terms = Terms(columns, options.library_degree, options.waves, *samples.angles)
    declared = options.regressor(1, feature_library=terms.library(samples.X.shape[1]))
    search = searched(samples, declared, effects, options)
    n_samples, n_groups = len(samples.X), len(np.unique(samples.groups))
    told = [described(samples, n_samples, n_groups), *preparation(samples)]
    report = search.report_.to_text(units=units_of_displays(samples))
    text = "\n".join(told) + "\n\n" + report
    return save_diagnosis(search, samples, text, folder, page, checksum)


def searched(
    samples: Samples,
    declared: SwitchingSystemRegressor,
    effects: Sequence[Effect],
    options: JobOptions,
) -> EffectSearchCV:
    """What a declared model lacks.

    States as they were measured are searched, for what a filter has smeared looks like other
    effects; with order 2 velocities are those of the filter.
    """
    import pandas as pd

    def frame(columns: NDArray, names: Sequence[str]) -> pd.DataFrame | None:
        return pd.DataFrame(columns, columns=list(names)) if len(names) else None

    search = EffectSearchCV(
        declared,
        effects=list(effects),
        n_jobs=options.n_jobs,
        random_state=options.random_state,
        verbose=int(options.verbose),
    )
    recorded, n_states = samples.recorded, len(samples.rate_names)
    names, signal_names = samples.names, samples.signal_names
    signals, t, groups = samples.signals, samples.t, samples.groups
    if recorded is None:
        logged, several = frame(signals, signal_names), _several(groups, options)
        return search.fit(samples.frame, samples.Xdot, t=t, groups=several, signals=logged)
    x, inputs = samples.X[:, :n_states], samples.X[:, n_states:]
    if options.measurement.order == 1:
        rows = recorded.of_samples()
        x, inputs, signals, t, groups = (
            rows.states,
            rows.inputs,
            rows.signals,
            rows.t,
            rows.groups,
        )
    return search.fit(
        frame(x, names[:n_states]),
        t=t,
        groups=_several(groups, options),
        inputs=frame(inputs, names[n_states:]),
        signals=frame(signals, signal_names),
    )


def _several(groups: NDArray, options: JobOptions) -> NDArray | None:
    """Names of trajectories, where there are several or a column has them."""
    is_one = len(set(groups.tolist())) == 1 and not options.measurement.groups
    return None if is_one else groups


def chosen_effects(kinds: Sequence[str]) -> list[Effect]:
    """Effects of the library by their kinds, in its order; all but the special if none is named."""
    library = {effect.kind: effect for effect in [*all_effects(), *special_effects()]}
    for kind in kinds:
        if kind not in library:
            close = difflib.get_close_matches(kind, library, n=1)
            hint = f" Did you mean {close[0]!r}?" if close else ""
            raise TableError(
                f"--effects {kind!r} is no kind of effect.{hint} The kinds are: "
                f"{', '.join(library)}."
            )
    return [library[kind] for kind in library if kind in kinds] if kinds else all_effects()
