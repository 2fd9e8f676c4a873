"""A hybrid automaton integrated with SciPy's terminal events: what ours is held to."""

from dataclasses import dataclass, field

import numpy as np
from scipy.integrate import solve_ivp


@dataclass
class ReferenceRun:
    """States and modes at the requested times, and the instants of the transitions."""

    x: list = field(default_factory=list)
    modes: list = field(default_factory=list)
    events: list = field(default_factory=list)


def integrate_events(fields, transitions, mode, x0, t, max_step=np.inf):
    """Roll an automaton out from event to event.

    `fields` are functions (t, x), one a mode; `transitions` are (source, target, guard, reset) with
    functions guard(t, x, entered), which rises to zero, and reset(x). A row at an instant has the
    state after it.
    """
    run, x, now, entered = ReferenceRun(), np.asarray(x0, float), t[0], t[0]
    run.x.append(x)
    run.modes.append(mode)
    while now < t[-1]:
        leaving = [one for one in transitions if one[0] == mode]
        events = [_terminal(guard, entered) for _, _, guard, _ in leaving]
        done = solve_ivp(
            fields[mode],
            (now, t[-1]),
            x,
            method="DOP853",
            rtol=1e-12,
            atol=1e-12,
            events=events,
            dense_output=True,
            max_step=max_step,
        )
        end = done.t[-1]
        inside = t[(t > now) & (t <= end)]
        run.x.extend(done.sol(inside).T if len(inside) else [])
        run.modes.extend([mode] * len(inside))
        x, now = done.y[:, -1], end
        if done.status:
            taken = next(k for k, times in enumerate(done.t_events) if len(times))
            _, target, _, reset = leaving[taken]
            run.events.append((end, mode, target))
            x, mode, entered = reset(x), target, end
            if end in inside:
                run.x[-1], run.modes[-1] = x, mode
    return run


def _terminal(guard, entered):
    def event(time, x):
        return guard(time, x, entered)

    event.terminal, event.direction = True, 1.0
    return event
