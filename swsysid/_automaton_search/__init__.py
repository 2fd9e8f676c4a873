"""Identification of hybrid automata from recordings.

In discrete time, with memory: a recording becomes rows with their lags (`lagged`, in units of their
own in `discrete_data`). Laws of windows (`discrete_starts`) begin an alternation of modes and laws
by rows (`discrete_rows`), numbers of modes are compared, and where the measurements have noise the
states join the unknowns (`discrete_states`) and tell the modes (`discrete_modes`), all of it in the
order of `discrete_search`. Rollouts tell how long the memory is (`orders`); `discrete` answers.
"""
