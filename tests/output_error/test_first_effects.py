"""Of two searches beside different disturbances the one goes on whose first effect says more."""

from types import SimpleNamespace

import numpy as np

from swsysid._output_error.criterion import Left
from swsysid._output_error.engines import Model
from swsysid._output_error.search import Searched
from swsysid.effects import LoadFriction, UnknownFunction

SERIES = (np.arange(400),)


def searched(effect, share):
    """A search that has found an effect that takes away a share of the squares of 400 samples.

    The share of every twentieth of them is .1 more or less: its error is .1 / sqrt(19) = .023.
    """
    scatter = np.repeat(np.where(np.arange(20) % 2, 0.1, -0.1), 20)
    left = np.sqrt(1.0 - share - scatter)[:, None]
    law = SimpleNamespace(terms=(SimpleNamespace(effect=effect),))
    declared = Model(SimpleNamespace(law=law), Left(np.ones((400, 1)), SERIES))
    found = Model(SimpleNamespace(law=law), Left(left, SERIES))
    return Searched(None, (declared, found), (SimpleNamespace(),))


def test_a_name_is_clearer_than_a_function_without_one_that_explains_no_more():
    shape, name = UnknownFunction((0,), ((0.0,), (1.0,))), LoadFriction()
    assert searched(name, 0.50).is_clearer(searched(shape, 0.51))
    assert not searched(shape, 0.51).is_clearer(searched(name, 0.50))
    # what explains surely more is clearer, name or not: .1 is four errors
    assert searched(shape, 0.60).is_clearer(searched(name, 0.50))
    assert not searched(name, 0.50).is_clearer(searched(shape, 0.60))
    # two names, or two without: only what is surely more
    assert not searched(name, 0.51).is_clearer(searched(name, 0.50))
    assert searched(name, 0.60).is_clearer(searched(name, 0.50))
    assert not searched(shape, 0.51).is_clearer(searched(shape, 0.50))
