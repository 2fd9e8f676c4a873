"""Plants with effects in them that the declared model lacks."""
