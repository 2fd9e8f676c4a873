"""Rollouts of switching systems with located events."""
