"""Starts of the alternation: mixtures of experts with a gate, level sets, neighbourhood laws."""
