"""Laws, states and instants by CasADi and IPOPT, which are told the mode of every sample."""

from __future__ import annotations

from math import prod
from time import process_time

import casadi as ca
import numpy as np

from benchmarks.speed.told import Array, Figures, Told, runge_kutta

__all__ = ["most_likely"]


def most_likely(told: Told) -> Figures:
    """Least squares of the samples, with a node at each and a step of Runge and Kutta between two.

    Where the mode changes, the instant is an unknown within its interval. Steps are SX functions,
    mapped over all intervals that have their modes in common. The Hessian is that of Gauss and
    Newton, which is constant; MUMPS solves.
    """
    begun = process_time()
    x, u, modes = (np.concatenate(one) for one in (told.x, told.u, told.modes))
    (n_rows, n_states), (n_modes, _, n_terms) = x.shape, told.laws.shape
    rows = np.delete(np.arange(n_rows), np.s_[told.x.shape[1] - 1 :: told.x.shape[1]])
    pairs = np.column_stack([modes[rows], modes[rows + 1]])
    stay, switch = _steps(told)

    nodes = ca.MX.sym("nodes", n_states, n_rows)
    laws = [ca.MX.sym("law", n_states, n_terms) for _ in range(n_modes)]
    shares = ca.MX.sym("shares", int((pairs[:, 0] != pairs[:, 1]).sum()))
    ties, n_switches = [], 0
    for mode, next_mode in np.unique(pairs, axis=0):
        here = rows[(pairs == [mode, next_mode]).all(axis=1)]
        ends = nodes[:, here.tolist()], ca.DM(u[here].T), ca.DM(u[here + 1].T)
        if mode == next_mode:  # the law, argument 3, is the same in all of them
            reached = stay.map("stays", "serial", len(here), [3], [])(*ends, laws[mode])
        else:
            own = shares[n_switches : n_switches + len(here)].T
            several = switch.map("switches", "serial", len(here), [3, 4], [])
            reached = several(*ends, laws[mode], laws[next_mode], own)
            n_switches += len(here)
        ties.append(ca.vec(nodes[:, (here + 1).tolist()] - reached))

    unknown = ca.vertcat(ca.vec(nodes), *map(ca.vec, laws), shares)
    misfit = (nodes - ca.DM(x.T)) / ca.DM(told.noise)
    problem = {"x": unknown, "f": ca.sumsqr(misfit) / 2, "g": ca.vertcat(*ties)}
    curvature = np.zeros(unknown.numel())
    curvature[: x.size] = np.tile(told.noise**-2, n_rows)
    scale, prices = ca.MX.sym("scale"), ca.MX.sym("prices", problem["g"].numel())
    gauss_newton = ca.Function(
        "gauss_newton",
        [unknown, ca.MX(0, 1), scale, prices],
        [scale * ca.sparsify(ca.diag(ca.DM(curvature)))],
        ["x", "p", "lam_f", "lam_g"],
        ["triu_hess_gamma_x_x"],
    )
    ipopt = {"linear_solver": "mumps", "print_level": 0, "sb": "yes", "max_iter": 200}
    options = {"ipopt": ipopt, "print_time": False, "hess_lag": gauss_newton}
    solver = ca.nlpsol("solver", "ipopt", problem, options)
    start = np.concatenate([x.ravel(), *_differences(told), np.full(n_switches, 0.5)])
    within = np.concatenate([np.full(len(start) - n_switches, np.inf), np.ones(n_switches)])
    built = process_time()
    found = solver(x0=start, lbx=np.where(np.isinf(within), -np.inf, 0), ubx=within, lbg=0, ubg=0)
    solved = process_time()
    if not solver.stats()["success"]:
        raise RuntimeError(f"IPOPT ended with {solver.stats()['return_status']}.")
    coef = np.array(found["x"]).ravel()[x.size : len(start) - n_switches]
    error = told.error(coef.reshape(n_modes, n_terms, n_states).swapaxes(1, 2))
    return {"building": built - begun, "running": solved - built, "laws": error}


def _steps(told: Told) -> tuple[ca.Function, ca.Function]:
    """An interval with one law, and one with two, the first of which acts for a share of it."""
    _, n_states, n_terms = told.laws.shape
    x, before, after = (ca.SX.sym("x", n) for n in (n_states, *2 * [told.u.shape[2]]))
    law, next_law = (ca.SX.sym("law", n_states, n_terms) for _ in range(2))
    share = ca.SX.sym("share")

    def flow(law, x, before, after, step):
        def velocity(x, u):
            columns = ca.vertcat(x, u)
            powers = [np.repeat(np.arange(len(term)), term) for term in told.library.powers_]
            return law @ ca.vertcat(*[prod(columns[int(k)] for k in term) for term in powers])

        return runge_kutta(velocity, x, before, after, step)

    between = before + share * (after - before)
    switched = flow(law, x, before, between, share * told.step)
    there = flow(next_law, switched, between, after, (1 - share) * told.step)
    stay = ca.Function("stay", [x, before, after, law], [flow(law, x, before, after, told.step)])
    return stay, ca.Function("switch", [x, before, after, law, next_law, share], [there])


def _differences(told: Told) -> list[Array]:
    """Laws (terms by states, in a row) of least squares of differences, mode by mode."""
    middle = (told.terms[:, 1:] + told.terms[:, :-1]) / 2
    velocities = np.diff(told.x, axis=1) / told.step
    found = []
    for mode in range(len(told.laws)):
        stays = (told.modes[:, 1:] == mode) & (told.modes[:, :-1] == mode)
        found.append(np.linalg.lstsq(middle[stays], velocities[stays])[0].ravel())
    return found
