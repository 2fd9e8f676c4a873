"""Good recordings with one oddity: answered in finite numbers, or refused in a sentence.

400 by default, 10,000 by ``make nightly``; a number is a seed of `oddities.drawn`.
"""

import pytest
from oddities import ODDITIES, drawn
from outcomes import ending

FOUND = (858, 2679)  # at night: recordings at rest


@pytest.mark.parametrize("seed", [*range(400), *FOUND])
def test_a_generated_call_ends_well(seed):
    call = drawn(seed)
    assert ending(call.run) is None, call.name


@pytest.mark.nightly
@pytest.mark.parametrize("hundred", range(4, 100))
def test_so_do_thousands(hundred):
    calls = {seed: drawn(seed) for seed in range(100 * hundred, 100 * hundred + 100)}
    faults = {f"{seed}, {call.name}": ending(call.run) for seed, call in calls.items()}
    assert not {name: one for name, one in faults.items() if one is not None}


def test_most_oddities_and_all_questions_are_among_the_first():
    names = [drawn(seed).name.split(", ") for seed in range(400)]
    asked, odd = map(set, zip(*names, strict=True))
    assert len(asked) == 13 and odd == set(ODDITIES)
