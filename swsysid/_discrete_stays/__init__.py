"""Stays and laws of recordings in discrete time, with memory.

Rows of a recording with their lags (`lagged`), laws and stays by rows (`rows`, `starts`,
`row_search`) and by rows of averages (`averages`), both with noise where it was measured (`states`,
`modes`, `found`), numbers of modes (`search`, `more_modes`), and how long the memory is (`orders`).
"""
