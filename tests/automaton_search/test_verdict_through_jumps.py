"""What a verdict on automata judges: jumps that are recorded, modes that nothing tells."""

from types import SimpleNamespace

import numpy as np
import pytest

from swsysid import HybridAutomatonRegressor
from swsysid._automaton_search.held_out import HeldOutAutomata
from swsysid.results import Verdict

GRAVITY, BACK = 9.81, 0.7


def drop(height, end=1.6, step=0.02):
    """A ball let fall from a height: two rows at each impact, as hybrid simulators write them."""
    rows, begin, h, v = [], 0.0, height, 0.0
    while begin < end:
        impact = begin + (v + np.sqrt(v**2 + 2.0 * GRAVITY * h)) / GRAVITY
        own = np.append(
            np.arange(np.ceil(begin / step) * step + 1e-9, min(impact, end), step), impact
        )
        own = np.append(begin, own[own <= end])
        since = own - begin
        rows.append(
            np.column_stack([own, h + v * since - 0.5 * GRAVITY * since**2, v - GRAVITY * since])
        )
        begin, h, v = impact, 0.0, BACK * (GRAVITY * (impact - begin) - v)
    table = np.vstack(rows)
    return {"t": table[:, 0], "x": table[:, 1:]}


def test_a_ball_is_not_told_where_its_jumps_lead():
    runs = [drop(height) for height in (1.0, 0.8, 1.3, 0.6, 1.1, 0.9)]
    found = HybridAutomatonRegressor(feature_library=1, random_state=0).fit(runs)
    assert [one.source for one in found.transitions_] == [0]
    verdict = found.verdict_
    assert verdict.kind is Verdict.SWITCHES
    # a law without impacts misses by as much as speeds change there, the automaton by rounding
    assert verdict.errors_of_laws["affine"][1] > 0.1 * GRAVITY > 100.0 * verdict.errors[1]


@pytest.mark.parametrize(
    ("guards_tell", "imitates", "hidden"),
    [((True, False), False, True), ((True, True), False, False), ((True, False), True, False)],
)
def test_what_switches_is_unknown_only_where_no_guard_tells_it(guards_tell, imitates, hidden):
    verdicts = [SimpleNamespace(is_told=one) for one in guards_tell]
    report = SimpleNamespace(verdicts=verdicts, imitates=imitates)
    judge = SimpleNamespace(given=SimpleNamespace(n_channels=1))
    told = HeldOutAutomata.told(judge, SimpleNamespace(report_=report, noise_=np.ones(2)))
    assert (told is not None) == hidden
