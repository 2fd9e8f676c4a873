"""Tables of recordings, from the files that loggers write."""
