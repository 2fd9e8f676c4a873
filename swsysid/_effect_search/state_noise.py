r"""What the noise of measured states makes of the errors of velocities.

The velocity of a row is a slope of noisy states, and what a law predicts for it is a mean over the
same window of functions of noisy states. Even the true law f leaves over

.. math:: \sigma^2_{\dot x} + \sum_j \big(\partial f / \partial x_j\big)^2 \sigma^2_j ,

with the variances of a slope and of a mean of :math:`x_j`. A law with smaller coefficients hands
less of it on; with an input's memory, which knows no such noise, in the place of what the states
tell, least squares leave less over than the truth. So errors are compared in units of what the
noise makes of them, as in a regression with errors in all its variables.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._data.records import Records
from swsysid._data.windows import Windows
from swsysid._effect_model.joint_fit import JointFit
from swsysid._effect_search.settings import SETTINGS
from swsysid._noise import robust_scale
from swsysid._results import Array
from swsysid.effects import PlacedEffect


@dataclass(frozen=True)
class StateNoise:
    """Standard deviations of the white noise of measured states, and of the slopes made of it."""

    states: Array  # (n_states,)
    slopes: Array  # (n_states,)

    @classmethod
    def of(cls, rest: Array, windows: Windows) -> StateNoise | None:
        """The noise of states by what local polynomials leave of them, where windows are whole."""
        rows = windows.whole()
        if not len(rows):
            return None
        left, own = (rest - windows.values @ rest)[rows], windows.values.diagonal()[rows]
        # The weights of a projection: their squares sum to the one of the sample itself.
        states = robust_scale(left / np.sqrt(1.0 - own)[:, None])
        gain = np.sqrt(np.mean(windows.slopes[rows].power(2).sum(axis=1)))
        return cls(states, gain * states)

    def errors(self, fit: JointFit, records: Records, rows: NDArray[np.intp]) -> Array:
        """Standard deviations of the errors that the noise makes in a fit, (n_states,).

        What it does to the predictions is seen by adding as much of it again.
        """
        modes, noisy = fit.predict_modes(records), records.X.copy()
        chance = np.random.RandomState(0).normal(size=(len(noisy), len(self.states)))
        noisy[:, : len(self.states)] += self.states * chance
        with_noise, without = (
            fit.predict(one, modes, rows) for one in (records.with_columns(noisy), records)
        )
        return np.sqrt(self.slopes**2 + robust_scale(with_noise - without) ** 2)

    def hides(
        self, terms: Sequence[PlacedEffect], records: Records, rows: NDArray[np.intp]
    ) -> NDArray[np.bool_]:
        """Rows next to the level of a state where an effect jumps, nearer than the noise tells.

        A plant that sticks stays there, with any force that holds it.
        """
        near = np.zeros(len(rows), dtype=bool)
        for term in terms:
            for channel, level in term.effect.breaks(term.place, *term.theta):
                reach = SETTINGS.shown * self.states[channel]
                near |= np.abs(records.X[rows, channel] - level) <= reach
        return near
