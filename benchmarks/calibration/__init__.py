"""Calibration of the search for effects: what it finds where nothing is missing."""
