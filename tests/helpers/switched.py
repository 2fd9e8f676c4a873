"""Small switched systems for the tests of rollouts."""

import numpy as np
import pytest

from swsysid._simulation.system import SwitchingSystem


class Switched(SwitchingSystem):
    """Modes by the signs of guards: mode = sum of 2^k over the guards that are positive."""

    def __init__(self, fields, guards):
        self.fields, self.guards = fields, guards

    def velocity(self, x, u, mode):
        return np.array(self.fields(x, u, mode), dtype=float)

    def mode(self, x, u):
        return sum(2**k for k, guard in enumerate(self.guards) if guard(x, u) > 0)


class SwitchedWithValues(Switched):
    has_surface_values = True

    def surface_values(self, x, u):
        return np.array([guard(x, u) for guard in self.guards])

    def decode(self, values):
        return sum(2**k for k, value in enumerate(values) if value > 0)


both_kinds = pytest.mark.parametrize("kind", [Switched, SwitchedWithValues])
