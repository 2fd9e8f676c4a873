"""Geometry of a graph whose nodes are boxes of text: places, curves between them, their labels.

Lengths are in inches; a box is its centre and its size, (2,) each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._checks.arrays import Array

_GAP = 0.25  # between things that may not touch
_LOOP = 0.5  # width and height of a curve back to its own box
_BOW = 0.22  # how far a curve leaves the straight line, as a share of its length
_MOST_BOW = 0.5
# Prices of a label: for standing beside its curve, and for an inch of curves that it hides.
_BESIDE, _OTHERS, _OWN = 0.05, 0.2, 0.06
_HEAD = 25  # points of a curve at which its head is
_ALONG = (0.5, 0.42, 0.58, 0.34, 0.66, 0.26, 0.74, 0.18, 0.82)  # places of labels that are tried


@dataclass(frozen=True)
class Box:
    """A rectangle."""

    centre: Array
    size: Array

    @property
    def corner(self) -> Array:
        """The lower left corner."""
        return self.centre - self.size / 2

    def holds(self, points: Array) -> NDArray[np.bool_]:
        """True for points inside, (n_points, 2) -> (n_points,)."""
        return np.logical_and.reduce(np.abs(points - self.centre) <= self.size / 2, axis=1)

    def overlap(self, other: Box) -> float:
        """Area that two rectangles share."""
        shared = (self.size + other.size) / 2 - np.abs(self.centre - other.centre)
        return float(np.prod(np.clip(shared, 0.0, np.minimum(self.size, other.size))))

    def grown(self, margin: float) -> Box:
        """The rectangle with a margin around it."""
        return Box(self.centre, self.size + 2 * margin)


def node_boxes(sizes: Sequence[Array], label: Array) -> list[Box]:
    """Boxes on an ellipse, clockwise from the upper left, with room for labels between them.

    `sizes` are those of the nodes, `label` that of the largest label.
    """
    n_nodes = len(sizes)
    if n_nodes == 1:
        return [Box(np.zeros(2), sizes[0])]
    start = np.pi / 2 + (np.pi / n_nodes if n_nodes % 2 == 0 else 0.0)
    angles = start - 2 * np.pi * np.arange(n_nodes) / n_nodes
    # neighbours are a chord 2 r sin(pi / n) apart
    largest = np.max(sizes, axis=0)
    distance = largest + (label + 3 * _GAP) * ([1.0, 1.0] if n_nodes == 2 else [1.0, 1.6])
    radii = distance / (2 * np.sin(np.pi / n_nodes))
    places = radii * np.column_stack([np.cos(angles), np.sin(angles)])
    return [Box(place, size) for place, size in zip(places, sizes, strict=True)]


def arrow_between(boxes: Sequence[Box], source: int, target: int, rank: int) -> Array:
    """Points of a curve from box to box, bowed to the left of its way, more for a higher rank."""
    start, end = boxes[source], boxes[target]
    # between neighbours on the ellipse there is room; others would be pushed towards a third box
    are_neighbours = (source - target) % len(boxes) in (1, len(boxes) - 1)
    bow = _BOW * (1.0 if are_neighbours else 0.4) * (1.0 + 0.9 * rank)
    way = end.centre - start.centre
    length = float(np.linalg.norm(way))
    aside = np.array([-way[1], way[0]]) * bow * min(1.0, _MOST_BOW / (_BOW * length))
    middle = (start.centre + end.centre) / 2 + 2 * aside
    return _outside(_bezier(start.centre, middle, end.centre), start, end)


def loop_at(box: Box, rank: int, label: Array) -> tuple[Array, Box]:
    """A curve out of a box and back, on the side away from the middle, and a label beyond it."""
    side = 1.0 if box.centre[1] > -_GAP else -1.0
    # several stand beside each other, wide enough apart for their labels
    aside = (rank + 1) // 2 * (-1) ** rank * max(label[0], _LOOP)
    foot = box.centre + [aside, side * box.size[1] / 2]
    half, up = np.array([_LOOP / 4, 0.0]), np.array([0.0, side * _LOOP])
    # a cubic goes three quarters of the way to its inner points
    points = _bezier(foot - half, foot - 3 * half + up * 4 / 3, foot + 3 * half + up * 4 / 3,
                     foot + half)  # fmt: skip
    top = foot + up + [0.0, side * label[1] / 2]
    return _outside(points, box, box), Box(top, label)


def label_on(curve: Array, size: Array, taken: Sequence[Box], others: Sequence[Array]) -> Box:
    """Where at a curve a label hides least: upon it, or on the side to which it is bowed."""
    boxes, costs = [], []
    for part in _ALONG:
        place = round(part * (len(curve) - 1))
        way = curve[min(place + 1, len(curve) - 1)] - curve[max(place - 1, 0)]
        left = np.array([-way[1], way[0]]) / np.linalg.norm(way)
        beside = left * (np.abs(left) @ size / 2 + _GAP / 5)
        for moved, price in ((0.0 * beside, 0.0), (beside, _BESIDE)):
            box = Box(curve[place] + moved, size)
            boxes.append(box)
            costs.append(price + _cost(box, curve, taken, others))
    return boxes[int(np.argmin(np.round(costs, 3)))]


def _cost(box: Box, curve: Array, taken: Sequence[Box], others: Sequence[Array]) -> float:
    """What a label hides: square inches of boxes, and inches of curves, its own for less."""
    head = curve[-_HEAD:]
    return (
        sum(box.overlap(other) for other in taken)
        + _OTHERS * sum(_hidden_length(other, box) for other in others)
        + _OWN * _hidden_length(curve, box)
        + float(box.grown(-_GAP / 4).holds(head).any())
    )


def _hidden_length(curve: Array, box: Box) -> float:
    """Length of a curve within a box."""
    steps = np.linalg.norm(np.diff(curve, axis=0), axis=1)
    return float(steps[box.holds(curve[1:])].sum())


def frame(boxes: Sequence[Box], curves: Sequence[Array]) -> tuple[Array, Array]:
    """Lower left and upper right corner of everything, with a margin."""
    corners = [box.centre + side * box.size / 2 for box in boxes for side in (-1, 1)]
    points = np.concatenate([corners, *curves])
    return points.min(axis=0) - _GAP, points.max(axis=0) + _GAP


def _bezier(*points: Array) -> Array:
    """A quadratic or cubic Bezier curve, by de Casteljau's averages."""
    t = np.linspace(0.0, 1.0, 201)[:, None]
    curves: list[Array] = [np.broadcast_to(point, (len(t), 2)) for point in points]
    while len(curves) > 1:
        curves = [(1 - t) * a + t * b for a, b in zip(curves[:-1], curves[1:], strict=True)]
    return curves[0]


def _outside(points: Array, start: Box, end: Box) -> Array:
    """The part of a curve between the two boxes that it joins."""
    first, last = start.grown(0.03).holds(points), end.grown(0.05).holds(points)
    half = len(points) // 2
    begin = np.flatnonzero(first[:half])[-1] + 1 if first[:half].any() else 0
    stop = half + np.flatnonzero(last[half:])[0] if last[half:].any() else len(points)
    return points[begin : max(stop, begin + 2)]
