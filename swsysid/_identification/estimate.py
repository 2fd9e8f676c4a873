"""What rows are assigned to modes with: vector fields, and surfaces where they are coupled."""

from __future__ import annotations

from dataclasses import dataclass

from swsysid._identification.problem import Modes, SwitchingProblem
from swsysid._results import Array
from swsysid._surfaces.fitted import FittedSurfaces
from swsysid._surfaces.surface import CoupledClassifier

__all__ = ["Estimate"]


@dataclass(frozen=True)
class Estimate:
    """Vector fields and surfaces, as a pass over many rows takes them.

    Attributes
    ----------
    coef : ndarray of shape (n_modes, n_states, n_features_out)
    surface : FittedSurfaces, other classifier, or None
        What the assignment is coupled to; where it is not coupled, `FittedSurfaces` next to which
        the labels are summarised.
    """

    coef: Array
    surface: FittedSurfaces | CoupledClassifier | None

    def modes_of(self, problem: SwitchingProblem) -> Modes:
        """Labels of the rows of a problem."""
        penalty = self.penalty(problem, self.surface_values(problem.coordinates))
        return problem.assign(self.coef, penalty).modes

    def surface_values(self, X: Array) -> Array | None:
        """Values of the surfaces, None for a classifier that is known by its labels only."""
        return self.surface.values(X) if isinstance(self.surface, FittedSurfaces) else None

    def penalty(self, problem: SwitchingProblem, values: Array | None) -> Array | None:
        """Slack of every row in every mode at these values, None without coupling."""
        surface = self.surface
        if not problem.coupling or surface is None:
            return None
        if not isinstance(surface, FittedSurfaces):
            return problem.penalty(surface)
        assert values is not None, "the surfaces are functions"
        return problem.penalty_of_all(surface.classes, surface.penalty(values))

    @property
    def complexity(self) -> float:
        """The part of the surfaces' objective that no row has a say in."""
        return self.surface.complexity if isinstance(self.surface, FittedSurfaces) else 0.0
