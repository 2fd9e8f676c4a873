"""Rounds in turn: where they begin, how far they go, and once more without what is refuted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import reduce

from swsysid._journal import step
from swsysid._output_error.criterion import Fall, fall
from swsysid._output_error.engines import Finding, Model, n_happened
from swsysid._output_error.law import Law
from swsysid._output_error.search import Search
from swsysid._rendering.progress import progress
from swsysid.effects import PlacedEffect


@dataclass(frozen=True)
class Searched:
    """What a search has found: the declared model, and one effect more in each that follows.

    `unsure` is what would have been next, if chance may explain it.
    """

    search: Search
    models: tuple[Model, ...]
    findings: tuple[Finding, ...]
    unsure: Finding | None = None

    def is_clearer(self, other: Searched) -> bool:
        """Whether the first effect explains surely more of what is left, or no less by a name."""
        mine, theirs = self.first_fall, other.first_fall
        if self.has_a_name > other.has_a_name:
            return theirs.share <= mine.share + mine.error
        return mine.share > theirs.share + theirs.error

    @property
    def has_a_name(self) -> bool:
        """Whether an effect was found last that is no function of any shape."""
        return bool(self.findings) and not self.models[-1].is_nameless

    @property
    def first_fall(self) -> Fall:
        """By how much the first effect lowers what the declared model leaves, if there is one."""
        return fall(self.models[0].unseen, self.models[min(1, len(self.findings))].unseen)

    def with_one_more(self, model: Model, finding: Finding) -> Searched:
        """The same with one effect more, if it is likely."""
        if not self.search.is_likely(finding):  # evidence against it does not grow to be for it
            return replace(self, unsure=finding if finding.longer > 0.0 else None)
        return Searched(self.search, (*self.models, model), (*self.findings, finding))

    @property
    def standard(self) -> Model:
        """What the worth of an effect is measured by: the declared law, and what happened first.

        A lid that was opened leaves more than all that there is at other times.
        """
        return self.models[n_happened(self.findings)]

    @property
    def is_refuted(self) -> bool:
        """Whether what was held out surely becomes worse by the last effect.

        What acts once it does not judge.
        """
        is_judged = bool(self.findings) and self.search.held_out_rows.size > 0
        if not is_judged or self.findings[-1].candidate.effect.acts_once:
            return False
        return fall(*map(self.search.held_out_left, self.models[-2:])).is_worse

    def went_on(self, after_each: Callable[[], None] = lambda: None) -> Searched:
        """The same with every further effect that is worth it, up to one that is refuted.

        All that would be found beside that one would rest on it. No answer of 18 measured sets is
        another one by that; of an arm that sticks the first round is left of 200 s.
        """
        done = self
        while len(done.findings) < self.search.most and not done.is_refuted:
            better = self.search.round(done.models[-1], done.standard)
            after_each()
            before, done = done, done if better is None else done.with_one_more(*better)
            if len(done.findings) == len(before.findings):
                break
        return done

    def again(self, n_sound: int, refuted: PlacedEffect) -> Searched:
        """What a search finds without an effect that was refuted, beside those before it."""
        own = self.search
        other = replace(own, refuted=(refuted,), significance=own.significance / 2.0)
        if n_sound:
            sound = Searched(other, self.models[: n_sound + 1], self.findings[:n_sound])
            return sound.went_on()
        declared, known = self.models[0].law, own.stretches.disturbance
        for one in own.engine.disturbances:
            begun = started(other.disturbed(one), declared) if one > known else None
            if begun is not None and begun.findings:
                return begun.went_on()
        return searched(other, declared)


def searched(search: Search, declared: Law) -> Searched:
    """The declared model and those with one effect more each; the effects."""
    with progress(search.most, "rounds of the search", search.verbose) as bar:
        *compared, largest = search.engine.disturbances
        starts = [started(search.disturbed(one), declared) for one in compared]
        if not any(one.findings for one in starts):
            starts.append(started(search.disturbed(largest), declared))
        done = reduce(lambda best, one: one if one.is_clearer(best) else best, starts)
        bar.update()
        return done.went_on(bar.update) if done.findings else done


@step
def started(search: Search, declared: Law) -> Searched:
    """The declared model, and the first effect if there is one."""
    first = search.declared(declared)
    done = Searched(search, (first,), ())
    better = search.round(first, first) if search.most else None
    return done if better is None else done.with_one_more(*better)
