"""Identification from recordings: noisy states, no derivatives.

*Problem.* Between two switches a recording stays in one mode. With the stays given, laws, states
and switch instants of highest likelihood are a smooth problem, in which noise is where it was
measured; with the laws given, the stays are decoded.

*In*: recordings (times, measured states, inputs) and a `SwitchingSystemRegressor` that says which
library, surface and number of modes. *Out*: a `StayIdentification` with its model, standard errors
and doubts.

In reading order: `given`, `pieces`, `origin` and `recordings` are what is measured, `input_holds`
says when inputs step; `stays` and `nodes` say modes, instants and a state at every time. `laws`,
`polynomial_laws`, `sliding`, `guards` and `resets` are vector fields, surfaces and jumps with
derivatives. *Estimate*: `flow`, `equations`, `segments`, `arrow`, `lifted`, `descent`, all
intervals in one pass. *Assign*: `filtering`, `decoding`, `assign`. *Refit the surface*: `surfaces`,
`monomials`. `walk` and `walking` are noise in the equation; `start`, `rounds`, `identify`,
`search`, `count`, `merged` are starts, rounds and numbers of modes; `retold` tells single stays
otherwise; `intervals` and `exact` are for recordings without noise. `weighted` counts samples by
their noise; `condensed` asks many recordings one by one what they say of laws and surfaces;
`certainty`, `doubts`, `free` and `recording_report` say how sure all that is. `rollouts` and
`sensitivities` are whole rollouts with their derivatives, and `output_error` their least squares,
for sensors that read functions of states and for parameters with bounds, on which `refine` stands.
"""
