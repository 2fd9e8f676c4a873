"""Responses that saturate softly: ratios of polynomials of one channel."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from swsysid._data.records import Records
from swsysid._results import Array
from swsysid.effects._base import Parameter, Place, spread
from swsysid.effects._characteristics import OfAChannel
from swsysid.effects._settings import SETTINGS


class _Saturating(OfAChannel):
    terms = ("gain",)

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        """Where half of the response is reached: from a corner to nearly a power."""
        shares = np.geomspace(SETTINGS.sharpest, SETTINGS.softest, SETTINGS.n_levels)
        width = spread(records.channel(place)) or 1.0
        return (Parameter("scale", shares * width, "{channel}"),)


class SoftSaturation(_Saturating):
    """``gain * x / (1 + |x| / scale)``: soft saturation, Michaelis-Menten and Monod kinetics."""

    kind = "soft_saturation"
    meaning = "the response to {channel} saturates softly (magnetisation, Michaelis-Menten, Monod)"
    role = "either"
    formulas = ("({0} / (1 + |{0}| / {1}))",)

    def functions(self, x: Array, *theta: float) -> Sequence[Array]:
        return [x / (1.0 + np.abs(x) / theta[0])]


class Hill(_Saturating):
    """``gain * x**2 / (scale**2 + x**2)``: a response that sets in slowly and saturates."""

    kind = "hill"
    meaning = "the response to {channel} sets in slowly and saturates (Hill, Holling type III)"
    formulas = ("({0}^2 / ({1}^2 + {0}^2))",)

    def functions(self, x: Array, *theta: float) -> Sequence[Array]:
        return [x**2 / (theta[0] ** 2 + x**2)]
