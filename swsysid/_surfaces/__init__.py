"""Polynomial surfaces between modes: their bases, the margin program and what it certifies.

*Problem.* Labelled rows: find polynomials whose signs tell the labels, with few coefficients and a
margin, and say what that certifies. *In*: rows and labels. *Out*: coefficients, a mode-book,
probabilities.

In reading order: `surface` is what the package asks of any classifier, `polynomials` the features,
`margin_program` the LP, `hinge` the way to its optimum, `mode_books` signs by mode, `fitted` many
rows, `margins` certificates, `probability` and `relevance` the posterior. `settings` has the
numbers.
"""
