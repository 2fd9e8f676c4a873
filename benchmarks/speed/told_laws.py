"""Modes by dynamax, which is told the true laws and how often modes change."""

from __future__ import annotations

from collections.abc import Callable
from time import process_time

import jax
import jax.numpy as jnp
import numpy as np
from dynamax.hidden_markov_model import hmm_smoother
from dynamax.slds import DiscreteParamsSLDS, LGParamsSLDS, ParamsSLDS, rbpfilter_optimal
from jax.scipy.stats import multivariate_normal
from scipy.linalg import expm

from benchmarks.speed.told import Array, Figures, Told, runge_kutta

__all__ = ["hidden_markov", "particles"]

# On the linear oscillator and the contact a hundred particles were no better, and more process
# noise (.1 and .3 of that of the samples) worse.
N_PARTICLES = 10
PROCESS_NOISE = 0.03

jax.config.update("jax_enable_x64", True)


def particles(told: Told) -> Figures:
    """By the Rao-Blackwellised particle filter of switching linear systems."""
    (n_modes, n_states, _), n_inputs = told.laws.shape, told.u.shape[2]
    # the state, 1, the inputs and their slopes go over a step by one matrix exponential
    of_inputs = n_states + 1 + np.arange(n_inputs)
    system = np.zeros((n_modes, *2 * [n_states + 1 + 2 * n_inputs]))
    system[:, :n_states, [n_states, *range(n_states), *of_inputs]] = told.laws
    system[:, of_inputs, of_inputs + n_inputs] = 1.0
    steps = expm(told.step * system)[:, :n_states]
    transition, offset, effect = np.split(steps, [n_states, n_states + 1], axis=2)
    slopes = np.diff(told.u, axis=1) / told.step
    noise, identity = np.diag(told.noise**2), np.eye(n_states)
    chances = DiscreteParamsSLDS(np.full(n_modes, 1 / n_modes), told.changes, told.changes)

    def probabilities(x, inputs, key):
        linear = LGParamsSLDS(
            initial_mean=x[0],
            initial_cov=noise,
            dynamics_weights=transition,
            dynamics_cov=PROCESS_NOISE**2 * noise,
            dynamics_bias=offset[..., 0],
            dynamics_input_weights=effect,
            emission_weights=identity,
            emission_cov=noise,
            emission_bias=None,
            emission_input_weights=None,
        )
        params = ParamsSLDS(chances, linear).initialize(
            n_modes, n_states, n_states, inputs.shape[1]
        )
        params = jax.tree.map(jnp.asarray, params)
        found = rbpfilter_optimal(N_PARTICLES, params, x[1:], key, inputs)
        own = found["states"][..., None] == jnp.arange(n_modes)
        return (found["weights"][..., None] * own).sum(axis=1)

    keys = jax.random.split(jax.random.PRNGKey(told.seed), len(told.x))
    inputs = np.concatenate([told.u[:, :-1], slopes], axis=2)
    return _decoded(told, probabilities, told.x, inputs, keys)


def hidden_markov(told: Told) -> Figures:
    """By the hidden Markov model: its likelihoods are what each law says of the next sample."""
    powers, noise = told.library.powers_, np.diag(told.noise**2)
    start = jnp.full(len(told.laws), 1 / len(told.laws))

    def likelihood(law, x, after, u, u_after):
        def velocity(x, u):
            return law @ (jnp.concatenate([x, u]) ** powers).prod(axis=1)

        def flow(x):
            return runge_kutta(velocity, x, u, u_after, told.step)

        tangent = jax.jacfwd(flow)(x)
        covariance = noise + tangent @ noise @ tangent.T
        return multivariate_normal.logpdf(after, flow(x), covariance)

    of_modes = jax.vmap(likelihood, in_axes=(0, None, None, None, None))
    of_intervals = jax.vmap(of_modes, in_axes=(None, 0, 0, 0, 0))

    def probabilities(x, u):
        likelihoods = of_intervals(told.laws, x[:-1], x[1:], u[:-1], u[1:])
        return hmm_smoother(start, jnp.asarray(told.changes), likelihoods).smoothed_probs

    return _decoded(told, probabilities, told.x, told.u)


def _decoded(told: Told, probabilities: Callable, *recordings: Array) -> Figures:
    """Compile for all recordings side by side, run, and compare the modes of the intervals."""
    begun = process_time()
    compiled = jax.jit(jax.vmap(probabilities)).lower(*recordings).compile()
    built = process_time()
    found = np.asarray(compiled(*recordings)).argmax(axis=2)
    ended = process_time()
    # within an interval in which the mode changes both are right
    right = (found == told.modes[:, :-1]) | (found == told.modes[:, 1:])
    return {"building": built - begun, "running": ended - built, "modes": float(right.mean())}
