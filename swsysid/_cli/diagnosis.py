"""``--diagnose``: what a law lacks, searched in the recordings as they were measured."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton_regressor import HybridAutomatonRegressor
from swsysid._automaton_search.jumps import jumps_of
from swsysid._cli.automaton import Answer, automaton_of, own_warnings
from swsysid._cli.options import JobOptions
from swsysid._cli.recorded import Recorded
from swsysid._cli.runs import parted
from swsysid._cli.samples import Samples, measure
from swsysid._cli.text import described, preparation, units_of_displays
from swsysid._journal import handing_over
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._rendering.progress import stage
from swsysid._results import Array, SolverError
from swsysid._stays.given import FEWEST_SAMPLES, read_given
from swsysid._tables.table import Table, TableError
from swsysid._verdict.settings import JUDGING
from swsysid._verdict.terms import Terms
from swsysid.diagnosis import EffectSearchCV
from swsysid.differentiation import inspect_sensors
from swsysid.differentiation._smoothing import LARGEST_GAP
from swsysid.effects import Effect, all_effects, special_effects


@dataclass(frozen=True)
class Diagnosis:
    """What one law lacks, found in samples; or several laws in its place."""

    search: EffectSearchCV
    samples: Samples
    notes: Sequence[str]
    several: Answer | None = None

    @property
    def explains_little(self) -> bool:
        """Whether one law predicts less than half of what was held out, or lacks what has no name.

        All that was found stands beside it. What acts in time alone tells nothing of the plant: a
        thermostat that goes to and fro looks like a vibration.
        """
        report = self.search.report_
        if report.data is None or not report.of_rollouts:
            return False
        records = report.data.records
        spread = records.X[:, : len(self.left)].std(axis=0)
        left = np.sqrt(np.mean(np.square(self.left / spread)))
        rest, free = report.residual_before, report.data.free
        if rest is not None:
            leaves_more = not rest.clean
        else:  # nobody measured the velocities
            leaves_more = free is not None and not free.holds
        in_time = any(found.place == "time" for found in self.search.effects_)
        return bool(left > JUDGING.half) or in_time or (report.clean and leaves_more)

    @property
    def left(self) -> Array:
        """What free rollouts with all that was found leave of what was held out, (n_measured,).

        Empty where nothing was held out.
        """
        errors = self.search.report_.errors
        return np.array(errors[-1]["held_out"] if errors else [])

    @property
    def leaves_noise(self) -> bool:
        """Whether no model can leave a fraction of what one law leaves, for noise is all below."""
        samples, smoothing = self.samples, self.samples.smoothing
        if smoothing is None or not self.left.size:
            return False
        n_measured = len(samples.rate_names) - samples.n_known
        least = smoothing.noise[:n_measured] / JUDGING.noise_alone
        return bool((least >= JUDGING.told * self.left[:n_measured]).any())

    def is_worse_than(self, found: HybridAutomatonRegressor) -> bool:
        """Whether several laws leave a fraction of what one law leaves, and imitate no curve.

        Or nothing but noise where they are rolled out freely, and one law leaves more.
        """
        left, rollouts = self.left[: len(found.noise_)], found.report_.rollouts
        noise = found.noise_[: len(left)]
        leaves_less = bool((noise < JUDGING.told * left).all())
        if rollouts is not None and rollouts.holds:
            leaves_less = leaves_less or bool((JUDGING.noise_alone * noise < left).any())
        return leaves_less and bool(found.transitions_) and not found.report_.imitates

    @property
    def saved(self) -> tuple[EffectSearchCV, HybridAutomatonRegressor | None, Samples]:
        """What goes into files."""
        return self.search, None if self.several is None else self.several.found, self.samples

    @property
    def text(self) -> str:
        """The data, and what was found."""
        samples, recorded = self.samples, self.samples.recorded
        n_samples = len(samples.X) if recorded is None else recorded.n_samples
        n_groups = len(np.unique(samples.groups if recorded is None else recorded.groups))
        data = [described(samples, n_samples, n_groups), *preparation(samples)]
        return "\n\n".join(["\n".join(data), self.answer])

    @property
    def answer(self) -> str:
        """What was found."""
        samples = self.samples
        report = self.search.report_.to_text(units=units_of_displays(samples))
        if self.several is not None:
            sizes = zip(samples.names, self.left, strict=False)
            left = ", ".join(
                f"{name} {size:.3g} {samples.unit(name)}".rstrip() for name, size in sizes
            )
            alone = self.several.found.n_modes_ == 1
            what = "States jump" if alone else "Several laws follow each other"
            one_law = f"One law: {self.search.report_.summary}"
            if left:
                one_law = (
                    f"One law, with all that was found beside it, leaves {left} in free rollouts "
                    f"over what was held out: {self.search.report_.summary}"
                )
            told = "\n\n".join([self.several.report, *self.several.notes])
            report = f"{what}. {told}\n\n{one_law}"
        # what stands in the report, perhaps after another first sentence, is said
        notes = [f"note: {one}" for one in self.notes if one.split(". ", 1)[-1] not in report]
        return "\n\n".join([report, *notes])


def diagnosed(
    table: Table, options: JobOptions, effects: Sequence[Effect], is_left_open: bool, watched: bool
) -> Diagnosis:
    """What one law lacks; several laws, if the number is left open and one explains little."""
    with own_warnings() as notes, stage("Searching for what the law lacks", watched):
        # one law is rolled out through a rest as well
        samples = measure(table, options.measurement, rest="keep")
        columns = tuple(range(samples.X.shape[1]))
        if options.position == "no":
            columns = columns[samples.n_known :]
        terms = Terms(columns, options.library_degree, options.waves, *samples.angles)
        library, known = terms.library(samples.X.shape[1]), list(options.known) or None
        declared = options.regressor(1, feature_library=library, known=known)
        search = searched(samples, declared, effects, options)
    done = Diagnosis(search, samples, notes)
    if not is_left_open or done.leaves_noise:
        return done
    jumps = states_jump(samples, options)
    # one law, and what it jumps by, if that is enough; several, where one predicts little
    for modes in [1] * jumps + ["auto"] * done.explains_little:
        several, asked = None, samples if jumps else _thinned(samples)
        what = "Looking for jumps" if modes == 1 else "Looking for several laws"
        with stage(what, watched), suppress(SolverError):  # the one law stands without them
            several = automaton_of(
                asked, replace(options, modes=modes), is_worth=done.is_worse_than
            )
        if several is None:
            continue
        if not several.predicts_no_better:
            return replace(done, several=several)
        done = replace(done, notes=[*done.notes, _refused(several, samples)])
    return done


def _refused(several: Answer, samples: Samples) -> str:
    """Several laws that predict no better than one: nothing found is lost."""
    found = several.found
    sizes = zip(samples.names, found.noise_, strict=False)
    left = ", ".join(f"{name} {size:.3g} {samples.unit(name)}".rstrip() for name, size in sizes)
    return (
        f"{found.n_modes_} modes that are told when to switch would leave {left}, but predict what "
        "is held out no better than one law: none is claimed. --automaton tells what they are."
    )


def _thinned(samples: Samples) -> Samples:
    """As many rows as one law was asked of: those that lie on lines between them tell no more."""
    recorded = samples.recorded
    if recorded is None or recorded.thinning == 1:
        return samples
    return replace(samples, recorded=recorded.every(recorded.thinning))


def states_jump(samples: Samples, options: JobOptions) -> bool:
    """Whether states jump again and again, speeds of measured positions included."""
    recorded = samples.recorded
    if recorded is None or options.measurement.quantity:
        return False
    given = read_given(*recorded.named(samples.names, slice(None)))
    return sum(map(len, jumps_of(given.with_rates(options.measurement.order)))) > 1


def searched(
    samples: Samples,
    declared: SwitchingSystemRegressor,
    effects: Sequence[Effect],
    options: JobOptions,
) -> EffectSearchCV:
    """What a declared model lacks.

    States as they were measured are searched, for what a filter has smeared looks like other
    effects; with order 2 velocities are hidden.
    """
    search = EffectSearchCV(
        declared,
        effects=list(effects),
        order=options.measurement.order if _is_recorded(samples, declared, options) else 1,
        input_hold=options.measurement.input_hold,
        n_jobs=options.n_jobs,
        random_state=options.random_state,
        verbose=int(options.verbose),
    )
    with handing_over(None):
        return _fitted(search, samples, declared, options)


def _is_recorded(samples: Samples, declared: SwitchingSystemRegressor, options: JobOptions) -> bool:
    """Whether recordings are searched, not the velocities that a filter makes of them.

    Of several laws what a filter made of positions is no recording: they would be smoothed twice.
    """
    smoothed = options.measurement.order == 2 and declared.n_modes != 1
    return samples.recorded is not None and not smoothed


def _fitted(
    search: EffectSearchCV,
    samples: Samples,
    declared: SwitchingSystemRegressor,
    options: JobOptions,
) -> EffectSearchCV:
    import pandas as pd

    def frame(columns: NDArray, names: Sequence[str]) -> pd.DataFrame | None:
        return pd.DataFrame(columns, columns=list(names)) if len(names) else None

    recorded, signal_names = samples.recorded, samples.signal_names
    if recorded is None or not _is_recorded(samples, declared, options):
        logged = frame(samples.signals, signal_names)
        several, given = _several(samples.groups, options), samples.Xdot
        if options.measurement.quantity:
            given = pd.Series(given[:, 0], name=samples.rate_names[0])
        return search.fit(samples.frame, given, t=samples.t, groups=several, signals=logged)
    rows, names = recorded.of_samples(), samples.names
    if options.measurement.order == 2:
        rows = _inside(rows)
    n_states = rows.states.shape[1]
    return search.fit(
        frame(rows.states, names[:n_states]),
        t=rows.t,
        groups=_several(rows.groups, options),
        inputs=frame(rows.inputs, names[len(samples.rate_names) :]),
        signals=frame(rows.signals, signal_names),
    )


def _inside(rows: Recorded) -> Recorded:
    """Rows at which no sensor of a position stays at its end, in parts without a gap."""
    codes = np.unique(rows.groups.astype(str), return_inverse=True)[1]
    inside = np.flatnonzero(~inspect_sensors(rows.states, codes).clipped.any(axis=1))
    kept, parts = parted(rows.t[inside], rows.groups[inside], LARGEST_GAP, FEWEST_SAMPLES)
    own = inside[kept]
    return Recorded(
        rows.states[own], rows.inputs[own], rows.signals[own], rows.t[own], groups=parts
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
