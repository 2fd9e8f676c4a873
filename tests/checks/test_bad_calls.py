"""Every wrong call ends in one sentence of the package's own, and no call in a wrong result.

Each call of `public_calls` is made with each of its arguments wrong in turn, in every way that
`bad_values` knows for what the argument is. A seeded part of these calls is made by default, all
of them where SWSYSID_ALL_BAD_CALLS is set.
"""

import os
from collections.abc import Iterator

import numpy as np
import pytest
from bad_values import BAD
from outcomes import fault, unusable, usual_warnings
from public_calls import CALLS


def cases() -> Iterator[tuple[str, str, int]]:
    """Call, argument and number of the wrong value, of every wrong call."""
    for name, call in CALLS.items():
        for argument, kind in call.kinds.items():
            for number in range(len(BAD[kind.rstrip("?")])):
                yield name, argument, number


ALL = list(cases())
SOME = np.random.default_rng(0).permutation(len(ALL))[:250].tolist()
CHOSEN = ALL if os.environ.get("SWSYSID_ALL_BAD_CALLS") else [ALL[place] for place in SOME]


@pytest.mark.parametrize("name", CALLS)
def test_the_right_calls_work(name):
    call = CALLS[name]
    with usual_warnings():
        result = call.run(**call.right())
    assert next(unusable(result), None) is None


def _label(case) -> str:
    name, argument, number = case
    kind = CALLS[name].kinds[argument]
    return f"{name}: {argument} = {BAD[kind.rstrip('?')][number].name}"


@pytest.mark.parametrize("case", CHOSEN, ids=_label)
def test_a_wrong_call_ends_in_a_sentence(case):
    assert fault(*case) is None
