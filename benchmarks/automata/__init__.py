"""Hybrid automata of the literature: their truth, recordings, and how well they are found."""
