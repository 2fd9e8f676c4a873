"""Stays and laws of recordings in discrete time, with memory.

Rows of a recording with their lags (`lagged`), laws and stays by rows (`rows`, `starts`), both with
noise where it was measured (`states`), and how long the memory is (`orders`).
"""
