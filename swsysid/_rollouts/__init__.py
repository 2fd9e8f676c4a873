"""Parts of `swsysid.refinement`: batched rollouts, multiple shooting, parameters as a vector."""
