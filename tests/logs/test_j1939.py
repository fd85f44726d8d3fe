# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The public signals of J1939, on frames from elsewhere and on codes for no value."""

from pathlib import Path

import numpy as np
import pytest

from hmcvt_tools.logs.opening import open_log
from hmcvt_tools.logs.signals import group_number

# Frames of trucks with the values that other programs read by the Digital Annex: the public pages
# of pretty_j1939 and of SystemsCyber/CANDataDecoders show them.
PUBLIC = """(1543509533.001145) can0 0CF00400#207D87481400F087
(1543509533.001297) can0 18FEDF00#82FFFFFF7DE70300
(1543509534.001145) can0 0CF00400#11A3A32C32000FA3
(1543509534.001297) can0 18FEDF00#8AA0287D7DFFFFF5
"""
VALUES = {
    "EngineActualTorque": [10.0, 38.0],
    "EngineDemandTorque": [0.0, 38.0],
    "EngineSpeed": [649.0, 1605.5],
    "EngineFrictionTorque": [5.0, 13.0],
    "EngineParasiticTorque": [0.0, 0.0],
    "EngineDesiredSpeed": [1300.0],
}
# Worked by hand from J1939-71: 1,000 r/min, 12.5 L/h, 80 deg C, 10 km/h, 540 r/min.
BY_HAND = """(1.0) can0 0CF00203#FD401FFFFFFFFFFF
(1.0) can0 18FEF200#FA00FFFFFFFFFFFF
(1.0) can0 18FEF803#FFFFFFFF202CFFFF
(1.0) can0 18FEF131#F7000AFFFFFFFFFF
(1.0) can0 18FE4326#E010FFFFFFFFFFFF
"""


def read(tmp_path, text, names=None):
    path = tmp_path / "trace.log"
    path.write_text(text)
    log = open_log(path)
    names = names or [name for name in log.channels if "Reference" not in name]
    values = {}
    for piece in log.pieces(names):
        for name, series in piece.items():
            values.setdefault(name.removeprefix("J1939."), []).extend(series.values)
    return values, log.remarks.lines


def test_frames_from_elsewhere(tmp_path):
    values, _ = read(tmp_path, PUBLIC)
    for name, expected in VALUES.items():
        assert values[name] == pytest.approx(expected), name


def test_frames_by_hand(tmp_path):
    values, _ = read(tmp_path, BY_HAND)
    assert values["OutputShaftSpeed"] == pytest.approx([1000.0])
    assert values["EngineFuelRate"] == pytest.approx([12.5])
    assert values["TransmissionOilTemperature"] == pytest.approx([80.0])
    assert values["WheelBasedSpeed"] == pytest.approx([10.0])
    assert values["RearPtoSpeed"] == pytest.approx([540.0])
    assert values["DrivelineEngaged"] == ["on"]


@pytest.mark.parametrize(
    ("raw", "reason"),
    [
        (0xFFFF, "not available"),
        (0xFF00, "not available"),
        (0xFE12, "error"),
        (0xFB00, "reserved"),
        (0xFAFF, ""),
        (0x0000, ""),
    ],
)
def test_codes_of_two_bytes(tmp_path, raw, reason):
    low, high = f"{raw & 0xFF:02X}", f"{raw >> 8:02X}"
    text = f"(1.0) can0 0CF00400#FFFF80{low}{high}FFFFFF\n"
    values, lines = read(tmp_path, text, ["J1939.EngineSpeed"])
    assert values["EngineSpeed"] == ([] if reason else [pytest.approx(0.125 * raw)])
    assert not reason or reason in lines[0]


def test_reference_torque_in_three_frames(tmp_path):
    """EC1 by the transport protocol, among another message of the same sender."""
    announced = "(1.0) can0 1CECFF00#20270006FFE3FE00\n"
    packets = [
        f"(1.{n}) can0 1CEBFF00#{n:02X}FFFFFFFFFF{'5203' if n == 3 else 'FFFF'}\n"
        for n in range(1, 7)
    ]
    other = "(2.0) can0 1CECFF00#20270006FFCAFE00\n"
    text = PUBLIC + announced + "".join(packets) + other + "".join(packets)
    values, _ = read(tmp_path, text, ["J1939.EngineReferenceTorque"])
    assert values["EngineReferenceTorque"] == [0x0352]


def test_group_numbers():
    """A destination is no part of the number (J1939-21, 5.2)."""
    identifiers = np.array([0x0CF00400, 0x18EF2103, 0x1CECFF00, 0x19F20105])
    assert group_number(identifiers).tolist() == [0xF004, 0xEF00, 0xEC00, 0x1F201]


def test_tdms_of_labview():
    """A file that npTDMS ships for its tests: LabVIEW wrote it, with units."""
    nptdms = pytest.importorskip("nptdms")
    path = Path(nptdms.__file__).parent / "test" / "data" / "raw1.tdms"
    if not path.is_file():
        pytest.skip("this npTDMS ships no files")
    with open_log(path) as log:
        assert {channel.unit for channel in log.channels.values()} == {"Volts"}
        names = list(log.channels)[:2]
        pieces = list(log.pieces(names))
        expected = nptdms.TdmsFile.read(path).groups()[0].channels()[0][:]
    values = np.concatenate([piece[names[0]].values for piece in pieces])
    np.testing.assert_array_equal(values, expected)


def test_decoding_agrees_with_cantools(tmp_path):
    """All byte orders, signs and lengths, against cantools' own decoder."""
    cantools = pytest.importorskip("cantools")
    rng = np.random.default_rng(0)
    lines = ['VERSION ""', "NS_ :", "BS_:", "BU_: X", "BO_ 100 M: 8 X"]
    kinds = {
        "a": "0|12@1+ (0.5,-3)",
        "b": "12|7@1- (1,0)",
        "c": "31|12@0+ (0.25,1)",
        "d": "35|12@0- (2,0)",
        "e": "48|16@1- (0.1,5)",
    }
    lines += [f' SG_ {name} : {kind} [0|0] "" X' for name, kind in kinds.items()]
    dbc = tmp_path / "m.dbc"
    dbc.write_text("\n".join(lines) + "\n")
    message = cantools.database.load_file(str(dbc)).get_message_by_name("M")
    frames = rng.integers(0, 256, (50, 8), dtype=np.uint8)
    text = "".join(
        f"({n}.0) can0 064#{frame.tobytes().hex().upper()}\n"
        for n, frame in enumerate(frames)
    )
    path = tmp_path / "trace.log"
    path.write_text(text)
    log = open_log(path, dbc)
    (piece,) = log.pieces([f"M.{name}" for name in kinds])
    for row, frame in enumerate(frames):
        decoded = message.decode(frame.tobytes())
        for name in kinds:
            assert piece[f"M.{name}"].values[row] == pytest.approx(decoded[name]), name
