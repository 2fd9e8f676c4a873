"""The paper's systems: our figures, the paper's algorithm to the letter, tables and pictures."""
