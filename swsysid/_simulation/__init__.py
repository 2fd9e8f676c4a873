"""A fitted switching system and its rollouts: events, sliding, inputs, effects with memory."""
