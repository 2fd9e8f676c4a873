"""Of two searches beside different disturbances the one goes on whose first effect says more.

It goes no further than what was held out bears out.
"""

from types import SimpleNamespace

import numpy as np

from swsysid._output_error.criterion import Left
from swsysid._output_error.engines import Model
from swsysid._output_error.law import Law
from swsysid._output_error.rounds import Searched
from swsysid.effects import LoadFriction, PlacedEffect, TimeInterval, UnknownFunction

SERIES = (np.arange(400),)


def searched(effect, share, search=None):
    """A search that has found an effect that takes away a share of the squares of 400 samples.

    The share of every twentieth of them is .1 more or less: its error is .1 / sqrt(19) = .023.
    """
    scatter = np.repeat(np.where(np.arange(20) % 2, 0.1, -0.1), 20)
    left = np.sqrt(1.0 - share - scatter)[:, None]
    placed, one = PlacedEffect(effect, 0, 0), np.ones((1, 1))
    law = Law.of(lambda X: X, one > 0.0, 0.0 * one).beside([placed])
    declared = Model(SimpleNamespace(law=law), Left(np.ones((400, 1)), SERIES))
    found = Model(SimpleNamespace(law=law), Left(left, SERIES))
    return Searched(search, (declared, found), (SimpleNamespace(candidate=placed),))


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


def rounds_beside(effect, share, n_held_out=400):
    """How many rounds follow an effect that takes away a share of what was held out."""
    asked = []
    search = SimpleNamespace(
        most=3,
        held_out_rows=np.arange(n_held_out),
        held_out_left=lambda model: model.unseen,
        round=lambda now, first: asked.append(now),
    )
    searched(effect, share, search).went_on()
    return len(asked)


def test_nothing_is_sought_beside_what_the_held_out_rows_refute():
    # .05 worse is two errors, .01 less than one
    assert rounds_beside(LoadFriction(), -0.05) == 0
    assert rounds_beside(LoadFriction(), -0.01) == 1
    assert rounds_beside(LoadFriction(), 0.5) == 1
    # what acts once predicts nothing elsewhere, and without rows held out nothing is judged
    assert rounds_beside(TimeInterval(), -0.05) == 1
    assert rounds_beside(LoadFriction(), -0.05, n_held_out=0) == 1
