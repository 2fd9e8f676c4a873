"""Measured public data sets, read from their original files.

Each ``fetch_*`` returns a `Bunch` of recordings. A recording has ``t``, the measured states
``x``, the ``inputs``, ``groups`` and further ``signals`` by name, ready for
``differentiate(r.x, r.t, r.groups, inputs=r.inputs)``.
"""

from __future__ import annotations

import inspect

import numpy as np
from sklearn.utils import Bunch

from swsysid._tables.readers import read_table
from swsysid.datasets._sources import SOURCES, locate

__all__ = [
    "fetch_cascaded_tanks",
    "fetch_ced_prbs",
    "fetch_emps",
    "fetch_incubator",
    "fetch_mr_damper",
    "fetch_rc_vehicle",
    "fetch_silverbox",
]


def fetch_emps() -> Bunch:
    """Positioning axis with dry friction: force and position, measured at 1 kHz.

    One prismatic axis (motor, ball screw, carriage) under position control, 24.84 s in each of
    two records; the second has force pulses added. The law is ``M q'' = force - Fv q' - Fc
    sign(q') - offset``: linear drives miss the Coulomb friction, which switches at q' = 0, and a
    worn screw makes friction asymmetric, which is a two-mode switching system with the surface
    q' = 0. The pulses also excite a flexibility that no rigid model has.

    Published parameters (least squares on the inverse model; ``published``): M 95.154 kg, and
    Fv 166.706 N s/m, Fc 20.144 N forward, Fv 240.424 N s/m, Fc 20.628 N backward; relative
    force error 3.11 %. Symmetric friction: M 95.109, Fv 203.503, Fc 20.394, 4.08 %.
    Open-loop free run on the test record (mm, arXiv 2405.10779): linear state space 5.53,
    polynomial NARX 5.17, best quoted there 2.64 (dynoNet).

    Train on the first record, test on the second; 20 test samples may initialise a free run.

    Returns
    -------
    Bunch
        ``train``, ``test``: x = position (m), inputs = force (N); signals ``q_ref_m`` and
        ``u_V``, in the test record also ``pulses`` (part of the force already).

    References
    ----------
    A. Janot, M. Gautier, M. Brunot, "Data set and reference models of EMPS", Workshop on
    Nonlinear System Identification Benchmarks, Eindhoven, 2019.
    """

    def recording(file):
        columns = _columns(f"emps/{file}")
        signals = {"q_ref_m": columns["qg"], "u_V": columns["vir"]}
        if "pulses_N" in columns:
            signals["pulses"] = columns["pulses_N"]
        force = 35.15065 * columns["vir"]  # gtau of the original files, N/V
        return _recording(columns["t"], columns["qm"], force, **signals)

    published = {
        "asymmetric": {"M": 95.1540, "Fv": (166.7061, 240.4236), "Fc": (20.1440, 20.6277)},
        "symmetric": {"M": 95.1089, "Fv": 203.5034, "Fc": 20.3935, "offset": -3.1648},
        "relative_force_error": {"asymmetric": 0.031117, "symmetric": 0.040834},
        "test_rmse_mm": {"linear": 5.53, "polynomial": 5.17, "readable": 5.17, "best": 2.64},
    }
    return _bunch(
        fetch_emps,
        {"q": "m", "force": "N"},
        published,
        train=recording("DATA_EMPS.mat"),
        test=recording("DATA_EMPS_PULSES.mat"),
    )


def fetch_mr_damper() -> Bunch:
    """Magneto-rheological damper on a shaker: a hysteretic force with two modes.

    Piston velocity and force, 3499 samples at 200 Hz, constant coil voltage 1.25 V. The force is
    a state that saturates against dry friction: Dahl's law ``F' = k (w - |w| F / L)`` with
    w = -v is a switching system with the surface v = 0 and features v and v F.

    Train on the first 2000 samples, test on the last 1499, free run. Measured here: first-order
    linear 28.3 N, Dahl with two modes and four parameters (k 52 kN/m, L 55 N) 10.2 N.

    Returns
    -------
    Bunch
        ``train``, ``test``: x = force (N), inputs = velocity (m/s).

    References
    ----------
    J. Wang, A. Sano, T. Chen, B. Huang, "Identification of Hammerstein systems without explicit
    parameterisation of non-linearity", Int. J. Control 82 (2009) 937-952.
    """
    columns = _columns("mr_damper/damper.mat")
    times = 0.005 * np.arange(len(columns["y"]))
    whole = _recording(times, columns["y"], columns["X"] / 100.0)  # cm/s in the file
    return _bunch(
        fetch_mr_damper,
        {"force": "N", "v": "m/s"},
        {"test_rmse_N": {"linear": 28.3, "two modes": 10.2}},
        train=_rows(whole, slice(None, 2000)),
        test=_rows(whole, slice(2000, None)),
    )


def fetch_cascaded_tanks() -> Bunch:
    """Two tanks in cascade that overflow; only the lower level is measured.

    Pump voltage and lower level (V, uncalibrated sensor), every 4 s, 1024 samples in each of two
    records. Torricelli's law for each tank misses what happens when a tank is full: the upper
    level saturates, part of its surplus falls into the lower tank, and the lower level clips at
    10 V. The upper switch acts on a hidden state; the lower one is visible in the data.

    Test error of a free run (V; ``published``, arXiv 2405.10779): linear 0.588, polynomial NARX
    0.413, best quoted there 0.191 (a grey-box model with a physical overflow, Worden and others).
    Measured here: Torricelli 0.617, with overflow 0.268.

    Returns
    -------
    Bunch
        ``train``, ``test``: x = lower level (V), inputs = pump voltage (V).

    References
    ----------
    M. Schoukens, P. Mattsson, T. Wigren, J.-P. Noel, "Cascaded tanks benchmark combining soft
    and hard nonlinearities", Workshop on Nonlinear System Identification Benchmarks, 2016.
    """
    columns = _columns("cascaded_tanks/dataBenchmark.csv")
    times = 4.0 * np.arange(len(columns["yEst"]))
    return _bunch(
        fetch_cascaded_tanks,
        {"level": "V", "pump": "V"},
        {"test_rmse_V": {"linear": 0.588, "polynomial": 0.413, "readable": 0.191, "best": 0.191}},
        train=_recording(times, columns["yEst"], columns["uEst"]),
        test=_recording(times, columns["yVal"], columns["uVal"]),
    )


def fetch_rc_vehicle() -> Bunch:
    """A 1:18 model vehicle driven by hand: speed under throttle, with dry friction.

    Commands and on-board state of 81 s, brought to a common grid of 50 Hz: commands held, states
    interpolated. Longitudinally ``v' = -a v + b throttle - friction``; below a throttle of about
    0.1 the vehicle does not move. Two explanations rival on these data: a power law of the
    throttle, ``sign(u) |u|^1.59``, as its authors tuned it, and Coulomb friction.

    Measured here, free run with 0.031 s of delay (m/s, train / test): linear 0.117 / 0.178, power
    law 0.054 / 0.111, linear with Coulomb friction 0.054 / 0.109, both 0.049 / 0.096.

    Returns
    -------
    Bunch
        ``train`` (the first 60 %), ``test``: x = speed (m/s), inputs = throttle, steering
        (-1 to 1); signals ``motor_current``, ``battery_V``, ``odometer_m``,
        ``acc_forward_m_per_s2``, ``yaw_rad``.

    References
    ----------
    M. Kloock et al., "Cyber-physical mobility lab: an open-source platform for networked and
    autonomous vehicles", European Control Conference, 2021. MIT licence.
    """
    command = _columns("rc_vehicle/vehicleCommand.csv")
    state = _columns("rc_vehicle/vehicleState.csv")
    start = command["Timestamp"][0]
    command_times, state_times = (1e-9 * (c["Timestamp"] - start) for c in (command, state))
    times = 0.02 * np.arange(10, 4075)  # from the first state to the last command
    # The command that was last sent by each time.
    held = np.searchsorted(command_times, times + 1e-9, side="right") - 1
    prefix = "data.direct_control."
    inputs = np.column_stack(
        [command[prefix + name][held] for name in ("motor_throttle", "steering_servo")]
    )
    names = {
        "speed": "speed",
        "motor_current": "motor_current",
        "battery_V": "battery_voltage",
        "odometer_m": "odometer_distance",
        "acc_forward_m_per_s2": "imu_acceleration_forward",
        "yaw_rad": "pose.yaw",
    }
    signals = {name: np.interp(times, state_times, state[key]) for name, key in names.items()}
    whole = _recording(times, signals.pop("speed"), inputs, **signals)
    split = int(0.6 * len(times))
    return _bunch(
        fetch_rc_vehicle,
        {"speed": "m/s", "throttle": "", "steering": ""},
        {},
        train=_rows(whole, slice(None, split)),
        test=_rows(whole, slice(split, None)),
    )


def fetch_silverbox() -> Bunch:
    """An electronic Duffing oscillator: a cubic spring and no switch.

    Input and output voltage of a circuit with ``m y'' + d y' + k1 y + k3 y^3 = u``, 131072
    samples at 610.35 Hz. Nothing switches: what is found here as a mode is a mistake.

    Test error of a free run (mV, multisine / arrow / arrow without extrapolation; ``published``,
    arXiv 2405.10779): linear 6.96 / 14.4 / 6.58, polynomial NARX 0.640 / 2.25 / 0.571, the
    smallest there 0.301 (GP-NARX) / 0.26 (polynomial state space) / 0.259 (GP-NARX).

    Returns
    -------
    Bunch
        ``train``, ``test`` (multisine), ``test_arrow_full``, ``test_arrow_no_extrapolation``:
        x = output (V), inputs = input (V). 50 samples initialise a free run.

    References
    ----------
    T. Wigren, J. Schoukens, "Three free data sets for development and benchmarking in nonlinear
    system identification", European Control Conference, 2013, 2933-2938.
    """
    columns = _columns("silverbox/SNLS80mV.mat")
    times = np.arange(len(columns["V1"])) * 2.0**14 / 1e7
    whole = _recording(times, columns["V2"], columns["V1"])
    errors = {
        "linear": (6.96, 14.4, 6.58),
        "polynomial": (0.640, 2.25, 0.571),
        "readable": (0.640, 0.26, 0.571),
        "best": (0.301, 0.26, 0.259),
    }
    return _bunch(
        fetch_silverbox,
        {"y": "V", "u": "V"},
        {"test_rmse_mV": errors},
        train=_rows(whole, slice(40650, 105712)),
        test=_rows(whole, slice(105712, 127400)),
        test_arrow_full=_rows(whole, slice(100, 40575)),
        test_arrow_no_extrapolation=_rows(whole, slice(100, 32100)),
    )


def fetch_incubator() -> Bunch:
    """A heated box under on/off control: a switch with memory.

    Box temperature (mean of two sensors), room temperature and heater of a polystyrene box,
    about every 3 s. First order, ``C T' = P heater - G (T - room)``; the heater's own heat
    capacity is a hidden state. In the thermostat record the heater goes on when the box falls
    to 35.9 degC and off when it rises to 38.1 degC: a switch with hysteresis, which no surface
    in the temperature alone can separate.

    Measured here on the thermostat record, free run (degC, train / test half): first order
    0.86 / 0.94, with the heater's temperature 0.49 / 0.38.

    Returns
    -------
    Bunch
        ``train`` (half-random heating), ``test`` (two on/off records, as groups 0 and 1),
        ``thermostat``: x = box temperature (degC), inputs = room temperature (degC), heater
        (0 or 1); signal ``fan``.

    References
    ----------
    H. Feng, C. Gomes, C. Thule, K. Lausdahl, M. Sandberg, P. G. Larsen, "The incubator case
    study for digital twin engineering", arXiv 2102.10390, 2021.
    """

    def recording(file, box=("t2", "t3"), room="t1", tick=1.0, group=0):
        columns = _columns(f"incubator/original/{file}.csv")
        times = tick * (columns["time"] - columns["time"][0])
        temperature = (columns[box[0]] + columns[box[1]]) / 2.0
        inputs = np.column_stack([columns[room], columns["heater_on"]])
        return _recording(times, temperature, inputs, group=group, fan=columns["fan_on"])

    on_off = "20201221_controller_tunning_exp"
    empty = "20230501_calibration_empty_system"
    return _bunch(
        fetch_incubator,
        {"T_box": "degC", "T_room": "degC", "heater": ""},
        {},
        train=recording("20200918_calibration_fan_24V_semi_random_movement"),
        test=_joined(recording(f"{on_off}1_ht3_hg2"), recording(f"{on_off}2_ht20_hg30", group=1)),
        # newer hardware: other sensor order, times in ns
        thermostat=recording(f"{empty}_{empty}", box=("t1", "t2"), room="t3", tick=1e-9),
    )


def fetch_ced_prbs() -> Bunch:
    """Two electric drives coupled by a belt; the sensor measures the absolute speed.

    Random binary voltage of three amplitudes, 500 samples at 50 Hz each. The output is ``|w|`` of a
    third-order linear system: the switch is on the sign of a speed that is not measured. The
    benchmark's published errors (the smallest in arXiv 2405.10779 are 0.096 and 0.074 ticks/s)
    belong to its other half, with uniformly distributed voltages, and do not compare.

    Measured here, fit on the first half, free run on the second (amplitude 1.0): linear 0.736,
    the standard deviation of the output; third-order linear with ``|w|`` 0.505.

    Returns
    -------
    Bunch
        ``train``, ``test`` (halves of the record of amplitude 1.0), ``amplitude_1_5``,
        ``amplitude_0_5``: x = absolute speed (ticks/s), inputs = voltage (V).

    References
    ----------
    T. Wigren, M. Schoukens, "Coupled electric drives data set and reference models", Uppsala
    University, technical report 2017-024.
    """
    columns = _columns("ced_prbs/drive.mat")
    times = 0.02 * np.arange(len(columns["z1"]))
    records = [_recording(times, columns[f"z{k}"], columns[f"u{k}"]) for k in (1, 2, 3)]
    return _bunch(
        fetch_ced_prbs,
        {"abs_speed": "ticks/s", "u": "V"},
        {},
        train=_rows(records[0], slice(None, 250)),
        test=_rows(records[0], slice(250, None)),
        amplitude_1_5=records[1],
        amplitude_0_5=records[2],
    )


def _columns(file: str):
    return read_table(locate(SOURCES[file])).columns


def _recording(t, x, inputs, group=0, **signals) -> Bunch:
    return Bunch(
        t=t,
        x=np.reshape(x, (len(t), -1)),
        inputs=np.reshape(inputs, (len(t), -1)),
        groups=np.full(len(t), group),
        signals=signals,
    )


def _rows(recording: Bunch, rows: slice) -> Bunch:
    return _mapped(lambda values: values[rows], recording)


def _joined(*recordings: Bunch) -> Bunch:
    return _mapped(lambda *values: np.concatenate(values), *recordings)


def _mapped(operator, *recordings: Bunch) -> Bunch:
    """A recording of which every array is made from those of the given ones."""
    arrays = {
        name: operator(*(recording[name] for recording in recordings))
        for name in recordings[0]
        if name != "signals"
    }
    if "signals" in recordings[0]:
        arrays["signals"] = dict(_mapped(operator, *(one.signals for one in recordings)))
    return Bunch(**arrays)


def _bunch(function, units, published, **recordings) -> Bunch:
    """Recordings with names (the state first), units and the function's docstring."""
    names = list(units)
    return Bunch(
        **recordings,
        feature_names=names,
        state_names=names[:1],
        input_names=names[1:],
        units=units,
        published=published,
        DESCR=inspect.getdoc(function),
    )
