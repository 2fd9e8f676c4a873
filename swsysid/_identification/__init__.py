"""From rows to one answer: problem, starts, alternation, number of modes, terms, doubts.

*Problem.* Rows (x, velocity) of a switching system, and nothing about which mode each is in: find
vector fields, memberships and surfaces of least joint objective, as many modes and terms as the
rows need, and say what is doubtful.

*In*: checked rows in blocks and the choices of the regressor. *Out*: coefficients, a surface,
modes, and records of what was tried.

In reading order: `setup` makes a `problem` of rows and choices; `identify` goes from starts to one
answer by the `descent`; `number_of_modes` and `terms` choose; `all_rows` goes over more rows than
memory holds, within a `trust_region`; `doubts` says what may be wrong. `settings` has the numbers.
"""
