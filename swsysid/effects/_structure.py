"""Effects on the structure of the model: one more mode."""

from __future__ import annotations

from typing import Any

from swsysid._pipelines import switching_step, with_parameters
from swsysid.effects._types import StructureEffect

__all__ = ["ExtraMode"]


class ExtraMode(StructureEffect):
    """One more mode than declared, with the same library."""

    kind = "extra_mode"
    meaning = "there is one more region with a law of its own"
    n_more_modes = 1

    def extended(self, estimator: Any) -> Any:
        declared = switching_step(estimator)[1].n_modes
        return with_parameters(estimator, n_modes=declared + 1)
