"""An automaton as a graph: modes with their laws, transitions with guards and resets."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np

from swsysid._automaton.equations import guard_text, reset_texts
from swsysid._automaton.model import HybridAutomaton
from swsysid._checks.arrays import Array
from swsysid._checks.parameters import shown, whole
from swsysid._displays.graph_layout import (
    Box,
    arrow_between,
    frame,
    label_on,
    loop_at,
    node_boxes,
)
from swsysid._displays.style import Display, mode_colour
from swsysid._simulation.model import laws_of_mode

_SIZE = 12.0  # of the letters, in points
_LINE = 1.45 * _SIZE / 72  # height of a line, in inches
_PADDING = 0.1
_WORD = re.compile(r"\\operatorname\{\w+\}|\\[A-Za-z]+|(?P<before>\{|\d |)(?P<word>[A-Za-z]{2,})")
_WIDEST = 34  # letters of a line of plain text; longer sums go on in the next line


@runtime_checkable
class FittedAutomaton(Protocol):
    """An estimator that has identified an automaton."""

    automaton_: HybridAutomaton


def automaton_of(model: object) -> HybridAutomaton:
    """The automaton of a fitted estimator, or an automaton itself; anything else is refused."""
    if isinstance(model, FittedAutomaton) and not isinstance(model, type):
        model = model.automaton_
    if not isinstance(model, HybridAutomaton):
        raise TypeError(
            f"{shown(model)} is no automaton and has none; give a HybridAutomaton, or an estimator "
            "that has been fitted to one."
        )
    return model


@dataclass(kw_only=True, eq=False, repr=False)
class AutomatonGraphDisplay(Display):
    r"""The graph of a hybrid automaton: a box for each mode, an arrow for each transition.

    Use `from_estimator`. A box has the laws of its mode. At an arrow stands where the transition is
    taken, and beneath what becomes of the states that it resets. Numbers have `precision`
    significant digits.

    Parameters
    ----------
    laws : list of list of str
        The lines of each mode, in the notation of TeX without dollars.
    transitions : list of (int, int, list of str)
        Source, target and lines of each transition.

    Attributes
    ----------
    ax_ : matplotlib Axes
    figure_ : matplotlib Figure

    Examples
    --------
    >>> import matplotlib; matplotlib.use("Agg")
    >>> from swsysid import HybridAutomaton
    >>> from swsysid.plotting import AutomatonGraphDisplay
    >>> thermostat = HybridAutomaton.stated(
    ...     [{"T": "3 - 0.1 T"}, {"T": "1 - 0.1 T"}],
    ...     [(0, 1, "T >= 22"), (1, 0, "T <= 20")],
    ...     states=["T"],
    ... )
    >>> display = AutomatonGraphDisplay.from_estimator(thermostat)
    >>> display.laws[0], display.transitions[0]
    (['\\dot{T} = 3 - 0.1 T'], (0, 1, ['T \\geq 22']))
    """

    laws: list[list[str]]
    transitions: list[tuple[int, int, list[str]]]

    _one_panel = True

    @classmethod
    def from_estimator(cls, estimator, *, precision=3, ax=None, **kwargs):
        """Draw the graph of an automaton.

        Parameters
        ----------
        estimator : HybridAutomaton, or a fitted estimator with one as ``automaton_``
        precision : int, default=3
            Significant digits.
        ax : matplotlib Axes, default=None
            None draws on a figure that is as large as the graph; on a smaller axes the text is
            smaller.
        **kwargs
            Passed to matplotlib's ``FancyArrowPatch`` for the arrows.

        Returns
        -------
        AutomatonGraphDisplay

        Raises
        ------
        TypeError
            If `estimator` is no automaton and has none.
        """
        automaton = automaton_of(estimator)
        whole("precision", precision)
        columns = automaton.guard_columns
        laws = [
            laws_of_mode(
                automaton.coef,
                mode,
                automaton.feature_map,
                precision,
                "latex",
                discrete_time=automaton.discrete_time,
                states=automaton.state_names,
                brief=True,
            )
            for mode in range(automaton.n_modes)
        ]
        transitions = [
            (
                one.source,
                one.target,
                [
                    guard_text(one.guard, columns, precision, "latex", brief=True),
                    *reset_texts(one.reset, columns, precision, "latex", brief=True),
                ],
            )
            for one in automaton.transitions
        ]
        return cls(laws=laws, transitions=transitions).plot(ax=ax, **kwargs)

    @property
    def _panel_size(self):
        low, high = self._layout.corners
        return tuple(high - low)

    @cached_property
    def _layout(self) -> _Layout:
        return _Layout.of(self.laws, self.transitions)

    def _draw(self, ax, **kwargs):
        from matplotlib.patches import FancyArrowPatch, FancyBboxPatch, Rectangle
        from matplotlib.path import Path

        layout = self._layout
        low, high = layout.corners
        ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
        ax.axis("off")
        size = _SIZE * min(1.0, _inches_of(ax, high - low))
        for (source, *_), curve in zip(self.transitions, layout.curves, strict=True):
            options = {"arrowstyle": "-|>", "mutation_scale": 1.4 * size, "linewidth": 1.6}
            colour = mode_colour(source)
            ax.add_patch(
                FancyArrowPatch(
                    path=Path(curve),
                    **options | {"color": colour, "shrinkA": 0, "shrinkB": 0, "zorder": 1} | kwargs,
                )
            )
        for lines, box in zip(layout.labels, layout.label_boxes, strict=True):
            under = box.grown(-_PADDING / 2)
            ax.add_patch(
                Rectangle(under.corner, *under.size, color="white", linewidth=0, zorder=1.5)
            )
            _write(ax, lines, box, size)
        for mode, (lines, box) in enumerate(zip(layout.nodes, layout.node_boxes, strict=True)):
            patch = FancyBboxPatch(
                box.corner,
                *box.size,
                boxstyle="round,pad=0,rounding_size=0.08",
                facecolor="white",
                edgecolor=mode_colour(mode),
                linewidth=2.0,
                zorder=2,
            )
            ax.add_patch(patch)
            _write(ax, lines, box, size, heading=mode_colour(mode))


@dataclass(frozen=True)
class _Layout:
    """Where everything of a graph stands."""

    nodes: list[list[str]]  # their lines, as matplotlib takes them
    node_boxes: list[Box]
    curves: list[Array]
    labels: list[list[str]]
    label_boxes: list[Box]

    @classmethod
    def of(cls, laws, transitions) -> _Layout:
        nodes = [[f"mode {mode}", *_mathematics(lines)] for mode, lines in enumerate(laws)]
        labels = [_mathematics(lines) for *_, lines in transitions]
        sizes = [_size_of(lines) for lines in labels]
        boxes = node_boxes(
            [_size_of(lines) for lines in nodes], np.max([*sizes, np.zeros(2)], axis=0)
        )
        ends = [(source, target) for source, target, _ in transitions]
        # several between the same modes lie beside each other
        ranks = [ends[:number].count(one) for number, one in enumerate(ends)]
        loops = {
            number: loop_at(boxes[source], ranks[number], sizes[number])
            for number, (source, target) in enumerate(ends)
            if source == target
        }
        curves = [
            loops[number][0] if number in loops else arrow_between(boxes, *one, ranks[number])
            for number, one in enumerate(ends)
        ]
        placed: list[Box] = [label for _, label in loops.values()]
        at_curves: list[Box] = []
        for number, (curve, size) in enumerate(zip(curves, sizes, strict=True)):
            if number in loops:
                at_curves.append(loops[number][1])
                continue
            others = curves[:number] + curves[number + 1 :]
            at_curves.append(label_on(curve, size, [*boxes, *placed], others))
            placed.append(at_curves[-1])
        return cls(nodes, boxes, curves, labels, at_curves)

    @property
    def corners(self) -> tuple[Array, Array]:
        """Lower left and upper right corner."""
        return frame([*self.node_boxes, *self.label_boxes], self.curves)


def _mathematics(lines: Sequence[str]) -> list[str]:
    """Lines of TeX for matplotlib; long sums are broken before a sign."""
    broken: list[str] = []
    for line in lines:
        rows = [""]
        for part in re.split(r" (?=[-+] )", line):
            if rows[-1] and len(_letters(f"{rows[-1]} {part}")) > _WIDEST:
                rows.append(r"\quad " + part)
            else:
                rows[-1] = f"{rows[-1]} {part}".strip()
        broken += [_set(row) for row in rows]
    return broken


def _set(tex: str) -> str:
    """TeX as matplotlib takes it, words upright and apart; as it is where that cannot be set."""
    from matplotlib.mathtext import MathTextParser

    readable = re.sub(r"\\frac\{d\}\{dt\} (\S+)", r"\1'", tex)
    readable = _WORD.sub(_upright, readable)
    try:
        MathTextParser("path").parse(f"${readable}$")
    except ValueError:
        return tex
    return f"${readable}$"


def _upright(match: re.Match) -> str:
    """A word upright, and apart from what stands before it unless that is a bracket."""
    before, word = match["before"], match["word"]
    if word is None:  # a command
        return match[0]
    return rf"{before}\mathrm{{{word}}}" if before == "{" else rf"{before}\,\mathrm{{{word}}}"


def _letters(tex: str) -> str:
    """About as many letters as a text in TeX takes."""
    return re.sub(r"\\[a-z]+|[{}^_\\]", "", tex)


def _size_of(lines: Sequence[str]) -> Array:
    """Width and height of some lines in a box."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    font = FontProperties(size=_SIZE)
    widths = [
        text_to_path.get_text_width_height_descent(line, font, line.startswith("$"))[0]
        for line in lines
    ]
    return np.array([max(widths) / 72, len(lines) * _LINE]) + 2 * _PADDING * np.array([1.0, 0.5])


def _inches_of(ax, wanted: Array) -> float:
    """How many inches of the axes an inch of a graph of the wanted size gets."""
    ax.figure.draw_without_rendering()  # a layout engine places the axes while they are drawn
    corners = ax.get_window_extent().size / ax.figure.dpi
    return float((corners / wanted).min())


def _write(ax, lines: Sequence[str], box: Box, size: float, heading: str | None = None):
    """Lines of text in a box, the first bold if it has a colour of its own."""
    top = box.centre[1] + (len(lines) - 1) / 2 * _LINE
    for place, line in enumerate(lines):
        bold = {"color": heading, "weight": "bold"} if heading and not place else {"color": "0.1"}
        ax.text(
            box.centre[0],
            top - place * _LINE,
            line,
            ha="center",
            va="center",
            fontsize=size,
            zorder=3,
            **bold,
        )
