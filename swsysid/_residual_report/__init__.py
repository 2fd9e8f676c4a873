"""What a fitted model leaves over, and what the leftover depends on.

*Problem.* Is a residual noise? If not: of which channel is it a function, how large, how sure?

*In*: a fitted model and rows that it has not seen. *Out*: a `ResidualReport`.

In reading order: `samples` (the residual, in order), `noise_floor` (how much of it is noise),
`whiteness`, `channels` (what it may depend on), `dependence` (the tests), `findings` (of every
equation and mode), and the report: `contents`, `report`, `display`.
"""
