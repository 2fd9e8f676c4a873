"""Recordings as a laboratory makes them, of five rigs whose declared laws lack something."""
