"""What the user knows of laws before a fit, as linear constraints of their coefficients.

`known` is the public `Known`, a tuple of sentences (`sentences`), each of which `grammar` reads and
each of which can print itself. With the names of equations and terms they become the rows of a
`Region`, lower <= A c <= upper; `program` gives every solver what it needs of these rows: a basis
of the steps that they allow, and the least of a quadratic form among them.
"""
