"""Pieces of self-contained HTML pages."""
