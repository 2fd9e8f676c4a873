"""The search for effects that a model lacks, and its report: text, pictures and page.

*Problem.* A declared model leaves a residual. Which effects, out of a library, explain it, where do
they act, how sure is that, and what is left? Each candidate is fitted on folds and judged by rows
that no regression has seen; an effect stays if it lowers the error of rows that took part in no
choice.

*In*: a declared model (`_effect_model.declared`), rows with velocities or recordings, a library of
effects. *Out*: a fitted `JointFit` and an `EffectReport`.

In reading order: `search` is the estimator, `reading` what it is given, `outcome` one search from
its `folds` to the judge. `recording` has the velocities of recorded states. `greedy` is the loop;
its `structures` are priced by `held_out` rows, its `candidates` by `regression` and `scan`, and
`acceptance` by `evidence` and `chance`, with `coloured_noise` beneath them. `restarts` seeks modes
anew, `switches` judges rows beside a switch, `unknown` and `formulas` what has no name,
`disturbance` what follows nothing, `set_aside` rows that no law explains. Recordings of one law are
searched by `recorded_search` instead, and told by `recorded`. What was found:
`findings`, `contributions`, `rollouts`, `contents`, and as a `report` in `words`, `text`, `display`
and `page`. `settings` has the numbers.
"""
