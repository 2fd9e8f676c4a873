"""Parts of the search for effects."""
