"""Numbers that several files of a search in recordings go by, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """They hold for every recording; those that one file uses stand in it."""

    # stretches of the searched part, at least, so that some can be left out of a fit
    fewest_stretches: int = 9
    n_folds: int = 3
    # ties of the nodes in a scan, in units of the noise: one over it are the samples over which
    # a candidate's contribution adds up before it is compared with the recording
    ties: tuple[float, ...] = (0.1, 0.02, 0.0055)
    noise_turns: int = 3  # of the noise that misfits are measured in
    # of the noise, over the longest stretch: what ties leave free of a law. A
    # search goes on with the second if its first effect explains surely more beside that, and with
    # a larger one if a first effect is refuted, with the largest if there is none: where little
    # else disturbs a plant rollouts show most, elsewhere they go astray before it is seen
    disturbances: tuple[float, ...] = (0.1, 1.0, 10.0)
    # an effect lowers the squared error of unseen stretches by so large a share at least
    worthwhile: float = 0.05
    worth_telling: float = 0.01  # and of what the declared law has left of them
    spanned: float = 1e-6  # of a column's square that the law must leave over


SETTINGS = Settings()
