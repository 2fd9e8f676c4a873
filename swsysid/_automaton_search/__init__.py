"""Identification of hybrid automata from recordings.

With memory and in discrete time: rows of a recording with their lags (`lagged`), laws and stays by
rows (`discrete_rows`, `discrete_starts`), both with noise where it was measured
(`discrete_states`), and how long the memory is (`orders`).
"""
