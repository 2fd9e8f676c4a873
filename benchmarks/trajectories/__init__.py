"""From noisy recordings, without velocities, to the right modes: plants, oracles, figures."""
