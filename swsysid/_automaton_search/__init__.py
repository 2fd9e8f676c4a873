"""Identification of hybrid automata from recordings: stays, guards, resets.

In continuous time (`continuous`) stays are told by the laws (`_stays`), states are cut where they
jump (`jumps`, `apart`), and each transition is found from its switches (`switches`, `instants`,
`resets`, `guards`). In discrete time, with memory (`sampled`), stays are told by rows of a
recording with their lags (`lagged`, `discrete`).
"""
