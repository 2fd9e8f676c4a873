"""Polynomial surfaces between modes: their bases, the margin program and what it certifies."""
