# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Logs that are damaged or misunderstood: one line each, and what can be used is used."""

import numpy as np
import pytest
from cli.running import run

import hmcvt_core as hmcvt
import hmcvt_tools
from studies.road.bus import EPOCH, MAKER, Encoded, Faults, encode, write_trace
from studies.road.drive import drive, machine_of
from studies.road.scoring import well_known

from . import recordings

pytest.importorskip("can")
pytest.importorskip("cantools")

SOUND = Faults(0.0, (0.0, 0.0, 0.0, 0.0))
TRACTOR = ("--params", hmcvt.data_path("params/tractor.yaml"))
EEC1 = 0x0CF00400
ETC1 = 0x0CF00203


@pytest.fixture(scope="module")
def messages():
    rng = np.random.default_rng(3)
    machine = machine_of(well_known(), rng)
    return encode(drive(machine, 30.0, rng), machine, SOUND, True)


def only(messages, keep):
    """Messages with the rows that a function keeps."""
    kept = []
    for message in messages:
        rows = keep(message)
        kept.append(Encoded(message.time[rows], message.identifier, message.data[rows]))
    return kept


def estimated(folder, messages, suffix="log", **options):
    path = folder / f"drive.{suffix}"
    write_trace(path, messages)
    model = hmcvt.load_model(hmcvt.data_path("params/tractor.yaml"))
    return hmcvt_tools.estimate(path, model, **options)


def test_sound(tmp_path, messages):
    result = estimated(tmp_path, messages)
    assert result.totals.coverage > 0.97
    assert not [note for note in result.notes if "gaps" in note or "bus" in note]


def test_codes_for_no_value_are_no_numbers(tmp_path, messages):
    def coded(message):
        data = message.data.copy()
        if message.identifier == EEC1:
            data[(message.time > 10.0) & (message.time < 12.0), 3:5] = [0xFF, 0xFF]
            data[(message.time > 20.0) & (message.time < 21.0), 2] = 0xFE
        return Encoded(message.time, message.identifier, data)

    result = estimated(tmp_path, list(map(coded, messages)))
    lines = "\n".join(result.notes)
    start = EPOCH + 10.0
    assert f"J1939.EngineSpeed from {start:.3f} s: 100 readings" in lines
    assert "'not available'" in lines
    assert "J1939.EngineActualTorque" in lines and "readings 'error'" in lines
    assert result.totals.seconds < 28.5
    assert result.totals.without["no engine torque"] == pytest.approx(1.0, abs=0.2)


def test_bus_off_and_gap(tmp_path, messages):
    off = only(messages, lambda m: (m.time < 8.0) | (m.time > 11.0))
    result = estimated(tmp_path, off)
    (line,) = [note for note in result.notes if note.startswith("bus")]
    assert f"from {EPOCH + 7.987:.3f} s" in line and "no frame for 3.0 s" in line
    gap = only(
        messages,
        lambda m: (m.identifier != ETC1) | (m.time < 15.0) | (m.time > 17.0),
    )
    result = estimated(tmp_path, gap)
    assert any(
        note.startswith("J1939.OutputShaftSpeed") and "1 gaps" in note
        for note in result.notes
    )
    assert result.totals.without["no output speed"] == pytest.approx(2.0, abs=0.3)


def test_duplicates_change_nothing(tmp_path, messages):
    sound = estimated(tmp_path, messages).to_dict()
    twice = [m for m in messages for _ in range(2)]
    result = estimated(tmp_path, twice)
    assert result.to_dict()["energy"] == pytest.approx(sound["energy"])
    assert any("at a repeated time" in note for note in result.notes)


def test_two_senders(tmp_path, messages):
    other = [
        Encoded(m.time + 0.001, m.identifier | 0x21, np.full_like(m.data, 7))
        for m in messages
        if m.identifier == EEC1
    ]
    sound = estimated(tmp_path, messages).to_dict()
    result = estimated(tmp_path, [*messages, *other])
    assert any("addresses 0, 33: that of 0 is read" in note for note in result.notes)
    assert result.to_dict()["energy"] == pytest.approx(sound["energy"], rel=1e-3)


@pytest.mark.parametrize("suffix", ["log", "blf", "asc", "trc"])
def test_cut_off(tmp_path, messages, suffix):
    whole = estimated(tmp_path, messages, suffix)
    path = tmp_path / f"drive.{suffix}"
    content = path.read_bytes()
    path.write_bytes(content[: int(0.6 * len(content)) - 25])
    model = hmcvt.load_model(hmcvt.data_path("params/tractor.yaml"))
    result = hmcvt_tools.estimate(path, model)
    assert 0.0 < result.totals.seconds < 0.8 * whole.totals.seconds
    lines = [note for note in result.notes if note.startswith("file")]
    assert lines and "cut off" in lines[-1] and " s: " in lines[-1]


def test_swapped_byte_order(tmp_path):
    """The values of a wrong DBC are impossible, or jump as no shaft does."""
    time, columns = recordings.recorded()
    recordings.write_can(tmp_path / "bench.log", time, columns)
    swapped = recordings.DBC.replace("EngineSpeed : 0|16@1+", "EngineSpeed : 7|16@0+")
    (tmp_path / "swapped.dbc").write_text(swapped)
    done = run(
        *("import", tmp_path / "bench.log", "--dbc", tmp_path / "swapped.dbc"),
        *("--out", tmp_path / "out.csv", "--yes"),
    )
    assert done.code == 2
    assert "SHAFTS.EngineSpeed" in done.err and "byte order" in done.err
    assert " s: " in done.err and done.err.count("\n") == 1


@pytest.mark.parametrize("command", ["import", "estimate"])
def test_a_dbc_of_another_machine_is_refused(tmp_path, messages, command):
    """The bus can be read without it, so that its absence would not show."""
    write_trace(tmp_path / "drive.log", messages)
    foreign = MAKER.replace(str(0x98FF1003), str(0x98FF2703))
    (tmp_path / "foreign.dbc").write_text(foreign)
    arguments = (command, tmp_path / "drive.log", "--dbc", tmp_path / "foreign.dbc")
    rest = TRACTOR if command == "estimate" else ("--out", tmp_path / "out.csv")
    done = run(*arguments, *rest)
    assert done.code == 2
    assert "foreign.dbc is on the bus (" in done.err
    assert "is it that of this machine?" in done.err


def test_a_bus_of_which_no_message_is_known(tmp_path):
    path = tmp_path / "car.log"
    path.write_text("(0.000000) can0 123#0102030405060708\n" * 20)
    done = run("import", path, "--out", tmp_path / "o.csv")
    assert done.code == 2
    assert "add the signals of the bus by --dbc FILE" in done.err


def test_a_dbc_without_the_signal(tmp_path):
    time, columns = recordings.recorded()
    recordings.write_can(tmp_path / "bench.log", time, columns)
    without = "\n".join(
        line for line in recordings.DBC.splitlines() if "OutputTorque" not in line
    )
    (tmp_path / "less.dbc").write_text(without)
    arguments = ("import", tmp_path / "bench.log", "--dbc", tmp_path / "less.dbc")
    done = run(*arguments, "--out", tmp_path / "out.csv", "--yes")
    assert done.code == 2
    assert "load_torque" in done.err and "SHAFTS.EngineTorque" in done.err
    named = ("--output-torque", "SHAFTS.OutputTorque:Nm")
    done = run(*arguments, "--out", tmp_path / "out.csv", *named)
    assert done.code == 2
    assert "channel 'SHAFTS.OutputTorque' is missing" in done.err


def test_a_message_that_is_not_on_the_bus(tmp_path, messages):
    without = [m for m in messages if m.identifier != ETC1]
    with pytest.raises(hmcvt.InputError, match="output_speed"):
        estimated(tmp_path, without)
    channels = {"output_speed": "J1939.OutputShaftSpeed"}
    with pytest.raises(hmcvt.InputError, match="no frame of message ETC1"):
        estimated(tmp_path, without, channels=channels)


def test_reference_and_friction_are_asked(tmp_path, messages):
    eec3 = [m for m in messages if m.identifier != 0x18FEDF00]
    with pytest.raises(hmcvt.InputError, match="--friction-torque"):
        estimated(tmp_path, eec3)
    ec1 = [m for m in messages if m.identifier not in (0x1CECFF00, 0x1CEBFF00)]
    with pytest.raises(hmcvt.InputError, match="--reference-torque"):
        estimated(tmp_path, ec1)
    stated = {"reference_torque": 800.0, "friction_torque": 0.08}
    assert estimated(tmp_path, eec3, **stated).totals.coverage > 0.9


def test_a_friction_that_is_never_available_is_asked(tmp_path, messages):
    missing = []
    for message in messages:
        if message.identifier == 0x18FEDF00:
            data = np.full_like(message.data, 0xFF)
            message = Encoded(message.time, message.identifier, data)
        missing.append(message)
    advice = "'not available' all the time .* add --friction-torque"
    with pytest.raises(hmcvt.InputError, match=advice):
        estimated(tmp_path, missing)
    stated = {"reference_torque": 800.0, "friction_torque": 0.08}
    assert estimated(tmp_path, missing, **stated).totals.coverage > 0.9


def test_stages_by_another_name(tmp_path, messages):
    (tmp_path / "maker.dbc").write_text(MAKER.replace('"HM', '"Range'))
    path = tmp_path / "drive.log"
    write_trace(path, messages)
    arguments = ("estimate", path, "--dbc", tmp_path / "maker.dbc", *TRACTOR)
    done = run(*arguments)
    assert done.code == 2 and "--stage-names" in done.err
    names = "H0=H0,Range1=HM1,Range2=HM2,Range3=HM3,Range4=HM4"
    done = run(*arguments, "--stage-names", names)
    assert done.code == 0, done.err


def test_a_take_off_is_not_counted(tmp_path, messages):
    at = np.arange(0.1, 29.0, 0.1)
    data = np.full((len(at), 8), 0xFF, dtype=np.uint8)
    raw = np.where((at > 10.0) & (at < 20.0), 540.0 / 0.125, 0.0).astype(np.uint16)
    data[:, 0] = raw & 0xFF
    data[:, 1] = raw >> 8
    result = estimated(tmp_path, [*messages, Encoded(at, 0x18FE4326, data)])
    assert result.totals.without["the power take-off turns"] == pytest.approx(
        10.0, abs=0.5
    )


def test_an_empty_channel(tmp_path):
    pytest.importorskip("asammdf")
    time, columns = recordings.recorded()
    empty = {**columns, "M_output": np.full(len(time), np.nan)}
    recordings.write_mdf(tmp_path / "empty.mf4", time, empty)
    done = run("import", tmp_path / "empty.mf4", "--out", tmp_path / "o.csv", "--yes")
    assert done.code == 2 and "load_torque" in done.err
    named = ("--output-torque", "M_output:Nm")
    done = run("import", tmp_path / "empty.mf4", "--out", tmp_path / "o.csv", *named)
    assert done.code == 2 and "channel 'M_output' is empty" in done.err


def test_a_cut_off_mdf_and_tdms(tmp_path):
    pytest.importorskip("asammdf")
    pytest.importorskip("nptdms")
    time, columns = recordings.recorded()
    recordings.write_mdf(tmp_path / "cut.mf4", time, columns)
    recordings.write_tdms(tmp_path / "cut.tdms", time, columns)
    for name in ("cut.mf4", "cut.tdms"):
        path = tmp_path / name
        content = path.read_bytes()
        path.write_bytes(content[: int(0.7 * len(content))])
        done = run("import", path, "--out", tmp_path / "o.csv", "--yes")
        assert done.code in (0, 2)
        text = done.out + done.err
        assert name in text and "Traceback" not in text
        assert "cut off" in text or "no MDF file that asammdf can read" in text
        assert "ignored" not in text


@pytest.mark.parametrize("name", ["none.mf4", "none.tdms", "none.blf", "none.asc"])
def test_no_log_at_all(tmp_path, name):
    for content in (b"", b"something else entirely\n" * 20):
        (tmp_path / name).write_bytes(content)
        done = run("estimate", tmp_path / name, *TRACTOR)
        assert done.code == 2
        assert name in done.err and done.err.count("\n") == 1
