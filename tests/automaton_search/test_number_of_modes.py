"""How many modes: draws on which an answer with too few was preferred, or ended the search.

With too few modes no descent joins the nodes of recordings: their states follow the samples, not
the laws, and leave less than noise. Only the gaps say that the answer is none.
"""

import pytest

from benchmarks.automata.plants import PLANTS
from benchmarks.automata.recordings import Scenario, record
from swsysid import HybridAutomatonRegressor
from swsysid.metrics import mode_accuracy

SEED = 4401  # of `benchmarks/speed/recorded.py --automata`


@pytest.mark.parametrize(
    ("name", "n_modes"),
    [
        ("three-state automaton", 3),  # had 2, with 112 switches for 26
        pytest.param("hopping robot", 4, marks=pytest.mark.nightly),  # had 3
        # had 4 with a third of them wrong: of two heaters a third mode explains little
        pytest.param("two rooms", 4, marks=pytest.mark.nightly),
    ],
)
def test_an_answer_that_joins_nothing_is_no_answer(name, n_modes):
    plant, scenario = PLANTS[name], Scenario(0.01, 8, 400)
    seen, unseen = record(plant, scenario, SEED), record(plant, scenario, SEED + 1)
    model = HybridAutomatonRegressor(
        feature_library=plant.degree, guard_degree=plant.guard_degree, random_state=SEED
    )
    found = model.fit(seen.x, seen.t, groups=seen.groups, inputs=seen.inputs)
    assert found.n_modes_ == n_modes
    assert mode_accuracy(seen.modes, found.modes_) > 0.995  # a sample a switch or so
    assert found.score(unseen.x, unseen.t, groups=unseen.groups, inputs=unseen.inputs) > 0.999
