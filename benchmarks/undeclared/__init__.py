"""Planted effects: whether the search finds what a declared model lacks."""
