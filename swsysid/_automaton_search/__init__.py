"""Identification of hybrid automata from recordings: stays, guards, resets."""
