"""Rows in memory, in files and in blocks; samples of them; records; the feature map Phi.

*Problem.* Measurements come as arrays, frames, files, blocks or Dask arrays, in any order and any
units; all else in this package asks for checked rows in one order.

*In*: what users hand in. *Out*: `RowBlocks`, `Records`, features.

In reading order: `sources` (where rows come from), `rows` (their canonical order), `sampling`,
`trajectories` (rows of recordings), `recordings` (where inputs step; those read where they are),
`records` (with inputs, signals and times), `windows` (local polynomials along them),
`coordinates` and `features` (columns made of columns).
"""
