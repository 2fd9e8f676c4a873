"""A force that nobody measured: correlated in time, and a function of nothing that was recorded."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from swsysid._data.records import Records
from swsysid.effects._base import Parameter, Place, figure
from swsysid.effects._types import WithoutColumns


class UnmeasuredDisturbance(WithoutColumns):
    """A random force of some size that is forgotten after some time (Ornstein and Uhlenbeck).

    It predicts nothing in a record that is not there yet, and lowers no error. A search says it
    where what is left over is correlated in time, and where an effect with a name does not predict
    stretches it has not seen any better than such a force would.
    """

    kind = "unmeasured_disturbance"
    meaning = (
        "a force that nobody measured acts on {target}; it follows no channel, and only a sensor "
        "of what drives {target} from outside can settle it"
    )
    needs = frozenset({"order"})
    lowers_nothing = "it follows nothing that was measured"

    def places(self, records: Records) -> Sequence[Place]:
        return ["time"]

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        return (Parameter("size", np.empty(0)), Parameter("time_constant", np.empty(0), "{time}"))

    def statement(self, place: Place, names: Sequence[str], target: int, *theta: float) -> str:
        size, time_constant = map(figure, theta)
        return (
            f"a force of size {size} that nobody measured acts on {names[target]} and is forgotten "
            f"after {time_constant}; the laws do not have it"
        )
