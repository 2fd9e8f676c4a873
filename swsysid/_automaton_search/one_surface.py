"""A plant with one surface between two modes: found as `TrajectoryIdentifier` finds it.

Where the two guards of an automaton are one surface that is crossed both ways, the surface explains
the switches, and together with the laws its coefficients are those of highest likelihood.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from sklearn.base import clone

from swsysid._automaton.columns import CLOCKS
from swsysid._automaton.transitions import PolynomialGuard
from swsysid._automaton_search.guards import StatedGuard
from swsysid._automaton_search.instants import Settled
from swsysid._automaton_search.settings import SETTINGS
from swsysid._classifier import PolynomialSurfaceClassifier
from swsysid._data.features import Monomials
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._stays.certainty import certainty
from swsysid._stays.given import Given
from swsysid._stays.identification import StayIdentification
from swsysid._stays.samples import misfits
from swsysid._stays.search import Search
from swsysid._stays.settings import LIMITS, StaySettings


def may_be_one_surface(found: list[Settled], interval: float) -> bool:
    """True if one surface, crossed both ways, tells the switches of the only transitions."""
    shared = [one.shared for one in found if one.shared is not None]
    return len(found) == len(shared) == 2 and all(one.tells(interval) for one in shared)


def with_surface(
    estimator: SwitchingSystemRegressor,
    given: Given,
    degree: int,
    settings: StaySettings,
    told: Callable[[], object],
) -> StayIdentification:
    """Laws and stays of two modes and the polynomial surface between them."""
    usual = SwitchingSystemRegressor()
    whole = clone(estimator).set_params(
        n_modes=2, coupling=usual.coupling, surface=PolynomialSurfaceClassifier(degree=degree)
    )
    return Search(whole, given, 1, None, settings, told).identified()


def explains(surfaced: StayIdentification, stays: StayIdentification) -> bool:
    """True if the states fit as well with switches on a surface as with switches anywhere.

    A surface holds n instants to k coefficients. If it is there, half the squares that are missing
    rise by (n - k) / 2 in the mean, with the variance (n - k) / 2.
    """
    estimate = surfaced.estimate
    if estimate.guards is None or len(estimate.laws.coef) != 2 or estimate.slides:
        return False
    least = LIMITS.nearly_exactly * estimate.laws.spread
    noise = np.maximum(stays.reached.noise, least)
    held = max(1, len(stays.estimate.nodes.instants) - estimate.guards.n_free)
    both = (np.square(misfits(one.estimate) / noise) for one in (surfaced, stays))
    held_to, free = (0.5 * float(np.nansum(squares)) for squares in both)
    return held_to - free < 0.5 * held + SETTINGS.sure * np.sqrt(0.5 * held)


def guards_of(surfaced: StayIdentification) -> dict[tuple[int, int], StatedGuard]:
    """The surface as a guard for each direction."""
    surface, errors = surfaced.model.surface_, certainty(surfaced).surface
    assert isinstance(surface, PolynomialSurfaceClassifier), "asked for by with_surface"
    assert errors is not None, "of a surface with coefficients"
    [coef], signs = surface.coef_, surface.mode_book_[:, 0]
    powers = Monomials.up_to(surface.degree, surface.n_features_in_).powers
    wide = np.pad(powers, ((0, 0), (0, len(CLOCKS))))
    return {
        (mode, 1 - mode): StatedGuard(PolynomialGuard(-signs[mode] * coef, wide), errors[0])
        for mode in (0, 1)
    }
