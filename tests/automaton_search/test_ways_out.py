"""Ways out of a mode that are taken one after the other at one sample, and their order."""

import numpy as np

from swsysid import HybridAutomatonRegressor


def recordings():
    """Two heaters, one at a time: off, then the other one at once if its room is cold.

    The edges of a mode are taken one after the other at one sample, as DAINARX's generator does.
    """
    found = []
    for start in ([18.0, 21.5], [21.0, 17.0], [19.5, 19.0], [22.5, 20.5], [17.5, 18.0]):
        x, mode, rows = np.array(start), 0, []
        for _ in range(400):
            rows.append(x)
            if mode and x[mode - 1] >= 23.0:
                mode = 0
            if mode == 0:
                mode = 1 if x[0] <= 18.0 else 2 if x[1] <= 17.0 else 0
            x = 0.997 * x + (0.35, 0.4)[mode - 1] * (np.arange(2) == mode - 1) * bool(mode)
        found.append({"x": np.array(rows), "t": np.arange(400)})
    return found


def test_what_is_left_for_another_mode_at_once_has_the_guards_of_both():
    runs = recordings()
    found = HybridAutomatonRegressor(discrete_time=True, random_state=0).fit(runs)
    assert found.n_modes_ == 3
    off = int(np.flatnonzero((np.abs(found.coef_[:, :, 0]) < 1e-9).all(axis=1))[0])
    guards = {(one.source, one.target): one.guard for one in found.transitions_}
    at_once = [pair for pair in guards if off not in pair]
    assert at_once
    for source, target in at_once:
        first, second = guards[source, target].conditions
        np.testing.assert_array_equal(first.coef, guards[source, off].conditions[0].coef)
        np.testing.assert_array_equal(second.coef, guards[off, target].conditions[0].coef)
        # it is asked before the way out that holds wherever it does
        order = [one.target for one in found.transitions_ if one.source == source]
        assert order.index(target) < order.index(off)
    modes = np.split(found.modes_, len(runs))
    for one, own in zip(runs, modes, strict=True):  # every switch at its sample
        done = found.simulate(one["x"][0], one["t"], mode=int(own[0]))
        np.testing.assert_array_equal(done.modes[:-1], own[:-1])
        np.testing.assert_allclose(done.x, one["x"], atol=1e-9)
