"""Which constants of the search for effects matter."""
