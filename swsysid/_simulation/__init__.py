"""A fitted switching system and its rollouts: events, sliding, inputs, effects with memory.

*Problem.* Integrate a system whose law changes at surfaces: find when, cross, slide or stop, and
end in an orderly way whatever the fields do.

*In*: vector fields, surfaces, an initial state, times and inputs. *Out*: a `Trajectory`.

In reading order: `system` is what a simulation asks for, `model` what a fitted estimator answers;
`inputs` are functions of time, `events` has the flow between switches and their instants,
`simulate` the rollout. With effects: `effect_system`, and `stepping` for systems that remember.
"""
