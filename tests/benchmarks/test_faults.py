"""What fails below is the same answer, a warning or a sentence; never a worse answer."""

from collections import Counter

import pytest

from benchmarks.faults import FILES, OF_FILES, all_faults


@pytest.fixture(scope="module")
def found():
    return all_faults(["known", *FILES])


def test_nothing_is_worse_without_a_word_and_nothing_breaks(found):
    seen = Counter()
    for of_place in found.values():
        for counts in of_place.values():
            seen += counts
    assert seen.total() > 50 and not {"worse", "broken"} & set(seen), found


def test_a_disk_that_refuses_costs_a_checkpoint_and_never_the_fit(found):
    for fault in OF_FILES:
        assert set(found["_journal: write_bytes"][fault]) == {"same"}
        assert set(found["_whole_or_nothing: replace"][fault]) == {"refused"}
