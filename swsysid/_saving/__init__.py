"""Fitted models as text: what may be in a file, and how it is written and read."""
