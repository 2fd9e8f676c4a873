"""Numbers of an identification from recordings."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class StaySettings:
    """What an identification from recordings takes for granted."""

    # Candidates for the disturbance of the velocity in the filter, as fractions of the velocity's
    # spread times the square root of the time in `memory` samples; likelihood chooses.
    disturbances: tuple[float, ...] = (0.3, 0.1, 0.03, 0.01, 0.003)
    memory: int = 3
    n_kept: int = 6  # hypotheses of a recording
    # intervals that are decoded side by side, and those more to both sides in which a hypothesis
    # settles
    piece: int = 100
    overlap: int = 15
    # of a switch, in nats, in the first round and in later ones: once the surface is known a switch
    # follows from it
    prices: tuple[float, ...] = (4.0, 3.0, 2.0, 1.0)
    # least probability that a surface gives to a mode, in the first round and in later ones: the
    # first surface comes from velocities that were differentiated
    trust: tuple[float, ...] = (0.1, 0.03, 0.01, 0.003)
    blurred: float = 0.5  # intervals by which the time of a state is off where a surface is asked
    beyond_slide: float = 0.2  # of the share of a mode in a slide, which is between 0 and 1
    settled: int = 2  # the round from which the surface before is a start, not the classifier
    # deviations of the noise from a surface within which a recording may have been beyond it or
    # not, and most of such visits that are tried together
    near_miss: float = 2.0
    most_visits: int = 3
    # rounds with a coefficient of the surface less, before it is judged, and nats by which it is
    # not judged any more; nats of a coefficient that is there whatever the stays: those that left
    # took less than 30, those that stayed 6e3 to 9e5
    rounds_of_simplified: int = 2
    certain: float = 1000.0
    hopeless: float = 100.0
    # samples of a part that is rolled out alone, where recordings are not rolled out as a whole, or
    # that may ask for a mode of its own
    segment: int = 30
    # samples of the longest stay that is tried in other modes, and of what is around it
    brief: int = 60
    around_brief: int = 10
    # most error of the longest rollout, in units of the noise, by steps of the integration that are
    # too long, and most pairs of steps between two samples
    exact: float = 0.1
    most_steps: float = 8.0
    # how tightly nodes are tied to each other, in units of the noise, and turns for each
    ties: tuple[tuple[float, int], ...] = ((0.4, 4), (0.05, 6), (0.0055, 20))
    # by which crossings may miss their surface, in intervals between samples, and turns for each
    guard_times: tuple[tuple[float, int], ...] = ((3.0, 8), (0.3, 8), (0.1, 15))
    # a sample on the wrong side of a surface pays for so many intervals as for one deviation
    beyond: float = 0.3
    damping: float = 1e-3  # of the first step, relative to the diagonal
    rise: float = 30.0  # of the damping after steps that failed, and how often they may
    most_failures: int = 6
    most_followed: int = 2  # steps that raise the value before they are taken back
    # nats by which a turn must make the data more likely, in rounds and at the end
    nearly_converged: float = 0.1
    converged: float = 0.02
    roughly_converged: float = 1.0  # where a descent goes on more closely, or stays are not right
    turns_of_snapped: int = 5  # in which instants put on the surface must be better than the others
    most_rounds: int = 6  # ends sooner where the stays repeat
    # -- starts: windows of differentiation, relative to the automatic one. A shorter one leaves
    # more noise and blurs switches less.
    stretches: tuple[float, ...] = (1.0, 0.5)
    # nats that it may cost to make two laws one, before stays are told again
    most_merged: float = 1000.0
    turns_of_intervals: int = 60  # of weights, where single intervals tell the laws

    def roughly(self) -> StaySettings:
        """The same for descents that others follow."""
        return replace(self, converged=self.nearly_converged)

    def coarsely(self) -> StaySettings:
        """The same for rounds whose stays are not right yet: nodes and crossings need not meet."""
        return replace(
            self,
            guard_times=self.guard_times[:-1],
            converged=self.roughly_converged,
            turns_of_snapped=0,
        )

    def joined(self, whole: bool) -> StaySettings:
        """The same, the nodes of a recording joined to one rollout or left apart."""
        return self if whole else replace(self, ties=self.ties[:1])


@dataclass(frozen=True)
class Limits:
    """Where something counts as far, missing, diverged or on its surface, in several places."""

    # of a spread: what is counted as no misfit at all, and what no other mode need explain
    exactly: float = 1e-6
    nearly_exactly: float = 3e-6
    first_samples: int = 20  # from which a start is found
    samples_of_part: int = 10_000  # of long recordings, with which the first rounds are made
    # and that tell what inputs do: of 11,628 rows in 15 CPU s
    samples_of_holds: int = 2000
    unseen: float = 1e-5  # noise below which neighbours tell none of it, of a spread
    # one-sided differences, in spreads of a state, and where one is held
    difference: float = 1e-6
    diverged: float = 1e3
    shortest_step: float = 0.01  # that an event counts as, in usual intervals
    # standard deviations beyond which a crossing counts less; of the median rate at which a surface
    # is crossed, below which a crossing grazes
    far_miss: float = 3.0
    slowest_crossing: float = 0.1
    rounding: float = 1e-12  # of the diagonal: what normal equations cannot tell


SETTINGS, LIMITS = StaySettings(), Limits()
