"""Times become seconds where their unit is known or shows, and the answer says so."""

import numpy as np
import pytest

from swsysid._cli.measurement import Measurement
from swsysid._cli.samples import measure
from swsysid._cli.times import in_seconds
from swsysid._tables.table import Table

S = 0.01 * np.arange(300) + 1e-4 * np.random.default_rng(0).uniform(-1, 1, 300)
WHAT = Measurement(states=("x",), time="t")


def timed(times, name="t", unit=None):
    table = Table("log", {name: np.asarray(times), "x": np.sin(S)}, {})
    table = in_seconds(table, Measurement(states=("x",), time=name, time_unit=unit))
    return table.numbers([name])[:, 0], table.unit(name), table.remarks


@pytest.mark.parametrize(
    ("counts", "start", "unit"),
    [
        (1e6, 20_309_082, "us"),  # since a processor started
        (1e9, 5_000_000_000, "ns"),
        (1e9, 1_772_366_400_000_000_000, "ns"),  # since 1970
        (1e6, 1_772_366_400_000_000, "us"),
        (1e3, 1_772_366_400_000, "ms"),
    ],
)
def test_whole_numbers_of_a_clock_are_told_by_size_and_step(counts, start, unit):
    times = start + np.rint(counts * S).astype(np.int64)
    seconds, found, remarks = timed(times)
    np.testing.assert_allclose(seconds, S - S[0], atol=1.5 / counts)
    assert found == "s"
    assert f"taken in {unit} (--time-unit says otherwise)" in remarks[0]


def test_an_epoch_in_slow_microseconds_is_no_time_in_nanoseconds():
    seconds, _, remarks = timed(1_772_366_400_000_000 + 5_000_000 * np.arange(300))
    assert seconds[1] == pytest.approx(5.0) and "taken in us" in remarks[0]


@pytest.mark.parametrize("step", [1, 60, 900, 3600, 86400])
def test_slow_seconds_stay_what_they_are(step):
    times = step * np.arange(300.0)
    seconds, found, remarks = timed(times)
    np.testing.assert_array_equal(seconds, times)
    assert found == "" and not any("seconds since" in remark for remark in remarks)


def test_a_unit_that_is_known_or_said_wins():
    for name, unit in (("t_us", None), ("t [us]", None), ("t", "us")):
        seconds, found, remarks = timed(1e6 * S, name, unit)
        np.testing.assert_allclose(seconds, S - S[0], atol=1e-12)
        assert found == "s" and remarks[0].endswith("they become seconds since the first.")
    for name in ("ms", "millis", "elapsed_millis", "Time msec"):  # and steps of 10 tell nothing
        np.testing.assert_allclose(timed(10 * np.arange(300), name)[0], 0.01 * np.arange(300))
    seconds, found, remarks = timed(np.rint(1e6 * S), unit="s")
    assert (seconds[1], found, remarks) == (np.rint(1e6 * S)[1], "s", ())
    assert timed(S / 60.0, "t_min")[1:] == ("min", ())


def test_rates_are_a_second_and_infinities_count_as_clipped():
    values = np.sin(S)
    values[100:110] = np.inf
    table = Table("log", {"t": np.rint(1e6 * S), "x": values}, {})
    samples = measure(table, WHAT)
    assert samples.time_unit == "s"
    assert samples.Xdot.max() == pytest.approx(1.0, abs=0.05)  # cos t, not 1e-6 cos t
    assert any("Clipped: x 10 beyond the range of the sensor" in told for told in samples.remarks)
