"""Automata that others published, read from their own files, and how well they are found.

`dainarx` reads descriptions from a folder that the user has and makes their recordings, `scoring`
turns a method into figures, `ours` is the package's. No description is kept here.
"""
