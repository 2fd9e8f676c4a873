"""Automata as they are published, by field."""
