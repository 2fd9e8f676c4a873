"""How the command line refuses: one sentence that says what to do instead."""

__all__ = ["TableError"]


class TableError(ValueError):
    """A file cannot be read or a column cannot be used; the message says which and why."""
