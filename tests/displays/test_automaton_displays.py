"""The graph of an automaton and the timeline of its rollouts."""

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

from swsysid import HybridAutomaton
from swsysid._displays.graph_layout import Box, arrow_between, label_on, loop_at, node_boxes
from swsysid.plotting import AutomatonGraphDisplay, ModeTimelineDisplay


@pytest.fixture(autouse=True)
def close_figures():
    yield
    plt.close("all")


def _ring(n_modes, **more):
    """Modes in a cycle, with a jump in the first."""
    transitions = [(k, (k + 1) % n_modes, f"x >= {k + 1}") for k in range(n_modes) if n_modes > 1]
    return HybridAutomaton.stated(
        [{"x": f"{k} - 0.5 x"} for k in range(n_modes)],
        [*transitions, (0, 0, "x <= -1", {"x": "-0.5 x"})],
        states=["x"],
        **more,
    )


@pytest.mark.parametrize("n_modes", range(1, 7))
def test_a_graph_has_a_box_for_each_mode_and_an_arrow_for_each_transition(n_modes):
    automaton = _ring(n_modes)
    ax = AutomatonGraphDisplay.from_estimator(automaton).ax_
    kinds = [type(patch) for patch in ax.patches]
    assert kinds.count(FancyBboxPatch) == n_modes
    assert kinds.count(FancyArrowPatch) == len(automaton.transitions)
    texts = [text.get_text() for text in ax.texts]
    assert [text for text in texts if text.startswith("mode")] == [
        f"mode {mode}" for mode in range(n_modes)
    ]
    assert r"$x \leq -1$" in texts and r"$x \leftarrow -0.5 x$" in texts


@pytest.mark.parametrize("n_modes", range(1, 7))
def test_nothing_of_a_graph_is_hidden(n_modes):
    display = AutomatonGraphDisplay.from_estimator(_ring(n_modes))
    display.figure_.draw_without_rendering()
    boxes = [text.get_window_extent() for text in display.ax_.texts]
    whole = display.figure_.bbox
    for number, box in enumerate(boxes):
        assert whole.x0 <= box.x0 and box.x1 <= whole.x1
        assert whole.y0 <= box.y0 and box.y1 <= whole.y1
        # lines of one text touch; no text lies on another
        assert not any(_overlap(box, other) > 4.0 for other in boxes[:number])


def _overlap(one, other):
    """Width in pixels of what two texts share, if they share more than a pixel of height."""
    width = min(one.x1, other.x1) - max(one.x0, other.x0)
    height = min(one.y1, other.y1) - max(one.y0, other.y0)
    return width if height > 4.0 else 0.0


def test_boxes_and_curves_of_a_layout():
    sizes = [np.array([2.0, 1.0])] * 5
    boxes = node_boxes(sizes, np.array([1.0, 0.5]))
    overlaps = [a.overlap(b) for k, a in enumerate(boxes) for b in boxes[:k]]
    assert overlaps == [0.0] * 10
    curve = arrow_between(boxes, 0, 1, 0)
    assert not any(box.holds(curve).any() for box in boxes)
    back = arrow_between(boxes, 1, 0, 0)
    apart = np.linalg.norm(curve[len(curve) // 2] - back[len(back) // 2])
    assert apart > 0.5
    loop, label = loop_at(boxes[0], 0, np.array([1.0, 0.5]))
    assert not boxes[0].holds(loop).any() and label.overlap(boxes[0]) == 0.0
    # a label goes along its curve to where there is room
    taken = Box(curve[len(curve) // 2], np.array([0.1, 0.1]))
    place = label_on(curve, np.array([0.1, 0.1]), [taken], [])
    assert place.overlap(taken) == 0.0


def test_long_laws_go_on_in_the_next_line_and_words_stand_upright():
    automaton = HybridAutomaton.stated(
        [{"speed": "torque - 0.25 speed - 0.125 speed^2 - 0.0625 speed^3 + 3 torque^2"}],
        states=["speed"],
        inputs=["torque"],
    )
    texts = [text.get_text() for text in AutomatonGraphDisplay.from_estimator(automaton).ax_.texts]
    assert texts[1].startswith(r"$\,\mathrm{speed}' = ")
    assert len(texts) > 2 and all(text.startswith(r"$\quad ") for text in texts[2:])


def test_names_that_matplotlib_cannot_set_are_shown_as_they_are():
    strange = HybridAutomaton.stated([[[1.0, 0.0]]], states=["a\\b"], inputs=["u"])
    display = AutomatonGraphDisplay.from_estimator(strange)
    assert len(display.ax_.texts) == 2


def test_a_graph_fits_the_axes_it_is_given():
    _, ax = plt.subplots(figsize=(2.0, 2.0))
    display = AutomatonGraphDisplay.from_estimator(_ring(4), ax=ax, linewidth=3.0)
    assert display.ax_ is ax and ax.texts[0].get_fontsize() < 12
    arrows = [patch for patch in ax.patches if isinstance(patch, FancyArrowPatch)]
    assert {arrow.get_linewidth() for arrow in arrows} == {3.0}


def test_a_graph_of_an_estimator_that_holds_an_automaton():
    class Fitted:
        automaton_ = _ring(2)

    assert len(AutomatonGraphDisplay.from_estimator(Fitted()).laws) == 2
    with pytest.raises(TypeError, match="3 is no automaton and has none; give a HybridAutomaton"):
        AutomatonGraphDisplay.from_estimator(3)


# -- timeline --------------------------------------------------------------------------------------

TIMER = HybridAutomaton.stated(
    [{"x": "1"}, {"x": "-1"}, {"x": "0"}],
    [(0, 1, "dwell >= 1.25"), (1, 2, "dwell >= 0.5"), (2, 0, "dwell >= 1")],
    states=["x"],
)


def test_a_timeline_shows_stays_between_the_samples_and_their_instants():
    # the stay in mode 1 lies between two samples, one instant on a sample
    rollout = TIMER.simulate([0.0], [0.0, 1.0, 2.0, 2.75, 3.5], mode=0)
    ax = ModeTimelineDisplay.from_trajectory(rollout, names=["run"]).ax_
    (bars,) = ax.collections
    spans = [np.round(path.get_extents().intervalx, 9).tolist() for path in bars.get_paths()]
    assert spans == [[0.0, 1.25], [1.25, 1.75], [1.75, 2.75], [2.75, 3.5]]
    assert [label.get_text() for label in ax.get_yticklabels()] == ["run"]
    assert [text.get_text() for text in ax.get_legend().get_texts()] == [
        "mode 0", "mode 1", "mode 2",
    ]  # fmt: skip


def test_a_timeline_of_several_rollouts_and_what_it_refuses():
    rollouts = [TIMER.simulate([0.0], np.linspace(0, 3, 7), mode=mode) for mode in (0, 2)]
    display = ModeTimelineDisplay.from_trajectory(rollouts)
    assert display.groups == [0, 1] and [modes[0] for modes in display.modes] == [0, 2]
    with pytest.raises(TypeError, match="must be a Trajectory or a list of them"):
        ModeTimelineDisplay.from_trajectory([1.0])
    with pytest.raises(ValueError, match="names holds 1 entries for 2 trajectories"):
        ModeTimelineDisplay.from_trajectory(rollouts, names=["a"])
