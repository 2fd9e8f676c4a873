"""How things are shown: formulas as text, pages, canvases, tables of signals, bars of progress.

In reading order: `printing` (numbers, formulas, tables in text), `parts` (reports as mappings and
as HTML), `series` (signals as frames and pictures), `progress`.
"""
