"""Relaxations of the mode constraint, and the way to name one."""

from __future__ import annotations

from sklearn.base import clone

from swsysid._checks.parameters import shown
from swsysid.relaxations._base import Relaxation
from swsysid.relaxations._exact import ExactRelaxation
from swsysid.relaxations._moment import MomentRelaxation
from swsysid.relaxations._simplex import SimplexRelaxation

__all__ = [
    "RELAXATIONS",
    "ExactRelaxation",
    "MomentRelaxation",
    "Relaxation",
    "SimplexRelaxation",
    "get_relaxation",
]

#: Names that ``relaxation=`` accepts, and the class of each.
RELAXATIONS = {
    "simplex": SimplexRelaxation,
    "moment": MomentRelaxation,
    "exact": ExactRelaxation,
}


def get_relaxation(relaxation) -> Relaxation:
    """Return a fresh copy of a relaxation given by its name or by an instance.

    Parameters
    ----------
    relaxation : str or Relaxation
        A key of `RELAXATIONS`, or any object with an `assign` method.

    Raises
    ------
    ValueError
        If no relaxation has that name.
    TypeError
        If it is neither a name nor an object with an `assign` method.

    Examples
    --------
    >>> from swsysid.relaxations import get_relaxation
    >>> get_relaxation("simplex")
    SimplexRelaxation()
    """
    if isinstance(relaxation, str):
        if relaxation not in RELAXATIONS:
            raise ValueError(
                f"relaxation={shown(relaxation)} is unknown; choose one of "
                f"{', '.join(RELAXATIONS)}, or give an instance."
            )
        return RELAXATIONS[relaxation]()
    if isinstance(relaxation, type) or not callable(getattr(relaxation, "assign", None)):
        raise TypeError(
            f"relaxation={shown(relaxation)} is neither a name nor an instance with a method "
            "assign(candidates, targets); subclass swsysid.relaxations.Relaxation."
        )
    return clone(relaxation, safe=False)
