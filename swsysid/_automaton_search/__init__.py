"""Identification of hybrid automata from recordings: stays, guards, resets.

In continuous time (`continuous`) stays are told by the laws (`_stays`), states are cut where they
jump (`jumps`, `cutting`, which asks whether they walk, too), and each transition is found from its
switches (`switches`, `instants`, `resets`, `guards`); then laws, guards and resets are refined
together (`refined`, `joint` with `transition_guards`). In discrete time (`sampled`) stays are told
by lagged rows (`_discrete_stays`), and guards by their margins (`margins`).
"""
