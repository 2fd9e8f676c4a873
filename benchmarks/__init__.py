"""The scripts behind the numbers of the documentation, run from the root of the repository.

A folder is a benchmark: ``python -m benchmarks.quality --fast``. Shared are `results` (what is kept
of a run, and where it was measured), `records` (cells of a run that resumes), `goals`, `markdown`
and `pages` (the documentation's tables, made from the kept results and nothing else).
"""
