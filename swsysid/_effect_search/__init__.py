"""The search for effects that a model lacks, and its report: text, pictures and page."""
