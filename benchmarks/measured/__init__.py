"""Measured data: free runs before and after the effect that a first model lacks."""
