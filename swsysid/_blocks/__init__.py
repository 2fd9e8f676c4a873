"""Data in blocks of rows: where the rows come from, and a sample of them."""
