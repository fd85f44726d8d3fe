# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""One recording of a bench, written in many formats by the libraries that own them."""

import csv

import numpy as np

import hmcvt_core as hmcvt

RPM = np.pi / 30.0
RATE = 50.0
SECONDS = 10.0
POINTS = (
    (0.6, 150.0, 220.0),
    (-0.4, 120.0, 180.0),
    (0.1, 180.0, 260.0),
    (0.8, 140.0, 150.0),
    (-0.7, 160.0, 200.0),
)
DBC = """VERSION ""

NS_ :

BS_:

BU_: BENCH

BO_ 2566848769 SHAFTS: 8 BENCH
 SG_ EngineSpeed : 0|16@1+ (0.05,0) [0|3000] "rpm" BENCH
 SG_ OutputSpeed : 16|16@1+ (0.05,0) [0|3000] "rpm" BENCH
 SG_ EngineTorque : 32|16@1- (0.05,0) [-1600|1600] "Nm" BENCH
 SG_ OutputTorque : 48|16@1- (0.05,0) [-1600|1600] "Nm" BENCH

BO_ 2566849025 UNIT: 8 BENCH
 SG_ PumpStroke : 7|16@0- (0.01,0) [-110|110] "%" BENCH
 SG_ Stage : 16|8@1+ (1,0) [0|15] "" BENCH

VAL_ 2566849025 Stage 4 "HM4" 5 "HM5" ;
"""
SHAFTS = 0x18FF0101
UNIT = 0x18FF0201


def recorded(noise=0.002, seed=0):
    """Time, and the columns in the units of a bench."""
    model = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    rng = np.random.default_rng(seed)
    count = int(RATE * SECONDS)
    rows = []
    for stroke, speed, load in POINTS:
        output = float(model.output_speed(stroke, speed, load))
        efficiency = float(model.efficiency(stroke, speed, load))
        one = np.array(
            [
                speed / RPM,
                load / efficiency,
                output / RPM,
                load * speed / output,
                100.0 * stroke,
            ]
        )
        ripple = 1.0 + noise * rng.standard_normal((count, 5)) * [0.2, 1, 0.2, 1, 0]
        rows.append(one * ripple)
    time = np.arange(count * len(POINTS)) / RATE + 0.02
    names = ("n_engine", "M_engine", "n_output", "M_output", "PumpStroke")
    return time, dict(zip(names, np.concatenate(rows).T, strict=True))


UNITS = {
    "n_engine": "rpm",
    "M_engine": "Nm",
    "n_output": "rpm",
    "M_output": "Nm",
    "PumpStroke": "%",
}


def write_csv(path, time, columns):
    with open(path, "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["t [s]", *(f"{name} [{UNITS[name]}]" for name in columns)])
        for row in zip(time, *columns.values(), strict=True):
            writer.writerow([repr(float(cell)) for cell in row])


def write_mdf(path, time, columns, units=UNITS):
    import asammdf

    signals = [
        asammdf.Signal(values, time, name=name, unit=units.get(name, ""))
        for name, values in columns.items()
    ]
    mdf = asammdf.MDF(version="4.10")
    mdf.append(signals)
    mdf.save(path, overwrite=True)
    mdf.close()


def write_drive(path):
    """Engine, output and fuel of a tractor at three steady points, as MDF."""
    engine = hmcvt.load_engine(hmcvt.data_path("params/engine.yaml"))
    speed = np.repeat([150.0, 170.0, 190.0], 80)
    torque = np.repeat([300.0, 400.0, 350.0], 80)
    write_mdf(
        path,
        np.arange(len(speed)) * 0.1,
        {
            "EngineSpeed": speed / RPM,
            "EngineTorque": torque,
            "OutputShaftSpeed": 0.6 * speed / RPM,
            "FuelRate": 3600.0 * engine.fuel_rate(speed, torque),
        },
        {
            "EngineSpeed": "rpm",
            "EngineTorque": "Nm",
            "OutputShaftSpeed": "rpm",
            "FuelRate": "kg/h",
        },
    )


def write_tdms(path, time, columns, units=UNITS):
    from nptdms import ChannelObject, TdmsWriter

    step = float(np.median(np.diff(time)))
    with TdmsWriter(path) as writer:
        writer.write_segment(
            [
                ChannelObject(
                    "bench",
                    name,
                    values,
                    properties={
                        "unit_string": units[name],
                        "wf_increment": step,
                        "wf_start_offset": float(time[0]),
                    },
                )
                for name, values in columns.items()
            ]
        )


def frames(time, columns, epoch=1_700_000_000.0):
    """CAN messages of the recording by cantools, in order of time."""
    import can
    import cantools

    database = cantools.database.load_string(DBC, "dbc")
    shafts = database.get_message_by_name("SHAFTS")
    unit = database.get_message_by_name("UNIT")
    for row, now in enumerate(time):
        speeds = {
            "EngineSpeed": columns["n_engine"][row],
            "OutputSpeed": columns["n_output"][row],
            "EngineTorque": columns["M_engine"][row],
            "OutputTorque": columns["M_output"][row],
        }
        stroke = {"PumpStroke": columns["PumpStroke"][row], "Stage": 4}
        for identifier, message, values in (
            (SHAFTS, shafts, speeds),
            (UNIT, unit, stroke),
        ):
            yield can.Message(
                timestamp=epoch + now,
                arbitration_id=identifier,
                is_extended_id=True,
                data=message.encode(values, strict=False),
            )


def write_can(path, time, columns):
    import can

    with can.Logger(str(path)) as writer:
        for message in frames(time, columns):
            writer(message)


def write_dbc(path):
    path.write_text(DBC)
