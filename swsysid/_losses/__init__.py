"""The losses of a residual, the program each leads to, and what many rows say about them."""
