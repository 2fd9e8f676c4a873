"""Rows in memory, in files and in blocks; samples of them; records; the feature map Phi."""
