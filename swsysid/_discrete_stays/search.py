"""From lagged rows to modes and laws: starts, numbers of modes, and noise in stages."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from swsysid._discrete_stays.averages import Averages, parted_by_averages
from swsysid._discrete_stays.data import DiscreteData
from swsysid._discrete_stays.found import Found, lasting_only, with_both_noises, with_noise
from swsysid._discrete_stays.more_modes import (
    followed,
    parted_stays,
    with_more,
    without_rarest,
    without_twins,
)
from swsysid._discrete_stays.row_search import RowSearch
from swsysid._discrete_stays.rows import RowFit, of_modes, scale_of
from swsysid._discrete_stays.states import RANKING_STEPS, with_states

# Residuals below so many times what is left undecided come from arithmetic, and laws of highest
# likelihood in all states would only add to it.
_EXACT = 10.0
# The disturbance of the states as a share of the noise, smaller and smaller, since wrong modes
# disturb them too, in two stages; and for modes of averages before the second.
_STAGES = (1.0, 1.0, 1.0, 0.3, 0.1), (0.03, 0.01, 0.01, 0.01, 0.01, 0.01)
_OF_AVERAGES = 0.3, 0.1
# Nats a row by which a number of modes is so much worse than the best one that it is not judged any
# more, before each stage.
_HOPELESS = 0.5, 0.1
_SIZES = 3, 6, 12, 24, 48  # of averages


@dataclass(frozen=True)
class DiscreteCandidate:
    """One number of modes, and what the recordings say of it: the least criterion is chosen."""

    n_modes: int
    criterion: float  # nats: negative log likelihood, switches and coefficients paid for


@dataclass(frozen=True)
class Searched:
    """Rows, what was found in them, and the numbers of modes that were compared."""

    data: DiscreteData
    found: Found
    candidates: tuple[DiscreteCandidate, ...]


class StaySearch:
    """Compares numbers of modes on a part of the rows, then goes on with all of them."""

    def __init__(self, data: DiscreteData, max_modes: int):
        self.data, self.max_modes = data, max_modes
        self.of_part = data.rows_of_part()
        self.part = data if len(self.of_part) == len(data.rows) else data.take(self.of_part)

    def best(self, n_modes: int | None) -> Searched:
        """The best identification, with so many modes or as many as the data ask for."""
        by_rows = RowSearch(self.part, self.max_modes).fits(n_modes)
        every = [Found(fit, None, fit.history) for fit in by_rows]
        found = _so_many(every, n_modes)
        if not any(self._is_exact(one.fit) for one in found):
            found = _so_many([*every, *self._by_averages(n_modes)], n_modes)
            found = self._hopeful(found, _HOPELESS[0])
            of_rows = [one for one in found if one.states is None]
            found = [one for one in found if one.states is not None]
            found = _best_of_each([*found, *self._by_states(of_rows, _STAGES[0])])
            found = self._by_states(self._hopeful(found, _HOPELESS[1]), _STAGES[1])
            found = [with_both_noises(self.part, one) for one in found]
        found = _best_of_each(found)
        chosen = without_twins(self.part, min(found, key=lambda one: one.cost))
        candidates = [DiscreteCandidate(len(one.coef), one.cost) for one in found]
        most = self.max_modes if n_modes is None else n_modes
        return Searched(self.data, self._on_all_rows(chosen, most), tuple(candidates))

    def _is_exact(self, fit: RowFit) -> bool:
        return bool((fit.scale < _EXACT * self.part.problem.floor).all())

    def _by_averages(self, n_modes: int | None) -> list[Found]:
        """The best modes of averages of more and more samples, by the states of the samples."""
        hopeful = self._hopeful(_best_of_each(self._of_averages(n_modes)), _HOPELESS[0])
        # the modes of samples beside a switch are not known yet: no smaller disturbance before
        return self._by_states([replace(one, states=None) for one in hopeful], _OF_AVERAGES)

    def _of_averages(self, n_modes: int | None) -> Iterator[Found]:
        """Modes of averages, with laws and states of samples, until stays are too short."""
        best, hopeless = np.inf, _HOPELESS[0] * len(self.part.rows)
        for size in _SIZES:
            averages = Averages.of(self.data, size)
            if averages is None:
                break
            least = np.inf
            fits = averages.fits(n_modes, self.max_modes)
            most = min(fit.cost for fit in fits) + _HOPELESS[0] * len(averages.data.rows)
            for fit in fits:
                if len(fit.coef) == 1 or fit.cost > most:
                    continue
                modes = averages.of_samples(fit.lawful)[self.of_part]
                own = of_modes(self.part.problem, modes, len(fit.coef))
                told = with_states(self.part, own, _OF_AVERAGES[0], most_steps=RANKING_STEPS)
                found = Found(own, told, ())
                least = min(least, found.cost)
                yield found
            if least > best + hopeless:
                break
            best = min(best, least)

    def _by_states(self, found: list[Found], ties: Sequence[float]) -> list[Found]:
        """Candidates refined with ever less disturbance, the best of each number of modes."""
        again = [with_noise(self.part, one, ties) for one in found]
        return _best_of_each(lasting_only(self.part, one) for one in again)

    def _hopeful(self, found: list[Found], nats: float) -> list[Found]:
        """Candidates not worse than one of fewer modes, nor by so many nats a row than any."""
        most = min((one.cost for one in found), default=np.inf) + nats * len(self.part.rows)
        return [
            one
            for one in found
            if one.cost <= most
            and all(one.cost <= other.cost for other in found if len(other.coef) < len(one.coef))
        ]

    def _on_all_rows(self, found: Found, most: int) -> Found:
        """The same with all rows; modes that the part has not visited come in, up to so many."""
        if self.part is not self.data:
            scale = scale_of(self.part.problem, found.coef, found.fit.lawful)
            found = followed(self.data, found, found.coef, scale)
            more = with_more(self.data, found, most, lambda found: [found.fit.unexplained])
            found = more if more is found else without_rarest(self.data, more)
            found = without_twins(self.data, parted_stays(self.data, found, most) or found)
        return self._parted(found, most)

    def _parted(self, found: Found, most: int) -> Found:
        """The same with modes parted by averages, as long as noise drives the states.

        Part of the rows shows laws for a short while each, in which noise in the equation is as
        likely as a rate that is another one; all of them show which of both goes on.
        """
        while len(found.coef) < most and self._is_driven(found):
            parted = min(self._in_parts(found), key=lambda one: one.cost, default=found)
            if not parted.cost < found.cost:
                break
            parted = lasting_only(self.data, with_noise(self.data, parted, _STAGES[1]))
            parted = without_twins(self.data, parted)
            if not (parted.cost < found.cost and len(parted.coef) > len(found.coef)):
                break
            found = parted
        return found

    def _is_driven(self, found: Found) -> bool:
        """Whether noise in the equation is likelier than the sensor's alone by more than a law."""
        least = _STAGES[1][-1]
        if found.states is None or not (found.states.tie > least).any():
            return False
        alone = with_states(self.data, found.fit, least, found.states)
        of_a_law = 0.5 * found.coef[0].size * np.log(len(self.data.rows))
        return bool(alone.cost > found.cost + of_a_law)

    def _in_parts(self, found: Found) -> Iterator[Found]:
        """With a mode in two parts, its laws and states of little disturbance.

        By averages of as many rows as states remember noise of the sensor, and of more.
        """
        assert found.states is not None, "noise drives them"
        memory = float(found.states.tie.max()) ** (-1.0 / (self.data.rows.lags + 1))
        sizes = [size for size in _SIZES if size >= memory][:2] or _SIZES[-1:]
        for modes in parted_by_averages(self.data, found.fit.lawful, sizes):
            fit = of_modes(self.data.problem, modes, len(found.coef) + 1)
            states = None
            for tie in _STAGES[1][:2]:
                states = with_states(self.data, fit, tie, states)
            yield Found(fit, states, found.history)


def _so_many(found: list[Found], n_modes: int | None) -> list[Found]:
    """Those with so many modes, or with the most below; all where none are asked for."""
    if n_modes is None:
        return found
    most = max(len(one.coef) for one in found if len(one.coef) <= n_modes)
    return [one for one in found if len(one.coef) == most]


def _best_of_each(found: Iterable[Found]) -> list[Found]:
    """The best with each number of modes."""
    best: dict[int, Found] = {}
    for one in found:
        count = len(one.coef)
        if count not in best or one.cost < best[count].cost:
            best[count] = one
    return list(best.values())
