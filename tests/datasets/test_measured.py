"""Measured data: each file is parsed into what its physics says, and EMPS gives its friction."""

import hashlib

import numpy as np
import pandas as pd
import pytest

from swsysid._cli.job import JobOptions, run_job
from swsysid._cli.measurement import Measurement
from swsysid._tables.table import Table
from swsysid._verdict.comparison import Verdict
from swsysid.datasets import _measured
from swsysid.datasets._sources import SOURCES, MeasuredDataError, Source, locate
from swsysid.differentiation import differentiate

pytestmark = pytest.mark.filterwarnings("error")


# --- finding the files ------------------------------------------------------------------------


@pytest.fixture
def source(tmp_path, monkeypatch):
    monkeypatch.setenv("SWSYSID_DATA", str(tmp_path))
    (tmp_path / "set").mkdir()
    (tmp_path / "set" / "file.csv").write_bytes(b"a,b\n1,2\n")
    digest = hashlib.sha256(b"a,b\n1,2\n").hexdigest()
    return Source("set/file.csv", "owner/name", "c0ffee", ("p/file.csv", "q/file.csv"), digest)


def test_a_local_copy_is_used_and_verified(source, tmp_path):
    assert locate(source) == tmp_path / "set" / "file.csv"
    (tmp_path / "set" / "file.csv").write_bytes(b"a,b\n1,3\n")
    with pytest.raises(MeasuredDataError, match="differs from the original"):
        locate(source)
    (tmp_path / "set" / "file.csv").unlink()
    with pytest.raises(MeasuredDataError, match="SWSYSID_DATA is set but its folder has no set"):
        locate(source)


def test_downloads_try_every_address_and_fail_in_one_sentence(source, monkeypatch, tmp_path):
    import pooch

    tried = []

    def retrieve(address, known_hash, fname, path):
        tried.append((address, known_hash))
        if address.endswith("p/file.csv"):
            raise OSError("404")
        return str(tmp_path / "set" / "file.csv")

    monkeypatch.delenv("SWSYSID_DATA")
    monkeypatch.setattr(pooch, "retrieve", retrieve)
    assert locate(source) == tmp_path / "set" / "file.csv"
    root = "https://raw.githubusercontent.com/owner/name/c0ffee/"
    assert [address for address, _ in tried] == [root + "p/file.csv", root + "q/file.csv"]
    assert {known for _, known in tried} == {f"sha256:{source.sha256}"}

    def offline(*args, **kwargs):
        raise OSError

    monkeypatch.setattr(pooch, "retrieve", offline)
    with pytest.raises(MeasuredDataError, match="connect to the internet, or set SWSYSID_DATA"):
        locate(source)


def test_every_source_is_pinned():
    assert len(SOURCES) == 12
    for source in SOURCES.values():
        assert len(source.sha256) == 64 and len(source.commit) == 40 and source.paths


# --- what the recordings hold -----------------------------------------------------------------


@pytest.mark.parametrize("name", _measured.__all__)
def test_recordings_are_complete_and_named(fetch_measured, name):
    data = fetch_measured(getattr(_measured, name))
    assert data.feature_names == [*data.state_names, *data.input_names] == list(data.units)
    assert "References" in data.DESCR
    recordings = [part for part in data.values() if isinstance(part, dict) and "x" in part]
    assert len(recordings) >= 2
    for part in recordings:
        n = len(part.t)
        assert part.x.shape == (n, 1) and part.inputs.shape == (n, len(data.input_names))
        assert part.groups.shape == (n,) and np.isfinite(part.x).all()
        assert all(signal.shape == (n,) for signal in part.signals.values())
        for group in np.unique(part.groups):
            assert (np.diff(part.t[part.groups == group]) > 0).all()


def test_the_tanks_overflow(fetch_measured):
    data = fetch_measured(_measured.fetch_cascaded_tanks)
    # the lower level clips at exactly 10 V: 49 and 42 samples near it
    for part, count in ((data.train, 49), (data.test, 42)):
        assert part.x.max() < 10.01 and (part.x >= 9.95).sum() == count


def test_the_damper_saturates_against_its_velocity(fetch_measured):
    data = fetch_measured(_measured.fetch_mr_damper)
    force, velocity = data.train.x[:, 0], data.train.inputs[:, 0]
    assert (len(data.train.t), len(data.test.t)) == (2000, 1499)
    assert 60 < abs(force).max() < 90 and abs(velocity).max() < 1.0  # N and m/s
    fast = abs(velocity) > 0.15
    assert np.mean(np.sign(force[fast]) == -np.sign(velocity[fast])) > 0.95


def test_the_drives_report_an_absolute_speed(fetch_measured):
    data = fetch_measured(_measured.fetch_ced_prbs)
    for part, size in ((data.train, 1.0), (data.amplitude_1_5, 1.5), (data.amplitude_0_5, 0.5)):
        assert part.x.min() >= 0
        np.testing.assert_allclose(np.abs(part.inputs), size)


def test_the_vehicle_stands_still_below_a_throttle(fetch_measured):
    data = fetch_measured(_measured.fetch_rc_vehicle)
    assert (len(data.train.t), len(data.test.t)) == (2439, 1626)
    speed, throttle = data.test.x[:, 0], data.test.inputs[:, 0]
    assert speed.min() == pytest.approx(-1.67, abs=0.01)  # it reverses
    assert np.corrcoef(speed, throttle)[0, 1] > 0.8


def test_the_silverbox_has_a_cubic_spring(fetch_measured):
    """Free run of a two-lag regression on the multisine: linear as published, cubic far better."""
    data = fetch_measured(_measured.fetch_silverbox)

    def terms(y1, y2, u0, u1, u2, degree):
        return [y1, y2, u0, u1, u2, 1.0, y1**2, y1**3][: 6 if degree == 1 else 8]

    def free_run(degree):
        y, u = data.train.x[:, 0], data.train.inputs[:, 0]
        columns = terms(y[1:-1], y[:-2], u[2:], u[1:-1], u[:-2], degree)
        design = np.column_stack(np.broadcast_arrays(*columns))
        coef = np.linalg.lstsq(design, y[2:], rcond=None)[0].tolist()
        y, u = data.test.x[:, 0].tolist(), data.test.inputs[:, 0].tolist()
        run = y[:50]  # initialise
        for k in range(50, len(y)):
            now = terms(run[k - 1], run[k - 2], u[k], u[k - 1], u[k - 2], degree)
            run.append(sum(c * term for c, term in zip(coef, now, strict=True)))
        return 1e3 * np.sqrt(np.mean((np.array(y) - run)[50:] ** 2))

    published = data.published["test_rmse_mV"]["linear"][0]
    assert free_run(1) == pytest.approx(published, rel=0.01)
    assert free_run(3) < 1.2


def test_the_thermostat_has_hysteresis(fetch_measured):
    data = fetch_measured(_measured.fetch_incubator)
    temperature, heater = data.thermostat.x[:, 0], data.thermostat.inputs[:, 1]
    turns = np.diff(heater)
    on, off = temperature[1:][turns > 0][1:], temperature[1:][turns < 0]
    # the first cycle heats up from the room; the nine others switch at the same two levels
    np.testing.assert_allclose(on[-9:], 35.9, atol=0.1)
    np.testing.assert_allclose(off[-9:], 38.1, atol=0.1)
    assert np.unique(data.test.groups).tolist() == [0, 1]


def test_emps_friction_by_least_squares_with_known_modes(fetch_measured):
    """What differentiation alone must deliver: the published parameters, sign(q') given."""
    data = fetch_measured(_measured.fetch_emps)
    published = data.published["asymmetric"]
    options = [
        {},
        {"decimate": 10},
        {"method": "butterworth"},
        {"method": "butterworth", "cutoff": 100.0},
    ]
    for chosen in options:
        train = data.train
        X, Xdot, *_ = differentiate(train.x, train.t, inputs=train.inputs, order=2, **chosen)
        velocity, force, acceleration = X[:, 1], X[:, 2], Xdot[:, 1]
        for k, sign in enumerate((1.0, -1.0)):
            rows = sign * velocity > 0
            design = np.column_stack([force, velocity, np.ones_like(force)])[rows]
            (gain, drag, offset), *_ = np.linalg.lstsq(design, acceleration[rows], rcond=None)
            found = [1 / gain, -drag / gain, -sign * offset / gain]
            expected = [published["M"], published["Fv"][k], published["Fc"][k]]
            np.testing.assert_allclose(found, expected, rtol=0.02, err_msg=str(chosen))


@pytest.mark.nightly
@pytest.mark.parametrize(("loss", "tolerance"), [("l1", 0.05), ("squared", 0.015)])
def test_emps_two_modes_find_the_friction_by_themselves(fetch_measured, loss, tolerance):
    """Force and position in; out come the surface q' = 0 and the published asymmetric friction."""
    data = fetch_measured(_measured.fetch_emps)
    train = data.train
    columns = {"q": train.x[:, 0], "force": train.inputs[:, 0], "t": train.t}
    table = Table("EMPS", columns, data.units | {"t": "s"})
    what = Measurement(states=("q",), inputs=("force",), time="t", order=2)
    result = run_job(table, JobOptions(what, loss=loss))

    model, X = result.model, result.samples.X
    names = list(result.samples.names)
    # the surface: its sides are the directions of motion
    forward = model.predict_modes(pd.DataFrame([[0.1, 0.05, 0.0]], columns=names))[0]
    moving = abs(X[:, 1]) > 1e-3
    agree = (model.predict_modes(pd.DataFrame(X, columns=names)) == forward) == (X[:, 1] > 0)
    assert agree[moving].mean() > 0.999
    assert agree.mean() > 0.99
    # the law: q'' = (force - Fv q' - Fc) / M in each mode, without the position
    assert [str(name) for name in model.feature_names_out_] == ["1", *names[1:]]
    published = data.published["asymmetric"]
    for k, (mode, sign) in enumerate(((forward, 1.0), (1 - forward, -1.0))):
        constant, drag, gain = model.coef_[mode, 1]
        found = [1 / gain, -drag / gain, -sign * constant / gain]
        expected = [published["M"], published["Fv"][k], published["Fc"][k]]
        np.testing.assert_allclose(found, expected, rtol=tolerance)
    # the known equation q' = velocity is found exactly, and one mode cannot do this
    np.testing.assert_allclose(model.coef_[:, 0], [[0, 1, 0]] * 2, atol=1e-6)
    compared = result.comparison
    switching, single = (
        np.square(e[:, 0]).mean() for e in (compared.errors, compared.rivals[0].errors)
    )
    assert np.sqrt(switching) < 0.25 * np.sqrt(single)
    assert compared.verdict is Verdict.SWITCHES
