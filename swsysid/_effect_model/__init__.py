"""A declared switching model with effects beside it: its fit, its equations, its rollouts."""
