"""Starts of the alternation: mixtures of experts with a gate, level sets, neighbourhood laws.

*Problem.* The alternation ends in the nearest optimum: find partitions of the rows that lie in the
right basin. *In*: rows, features, a number of modes. *Out*: ranked memberships.

In reading order: `seeding` is the whole, `starts` the first labels, `search` halves them, `experts`
is the soft EM with its gate, `designs` its linear algebra, `misfit` what a model leaves over.
"""
