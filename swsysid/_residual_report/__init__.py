"""What a fitted model leaves over, and what the leftover depends on."""
