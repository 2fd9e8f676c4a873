"""The numbers of a search in recordings, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """Numbers that hold for every recording."""

    # nodes of all stretches, and of a column's spread what straight lines between these may lose
    most_nodes: int = 2000
    lost: float = 0.03
    far_away: float = 5.0  # of the size of usual moves from sample to sample (their quantile .95)
    # rows to both sides within which something is to move, and what is no motion: deviations of the
    # noise (31 normal values span 4.1 of them, 7 in one window of 10,000), and a share of a spread
    near: int = 15
    kept: int = 60  # rows that a rest counts as, at most
    still: float = 7.0
    still_share: float = 0.01
    # stretches of the searched part, at least, so that some can be left out of a fit
    fewest_stretches: int = 9
    # quantiles between which a state goes to and fro, and how often it does in one stretch
    to_and_fro: tuple[float, float] = (0.35, 0.65)
    turns_of_a_stretch: float = 4.0
    n_folds: int = 3
    # ties of the nodes in a scan, in units of the noise: one over it are the samples over which
    # a candidate's contribution adds up before it is compared with the recording
    ties: tuple[float, ...] = (0.1, 0.02, 0.0055)
    ties_of_instants: tuple[float, ...] = (1.0,)  # where it is sought when something happens
    turns_of_scan: int = 12
    columns_at_once: int = 256
    # of a candidate's last tie, before the best are estimated fold by fold: of 47 candidates beside
    # the law of an arm that sticks those that explained most stayed so, in 11 CPU s instead of 32
    turns_of_a_look: int = 8
    n_shortlisted: int = 6  # of each tie
    n_compared: int = 6  # on stretches that they were not fitted to
    turns_of_scans: int = 10  # of what acts once, each of what the one before explains and leaves
    # of a value between its neighbours, and how often these move on: over a stretch held out
    turns_of_refinement: int = 12
    brackets: int = 12
    # of the distance to its neighbour: there a value is at the end of what is looked for. Twelve
    # turns of a golden section end .003 of it away
    at_an_end: float = 0.02
    noise_turns: int = 3  # of the noise that misfits are measured in, and of its share to settle
    settled: float = 0.05
    about: float = 3.0
    # of the noise, over the longest stretch: what ties leave free of a law. A
    # search goes on with the second if its first effect explains surely more beside that, and with
    # a larger one if a first effect is refuted, with the largest if there is none: where little
    # else disturbs a plant rollouts show most, elsewhere they go astray before it is seen
    disturbances: tuple[float, ...] = (0.1, 1.0, 10.0)
    # of the starts of rollouts, and the share of the squares by which another one must lower them
    turns_of_starts: int = 10
    closed: float = 1e-7
    least_noise: float = 1e-4  # of a spread
    # an effect lowers the squared error of unseen stretches by so large a share at least
    worthwhile: float = 0.05
    promising: float = 0.01  # share that it would explain by one step, where it is estimated at all
    worth_telling: float = 0.01  # and of what the declared law has left of them
    blocks: int = 20  # in which two models are compared
    cap: float = 25.0  # squares in units of the mean that one sample counts at most
    # turns of instants at which a law breaks, of cubics that begin them; and by how much of the
    # velocity of a state that passes others may change, where a level is grazed
    turns_of_breaks: int = 2
    turns_of_roots: int = 12
    steepest: float = 20.0
    spanned: float = 1e-6  # of a column's square that the law must leave over


SETTINGS = Settings()
