"""More modes than were found, and laws of a part of the rows led to all of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from swsysid._discrete_stays.data import DiscreteData
from swsysid._discrete_stays.found import (
    ROUGH,
    Found,
    is_rough,
    lasting_only,
    with_noise,
    without_momentary,
)
from swsysid._discrete_stays.modes import decoded_anew
from swsysid._discrete_stays.rows import (
    RowFit,
    RowProblem,
    alternate,
    as_fit,
    law_of,
    row_costs,
    scale_of,
    switching_of,
)
from swsysid._discrete_stays.states import PATIENT_STEPS, StateFit, law_information, with_states
from swsysid._results import Array

# The disturbance of states in rows that were not searched, as a share of their noise.
_TIES = 0.1, 0.03, 0.01, 0.01


def finer_modes(data: DiscreteData, found: Found, most: int) -> Found | None:
    """The same with more modes, `most` at most, for stays in modes that leave much.

    None where that is no better, or where measurements have noise. Laws that lack a little leave
    much, too, and are parted without end: free rollouts say which of both is right.
    """

    def some(found: Found) -> Iterator[NDArray[np.bool_]]:
        """Rows that no law explains, and the longest stay in each rough mode."""
        fit = found.fit
        yield fit.unexplained
        stays = _stays(data.problem, fit)
        for mode in np.flatnonzero(is_rough(fit)):
            longest = max((own for own in stays if fit.lawful[own[0]] == mode), key=len)
            yield np.isin(np.arange(len(fit.modes)), longest)

    more = found if found.states is not None else with_more(data, found, most, some)
    return None if more is found else more


def parted_stays(data: DiscreteData, found: Found, most: int) -> Found | None:
    """The same with rough modes parted into as few as explain their stays, if these are exact."""
    coef = None if found.states is not None else _of_stays(data, found.fit)
    if coef is None or len(coef) > most:
        return None
    parted = followed(data, found, coef, scale_of(data.problem, coef, found.fit.lawful))
    better = parted.cost < found.cost and not is_rough(parted.fit).any()
    return parted if better else None


def _stays(problem: RowProblem, fit: RowFit) -> list[NDArray[np.intp]]:
    """Rows of each stay."""
    begins = problem.begins | np.append(True, np.diff(fit.lawful) != 0)
    return np.split(np.arange(len(begins)), np.flatnonzero(begins)[1:])


def _of_stays(data: DiscreteData, fit: RowFit) -> Array | None:
    """Laws, those of rough modes replaced by as few as their stays have; None without rough ones.

    One law explains two stays if the one of all their rows leaves no more than the others do. The
    law of a stay alone need not explain the other one: a short motion does not determine it.
    """
    problem, rough = data.problem, is_rough(fit)
    least, n_features = ROUGH * fit.scale[~rough].max(axis=0), problem.features.shape[1]

    def explains(rows: NDArray[np.intp]) -> bool:
        left = problem.targets[rows] - problem.features[rows] @ law_of(problem, rows).T
        return bool((np.sqrt(np.square(left).mean(axis=0)) <= least).all())

    stays = [own for own in _stays(problem, fit) if rough[fit.lawful[own[0]]]]
    pieces = [piece for own in stays if fit.lawful[own[0]] >= 0 for piece in _exact(own, explains)]
    groups = [np.flatnonzero(fit.lawful == mode) for mode in np.flatnonzero(~rough)]
    for piece in sorted(pieces, key=len, reverse=True):
        if len(piece) <= n_features:  # any law explains it
            continue
        joined = (k for k, own in enumerate(groups) if explains(np.append(own, piece)))
        place = next(joined, None)
        if place is None:
            groups.append(piece)
        else:
            groups[place] = np.append(groups[place], piece)
    return np.array([law_of(problem, rows) for rows in groups]) if rough.any() else None


def _exact(
    rows: NDArray[np.intp], explains: Callable[[NDArray[np.intp]], bool]
) -> Iterator[NDArray[np.intp]]:
    """A stay in parts that one law each explains, each as long as can be."""
    while len(rows):
        fits, fails = 1, len(rows) + 1
        while fails - fits > 1:
            middle = len(rows) if fails > len(rows) else (fits + fails) // 2
            fits, fails = (middle, fails) if explains(rows[:middle]) else (fits, middle)
        yield rows[:fits]
        rows = rows[fits:]


def with_more(
    data: DiscreteData,
    found: Found,
    most: int,
    some: Callable[[Found], Iterable[NDArray[np.bool_]]],
) -> Found:
    """With the laws of some rows as long as one of them is better, up to so many."""
    problem = data.problem
    while len(found.coef) < most:
        scale = scale_of(problem, found.coef, found.fit.lawful)
        scale = np.vstack([scale, scale.min(axis=0)])
        tried = [
            followed(data, found, np.vstack([found.coef, law_of(problem, rows)[None]]), scale)
            for rows in some(found)
            if np.count_nonzero(rows) > problem.features.shape[1]
        ]
        better = [one for one in tried if len(found.coef) < len(one.coef) <= most]
        better = [one for one in better if one.cost < found.cost]
        if not better:
            break
        found = min(better, key=lambda one: one.cost)
    return found


def followed(data: DiscreteData, found: Found, coef: Array, scale: Array) -> Found:
    """Laws led on all rows: with noise their modes are decoded, then refined as those of the part.

    The disturbance shrinks again to what it was in the part: what is new may be wrong as well.
    """
    problem = data.problem
    if found.states is None:
        fit = without_momentary(data, alternate(problem, coef))
        return Found(fit, None, found.history + fit.history)
    fit = decoded_anew(data, replace(found.states, coef=coef), scale, found.fit)
    ties = [np.maximum(found.states.tie, least) for least in _TIES]
    return lasting_only(data, with_noise(data, Found(fit, None, found.history), ties))


def without_rarest(data: DiscreteData, found: Found) -> Found:
    """The same without the law of the fewest rows, where others explain these as well.

    That which few rows of a part told may be a worse one of a mode that all rows show. The law in
    its place was told beside it, so that modes are told anew until they stay.
    """
    if found.states is None:  # a few rows without noise tell a law exactly
        return found
    rows = np.bincount(found.fit.lawful[found.fit.lawful >= 0], minlength=len(found.coef))
    kept = np.arange(len(found.coef)) != rows.argmin()
    scale = scale_of(data.problem, found.coef, found.fit.lawful)
    fewer = followed(data, found, found.coef[kept], scale[kept])
    if fewer.states is None or not fewer.cost < found.cost:
        return found
    return lasting_only(data, with_noise(data, fewer, [fewer.states.tie] * len(_TIES)))


def without_twins(data: DiscreteData, found: Found) -> Found:
    r"""The same with one law in the place of two where that is better.

    Of laws with information :math:`M_i, M_j` one law for both leaves
    :math:`\tfrac12 d^\top M_i (M_i + M_j)^+ M_j d` nats more to first order, d what they differ
    by. The pair that leaves least is joined, and stays so if its states are then likelier.
    """
    while found.states is not None and len(found.coef) > 1:
        joined = _joined(data, found, found.states)
        if not joined.cost < found.cost:
            break
        found = joined
    return found


def _joined(data: DiscreteData, found: Found, states: StateFit) -> Found:
    """With the two laws as one that differ least."""
    n_modes, information = len(found.coef), law_information(data, found.fit, states)
    laws = found.coef.reshape(n_modes, -1)

    def left(i: int, j: int) -> float:
        apart = laws[i] - laws[j]
        both = np.linalg.pinv(information[i] + information[j], hermitian=True)
        return float(apart @ information[i] @ both @ information[j] @ apart)

    pairs = [(i, j) for j in range(n_modes) for i in range(j)]
    i, j = min(pairs, key=lambda pair: left(*pair))
    if information[j].trace() > information[i].trace():  # the law that is known better is kept
        i, j = j, i
    names = np.arange(n_modes)
    names[j] = i
    names = np.unique(names, return_inverse=True)[1]
    kept, fit = np.arange(n_modes) != j, found.fit
    modes = np.where(fit.modes == j, names[i], names[fit.modes])
    switching = switching_of(np.where(fit.unexplained, -1, modes), data.problem)
    both = np.linalg.pinv(information[i] + information[j], hermitian=True)
    pulls = information[i] @ laws[i] + information[j] @ laws[j]
    scale, coef = fit.scale[kept], found.coef.copy()
    coef[i] = (both @ pulls).reshape(coef[i].shape)
    coef = coef[kept]
    costs = row_costs(data.problem, coef, scale)
    own = as_fit(data.problem, coef, scale, switching, modes, costs)
    own = replace(own, unexplained=fit.unexplained, history=fit.history)
    near = replace(states, coef=coef)
    told = with_states(data, own, states.tie, near, most_steps=PATIENT_STEPS)
    return Found(own, told, found.history)
