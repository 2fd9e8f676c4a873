"""The judge of what stays: a row on the surface, whose mode nobody knows, decides nothing."""

import numpy as np

from benchmarks.undeclared.fresh import Drawn
from swsysid import EffectSearchCV


def test_two_rows_on_the_surface_are_no_veto():
    # 572 rows; with the right shape two of those held out, which are as likely in either mode, are
    # on the wrong side, where the error is twenty times the noise
    data = Drawn.of(5031).record()
    search = EffectSearchCV(data.estimator).fit(data.X, data.Xdot, t=data.t, groups=data.groups)
    (effect,) = search.effects_
    assert effect.kind == "unknown_function" and effect.placed.place == 0
    assert "of 190 rows, whose mode is not sure" in search.report_.summary
    test = data.test
    declared, found = (
        np.sqrt(np.mean((predicted - test.Xdot_clean)[:, 1] ** 2))
        for predicted in (
            search.report_.data.models[0].predict(test.X, t=test.t, groups=test.groups),
            search.predict(test.X, t=test.t, groups=test.groups),
        )
    )
    # measured: .007 of .098
    assert found < 0.2 * declared


def test_what_is_refused_does_not_come_back():
    # 653 rows: a shape in one mode beside a sine in the other, by which the largest errors rise.
    # Without the shape the modes change their numbers; the sine was refused by that of another
    # mode, and came back without end.
    data = Drawn.of(8024).record()
    search = EffectSearchCV(data.estimator).fit(data.X, data.Xdot, t=data.t, groups=data.groups)
    assert search.effects_ == []
    tried = [one["effect"] for one in search.report_.tried]
    assert len(tried) == len(set(tried)) > 0
