"""Hybrid automata: modes with laws, transitions with guards and resets, and all they can do."""
