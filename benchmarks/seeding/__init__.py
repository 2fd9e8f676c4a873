"""What the start of an identification decides."""
