"""From recordings to an automaton in discrete time: laws and stays by rows, resets, guards."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton.model import HybridAutomaton
from swsysid._automaton.parts import FirstModes
from swsysid._automaton.transitions import PolynomialGuard
from swsysid._automaton_search.answer import IdentifiedAutomaton
from swsysid._automaton_search.assembly import (
    automaton_of,
    order_of_modes,
    switch_times_of,
    verdicts_of,
)
from swsysid._automaton_search.certificates import UNKNOWN, Certificate, certificate
from swsysid._automaton_search.conditions import Ways, ways_of
from swsysid._automaton_search.doubts import shared_exits
from swsysid._automaton_search.errors import AutomatonErrors
from swsysid._automaton_search.found import FoundReset, FoundTransition
from swsysid._automaton_search.judged import (
    Guards,
    by_rollouts,
    follows_better,
    judged,
    switches_by_recording,
)
from swsysid._automaton_search.margins import Sides, guard_with_margin, surface_with_margin
from swsysid._automaton_search.mode_rows import ModeRows, Taken
from swsysid._automaton_search.resets import best_reset
from swsysid._automaton_search.settings import SETTINGS
from swsysid._automaton_search.ways_out import by_ways, in_order, with_lent_guards
from swsysid._checks.parameters import whole
from swsysid._discrete_stays.identify import (
    DiscreteCertainty,
    DiscreteStays,
    finer,
    identify_stays,
    parted,
    with_guards,
)
from swsysid._discrete_stays.knowledge import checked
from swsysid._discrete_stays.lagged import KnownGuard
from swsysid._free_rollouts.judge import FreeRollouts
from swsysid._free_rollouts.sample_noise import SampleNoise
from swsysid._journal import step
from swsysid._known.checks import KnownCheck
from swsysid._known.known import Known, refuse_energies
from swsysid._results import Array
from swsysid._stays.given import Given

# Turns of modes and guards; of a spread, what is counted as exact.
_TURNS_OF_MODES = 6
_LEAST_NOISE = 1e-9

Pair = tuple[int, int]


def check_times(
    discrete: bool,
    order: int,
    lags: object,
    sparsity: object,
    input_hold: object,
    known: Known | None,
) -> None:
    """ValueError for what is asked of the other kind of time."""
    whole("lags", lags, least=0, also=("auto",))
    if not discrete and lags != 0:
        raise ValueError(
            f"lags={lags!r} is for discrete time; set discrete_time=True, or leave lags at 0."
        )
    if not discrete:
        return
    if order == 2:
        raise ValueError("order=2 is for continuous time; in discrete time set lags=1.")
    if known is not None:
        if lags == "auto":
            raise ValueError(
                "known needs the number of lags, by which terms have their names; give lags=1 or "
                "another number, or leave known out."
            )
        refuse_energies(known)
    if sparsity is not None:
        raise ValueError("sparsity is for continuous time; leave it at None.")
    if input_hold != "auto":
        raise ValueError("input_hold is for continuous time; in discrete time every row acts.")


def identified(
    given: Given,
    *,
    lags: int | str,
    library: object,
    n_modes: int | str,
    max_modes: int,
    degree: int,
    known: Known | None = None,
) -> IdentifiedAutomaton:
    """The automaton of some recordings; `degree` is that of the guards."""

    def anew(left_out: frozenset[int]) -> DiscreteStays:
        return identify_stays(
            given.records,
            lags,
            library=library,
            n_modes=n_modes,
            channels=given.names,
            max_modes=max_modes,
            known=known.without(left_out) if known is not None else None,
        )

    stays = anew(frozenset())
    told = _Told.of(ModeRows(stays, given), degree)
    most = max_modes if n_modes == "auto" else int(n_modes)
    for otherwise in (finer, parted):
        if told.rollouts.holds and told.rollouts.tells_switches:
            break
        if (other := otherwise(stays, most)) is not None:
            # of two descriptions the one whose free rollouts are right from any start
            again = _Told.of(ModeRows(other, given), degree)
            if follows_better(again.rollouts, told.rollouts):
                told, stays = again, other
    return told.answer(checked(told.made.rows.stays, told.made.order, anew))


@dataclass(frozen=True)
class _Told:
    """Stays with the transitions between them, and what free rollouts say of both."""

    sure: DiscreteCertainty
    made: _Made
    rollouts: FreeRollouts
    seen: SampleNoise

    @classmethod
    def of(cls, rows: ModeRows, degree: int) -> _Told:
        """Transitions of stays; of guards that tell as well those whose rollouts are right."""
        rows, transitions = _agreeing(rows, degree)
        if whole := _whole_resets(rows):
            rows = replace(rows, whole=whole)
            transitions = transitions_of(rows, degree)
        stays, sure = rows.stays, DiscreteCertainty.of(rows.stays)
        noise = stays.noise if sure.noises is None else np.hypot(*sure.noises.sizes)

        def with_guards(guards: Guards) -> _Made:
            changed = [
                replace(one, guard=guard) for one, guard in zip(transitions, guards, strict=True)
            ]
            return _Made.of(rows, changed)

        guards = [one.guard for one in transitions]
        if sure.noises is None or not sure.noises.drives:  # else rollouts go where noise leads
            guards = by_rollouts(guards, lambda own: with_guards(own).rolled_out(noise)[0])
        made = with_guards(guards)
        return cls(sure, made, *made.rolled_out(noise))

    def answer(self, known: tuple[KnownCheck, ...]) -> IdentifiedAutomaton:
        """All that is said of it."""
        made, sure, rows = self.made, self.sure, self.made.rows
        found, order, automaton, stays = made.found, made.order, made.automaton, rows.stays
        jumps = sum(
            np.count_nonzero(rows.taken.jumped[_is_of(one, rows.taken)])
            for one in found
            if one.jumps
        )
        certificates = [_certificate(one, rows) for one in found]
        return IdentifiedAutomaton(
            automaton,
            AutomatonErrors.by_parts(sure.coef, found, automaton, order),
            made.modes,
            made.states,
            switch_times_of(found, len(rows.given.records)),
            stays.noise,
            None,
            verdicts_of(found, certificates, order, 1.0, automaton.guard_columns),
            self.rollouts,
            (*_shared_exits(made), *self.seen.sentences(automaton.state_names)),
            stays.candidates,
            int(stays.straddling.sum() - jumps - rows.n_made_anew),
            noises=sure.noises,
            known=known,
        )


@dataclass(frozen=True)
class _Made:
    """An automaton of some transitions, and what the recordings went through."""

    rows: ModeRows
    found: list[FoundTransition]  # those at the ends of recordings included
    automaton: HybridAutomaton
    order: NDArray[np.intp]  # the mode that was found as each of its modes
    modes: list[NDArray[np.intp]]

    @classmethod
    def of(cls, rows: ModeRows, transitions: Sequence[FoundTransition]) -> _Made:
        """That of transitions with these guards."""
        stays = rows.stays
        modes, found = rows.with_ends(transitions)
        order = order_of_modes(modes, len(stays.coef))
        first = FirstModes(rows.columns[:, : rows.n_lagged], rows.modes)
        lags = stays.rows.lags
        automaton = automaton_of(
            stays.coef, stays.feature_map, found, first, order, 1.0, discrete_time=True, lags=lags
        )
        return cls(rows, found, automaton, order, [np.argsort(order)[own] for own in modes])

    @property
    def states(self) -> list[Array]:
        """Of all samples, measured where no row tells them."""
        pairs = zip(self.rows.stays.states, self.rows.given.records, strict=True)
        return [np.where(np.isfinite(x), x, record.filled) for x, record in pairs]

    def rolled_out(self, noise: Array) -> tuple[FreeRollouts, SampleNoise]:
        """What free rollouts leave, and of which noise."""
        given = self.rows.given
        switches = switches_by_recording(self.found, self.order, len(given.records))
        return judged(self.automaton, given, self.modes, self.states, switches, noise)


def _shared_exits(made: _Made) -> Iterator[str]:
    """What is said of modes that are left two ways at one guard."""
    taken, pairs = made.rows.taken, _pairs_of(made.rows.taken)

    def given(one: FoundTransition) -> Array:
        return taken.given[(pairs == (one.source, one.target)).all(axis=1)]

    def rises(one: FoundTransition, other: FoundTransition) -> float:
        assert one.guard is not None, "only guards are compared"
        return float(np.mean(one.guard.whole.values(given(other)) >= 0.0))

    names = np.argsort(made.order).tolist()
    return shared_exits(made.found, rises, given, names, made.automaton.guard_columns)


def _agreeing(rows: ModeRows, degree: int) -> tuple[ModeRows, list[FoundTransition]]:
    """Modes and guards in turn, until modes stay or are no likelier than before."""
    found = transitions_of(rows, degree)
    before = -np.inf
    for turn in range(_TURNS_OF_MODES):
        guards = [
            KnownGuard(one.source, one.target, one.guard.whole, 1.0 / (len(one) + 1.0))
            for one in found
            if one.guard is not None and not one.jumps
        ]
        if not guards:
            break
        if turn == 0:
            before = with_guards(rows.stays, [])[1]
        again, likelihood = with_guards(rows.stays, guards)
        if likelihood <= before:
            break
        before, same = likelihood, np.array_equal(again.modes, rows.stays.modes)
        rows = ModeRows(again, rows.given)
        found = transitions_of(rows, degree)
        if same:
            break
    return rows, found


@step
def transitions_of(rows: ModeRows, degree: int) -> list[FoundTransition]:
    """Guards and resets of all transitions that are taken."""
    pairs = [(int(i), int(j)) for i, j in np.unique(_pairs_of(rows.taken), axis=0)]
    taken = {pair: rows.taken.take((_pairs_of(rows.taken) == pair).all(axis=1)) for pair in pairs}
    found: dict[Pair, FoundTransition] = {}
    known: list[PolynomialGuard] = []
    # the most frequent first: what is seen seldom may share its guard with what is seen often
    for pair, own in sorted(taken.items(), key=lambda one: -len(one[1])):
        sides = Sides(rows.inside(pair[0]), own.given, own.last, own.given, own.asked)
        stated = [*rows.agreements(pair, degree), *known]
        guard = guard_with_margin(sides, degree, stated)
        known += [] if guard is None or guard.beyond else [guard.guard]
        found[pair] = FoundTransition(*pair, own.recording, own.times, guard, _reset(own, rows))
    for i, j in pairs:
        if i < j and (j, i) in found:
            both = found[i, j], found[j, i]
            found[i, j], found[j, i] = _of_one_surface(rows, taken, both, degree)
    exits, ways = {source: rows.exits(source) for source, _ in pairs}, dict[Pair, Ways]()
    for (source, target), one in found.items():
        if one.guard is not None and one.is_one:
            ways[source, target] = ways_of(one.guard, exits[source], target, degree)
            if len(ways[source, target]) == 1:
                found[source, target] = replace(one, guard=ways[source, target][0])
    told = with_lent_guards(found, exits, taken, rows.inside, degree)
    every = []
    for pair, one in told.items():
        if one.is_one:
            is_lent = one.guard is not None and one.guard.is_lent
            # one law whose lags are made anew at several places is that of modes which lags see
            one_law = pair[0] == pair[1] and pair in rows.whole
            every += [one] if is_lent or one_law else by_ways(one, taken[pair], ways.get(pair, ()))
    return in_order(every, rows.taken)


def _certificate(one: FoundTransition, rows: ModeRows) -> Certificate:
    """How far the guard is from the rows on both sides, and how far any could be."""
    if one.guard is None:
        return UNKNOWN
    taken = rows.taken
    own = taken.take(_is_of(one, taken))
    sides = Sides(rows.inside(one.source), own.given, own.last, own.given, own.asked).crossed
    return certificate(one.guard.whole, sides.below, sides.last, sides.reached)


def _pairs_of(taken: Taken) -> NDArray[np.intp]:
    return np.column_stack([taken.source, taken.target])


def _is_of(one: FoundTransition, taken: Taken) -> NDArray[np.bool_]:
    """Where it was taken: of the same modes there may be several."""
    pair = (_pairs_of(taken) == (one.source, one.target)).all(axis=1)
    same = np.equal.outer(taken.recording, one.recording) & np.equal.outer(taken.times, one.times)
    return np.asarray(pair & same.any(axis=1))


def _reset(taken: Taken, rows: ModeRows) -> FoundReset | None:
    """The reset of a transition, if the state jumps at most of its switches."""
    if taken.jumped.mean() <= 0.5:
        return None
    n_states = rows.stays.rows.n_states
    n_seen, held = (rows.n_lagged, n_states) if rows.is_whole(taken) else (n_states, 0)
    least = _LEAST_NOISE * np.maximum(taken.after.std(axis=0), np.finfo(float).tiny)
    noise = np.tile(rows.stays.noise, n_seen // n_states)
    errors = SETTINGS.end_of_stay * np.maximum(noise, least[:n_seen])
    return best_reset(taken.given[:, :n_seen], taken.after[:, :n_seen], errors, np.arange(held))


def _whole_resets(rows: ModeRows) -> frozenset[Pair]:
    """Transitions that reset the whole lagged state: those that then leave less of what follows."""
    powers = rows.stays.feature_map.powers
    if not rows.stays.rows.lags or powers is None:
        return frozenset()
    if (powers[:, : rows.n_lagged].sum(axis=1) > 1).any():
        return frozenset()  # older rows are not told by equations that are affine in them
    pairs = {(int(i), int(j)) for i, j in _pairs_of(rows.taken)[rows.taken.jumped]}
    others, found = replace(rows, whole=frozenset(pairs)), set()
    for pair in pairs:
        newest, whole = (
            one.taken.take((_pairs_of(one.taken) == pair).all(axis=1)) for one in (rows, others)
        )
        usual = newest.jumped.mean() > 0.5
        if usual and len(whole) >= len(newest) and whole.jumped.all():
            if _cost_of_reset(whole, others) < _cost_of_reset(newest, rows):
                found.add(pair)
    return frozenset(found)


def _cost_of_reset(taken: Taken, rows: ModeRows) -> float:
    """Nats of what it leaves of the states that follow, and of its terms; as in `best_reset`."""
    reset, n_states = _reset(taken, rows), rows.stays.rows.n_states
    assert reset is not None, "the state jumps at most of its switches"
    left = reset.left
    if rows.is_whole(taken):
        _, change = rows.older(taken.rows, taken.target)
        left = np.matmul(change, left[:, n_states:, None])[:, :, 0]
    else:
        left = np.hstack([left, rows.left_before(taken)])
    least = _LEAST_NOISE * np.maximum(taken.after[:, :n_states].std(axis=0), np.finfo(float).tiny)
    noise = np.tile(np.maximum(rows.stays.noise, least), left.shape[1] // n_states)
    goes_on = np.eye(len(reset.reset.offset))
    n_terms = np.count_nonzero(reset.reset.offset) + np.count_nonzero(reset.reset.matrix - goes_on)
    missed = np.log(np.maximum(np.abs(left).mean(axis=0), noise)).mean()
    return float(len(taken) * n_states * missed + n_terms * np.log(max(2, len(taken))))


def _of_one_surface(
    rows: ModeRows,
    taken: dict[Pair, Taken],
    both: tuple[FoundTransition, FoundTransition],
    degree: int,
) -> tuple[FoundTransition, FoundTransition]:
    """Two opposite transitions, with one surface for both ways unless two guards explain more."""
    if any(one.jumps or one.guard is None for one in both):
        return both
    there, back = (
        Sides(rows.inside(one.source), rows.inside(one.target), own.last, own.given, own.asked)
        for one in both
        for own in [taken[one.source, one.target]]
    )
    pair = both[0].source, both[0].target
    most = sum(one.guard.cost for one in both if one.guard)
    surface = surface_with_margin(there, back, degree, most, rows.agreements(pair, degree))
    if surface is None:
        return both
    return replace(both[0], guard=surface[0]), replace(both[1], guard=surface[1])
