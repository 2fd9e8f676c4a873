"""Many systems, corruptions and methods: who finds the right modes."""
