"""How things are shown: formulas as text, pages, canvases, tables of signals, bars of progress."""
