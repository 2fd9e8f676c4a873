"""Plants with effects in them that the declared model lacks.

*Problem.* Records whose true effects are known, of many plants and all kinds. *In*: a plant, kinds
and sizes. *Out*: a Bunch with rows, modes and the effects.

In reading order: `make` is the whole, `plants` what it chooses from and the unlisted effects,
`records` what a plant and a mechanism are, `kinds` the listed effects, `simulation` the runs and
the size of an effect.
"""
