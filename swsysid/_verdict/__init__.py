r"""The verdict: whether modes are to be believed, from what they leave of what they never saw.

A fit of several modes always leaves less than one law; whether it knows more shows on recordings
that took no part. With e the root mean square of free rollouts over these, in units of the noise,

.. math:: \text{improvement} = 1 - e_{\text{modes}} \,/ \min_{\text{laws}} e_{\text{law}},

the minimum over smooth laws of one mode: the same terms, one and two degrees more, and sines; its
standard error is over stretches, taken as independent. Data in: a fit that can be made again from
other rows, its recordings, and which are held out. Data out: `SwitchingVerdict`, the same for
Python and for the command line, which differ in what they call an option.

- `comparison`: what is held out, the errors of all, and what they say;
- `terms`: the laws that are tried in place of modes;
- `held_out`: fits to the other recordings and what rollouts from the best starts leave
  (`_automaton_search.held_out` for automata);
- `rows`: the same of rows with velocities; `memory`: a guard that remembers;
- `judge`: the laws, the modes judged beside them, and the estimators that ask;
- `verdict`: what is handed out, with its sentences; `words`: what these are said with.
"""
