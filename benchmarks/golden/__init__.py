"""The golden set: answers that were frozen before the engine is rebuilt, and how new ones compare.

One command runs the cells of a kind and compares each record with the one frozen for it:

    python -m benchmarks.golden --compare benchmarks/golden/frozen

Data come in as the plants and records of the other benchmark rooms, on seeds that nobody has looked
at, and measured sets; out comes a table, a line a kind, and every record that got worse or better.

Freezing takes about an hour of CPU time, comparing with the engine of that day the same; what costs
most is left out, as each file says. A record that is not frozen is told as new and not judged.
Automata in noise are frozen since 62c7c56, as they were found then, wrong ones too.

- `record.py`: what is kept of an answer, estimates with their standard errors above all.
- `recordings.py`, `automata.py`, `regressor.py`, `searches.py`, `measured.py`, `models.py`: the
  cells of each kind and how one is run; `kinds.py` lists them.
- `files.py`: a file a kind, a record a line.
- `comparison.py`: whether a record is equal, worse or better; `tables.py`: what is printed.
"""
