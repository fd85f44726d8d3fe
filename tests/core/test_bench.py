# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Bench samples: the paper's table, CSV round trips, and every bad input by file, row and field."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import hmcvt_core as hmcvt
from hmcvt_core.transmission.ranges import BENCH_COLUMNS

from .conftest import assert_refused

HEADER = "displacement_ratio,engine_speed,load_torque,efficiency"
GOOD = "0.5,150,200,0.8"

# Table 2, typed here a second time so that a typing error in either place shows.
TABLE_2 = [
    (-1, 78.54, 101.86, 64.3),
    (-0.73, 78.54, 127.32, 69.8),
    (0.73, 78.54, 267.38, 80.8),
    (1, 78.54, 292.85, 76.6),
    (-1, 146.61, 163.70, 58.8),
    (0, 78.54, 190.99, 84.7),
    (0, 102.10, 235.06, 81.2),
    (0, 126.19, 340.76, 84.4),
]


def written(tmp_path, text, name="bench.csv"):
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def test_table_2(table2):
    found = np.stack(
        [
            table2.displacement_ratio,
            table2.engine_speed,
            table2.load_torque,
            table2.efficiency,
        ],
        axis=-1,
    )
    np.testing.assert_allclose(
        found, np.array(TABLE_2) * [1.0, 1.0, 1.0, 0.01], rtol=1e-12
    )
    assert table2.extra == {"test": tuple("12345678")}
    assert table2.output_speed is None


values = {
    column.name: st.floats(column.low, column.high, allow_subnormal=False)
    for column in BENCH_COLUMNS
}
OPTIONAL = [column.name for column in BENCH_COLUMNS[4:]]
texts = st.text(st.characters(blacklist_categories=("Cs", "Cc")), max_size=8).map(
    str.strip
)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data(), st.integers(1, 6), st.sets(st.sampled_from(OPTIONAL)))
def test_round_trip_keeps_every_bit(tmp_path, data, n, optional):
    arrays = {
        name: data.draw(st.lists(some, min_size=n, max_size=n))
        for name, some in values.items()
        if name not in OPTIONAL or name in optional
    }
    extra = {"note": tuple(data.draw(st.lists(texts, min_size=n, max_size=n)))}
    samples = hmcvt.BenchSamples(
        **{name: np.array(some) for name, some in arrays.items()}, extra=extra
    )
    path = tmp_path / "round.csv"
    hmcvt.write_bench(path, samples)
    again = hmcvt.read_bench(path)
    for column in BENCH_COLUMNS:
        before, after = getattr(samples, column.name), getattr(again, column.name)
        if before is None:
            assert after is None
        else:
            np.testing.assert_array_equal(after, before)
    assert again.extra == extra


@pytest.mark.parametrize(
    "text",
    [
        f"\ufeff{HEADER}\r\n{GOOD}\r\n",  # as spreadsheets write it
        f"\n{HEADER}\n\n{GOOD}\n,,,\n",  # blank lines
        f" {HEADER.replace(',', ' , ')} \n {GOOD.replace(',', ' , ')} \n",
        f'"{HEADER.replace(",", chr(34) + "," + chr(34))}"\n{GOOD}',
        "efficiency,load_torque,engine_speed,displacement_ratio\n0.8,200,150,0.5\n",
        HEADER.replace(",", ";") + "\n0.5;150;200;0.8\n",
        HEADER.replace(",", ";") + "\r\n0,5;150;200;0,8\r\n",
        HEADER.replace(",", "\t") + "\n,5\t1,5e2\t200,0\t0,800\n",
        f"# run 3, warm\n#\n{HEADER}\n{GOOD}\n",
        "Displacement Ratio,ENGINE_SPEED,load-torque,Efficiency\n" + GOOD,
        f"{HEADER}\n{GOOD},,\n",
        f"{HEADER}\r{GOOD}\r",
        f"{HEADER},\u00f6l\n{GOOD},x".encode("cp1252"),
        "efficiency,load_torque,engine_speed,displacement_ratio,\n8e-1,+200,1.5e2,.5,x\n",
        f'{HEADER},note\n{GOOD},"a, b, c; d"\n',
        HEADER.replace(",", ";") + ";gears\n0,5;150;200.0;0,8;1,2\n",  # no thousands
    ],
)
def test_spellings_that_are_read(tmp_path, text):
    samples = hmcvt.read_bench(written(tmp_path, text))
    assert [
        samples.displacement_ratio[0],
        samples.engine_speed[0],
        samples.load_torque[0],
        samples.efficiency[0],
    ] == [0.5, 150.0, 200.0, 0.8]


@pytest.mark.parametrize(
    ("row", "message"),
    [
        (
            "nan,150,200,0.8",
            r"row 3: displacement_ratio = nan is not finite; allowed -1 to 1",
        ),
        (
            "0.5,1500,200,0.8",
            r"row 3: engine_speed = 1500 is outside 10 to 320 rad/s \(is it in r/min\?\)",
        ),
        (
            "0.5,150,200,80",
            r"row 3: efficiency = 80 is outside 0.01 to 1 \(a fraction, not percent\)",
        ),
        ("0.5,150,-200,0.8", r"row 3: load_torque = -200 is outside 1 to 5000 N m"),
        (
            "0.5,150,5000.0000001,0.8",
            r"row 3: load_torque = 5000.0000001 is outside 1 to 5000 N m",
        ),
        ("0.5,fast,200,0.8", r"row 3: engine_speed 'fast' is not a number"),
        ("0.5,150,,0.8", r"row 3: load_torque is empty"),
        ("0.5,150,200", r"row 3: 3 fields, the header has 4"),
        ("0.5;150;200;0,8", r"row 3: 2 fields, the header has 4"),
        ('0.5,150,"1,200.5",0.8', r"row 3: load_torque '1,200.5' is not a number"),
        ("0.5,150,1 200,0.8", r"row 3: load_torque '1 200' is not a number"),
        ('0.5,"150,200,0.8', r"not CSV: unexpected end of data"),
        ('0.5,"150\n",1000000,0.8', r"row 3: load_torque = 1e\+06 is outside"),
    ],
)
def test_bad_row_is_named(tmp_path, row, message):
    path = written(tmp_path, f"{HEADER}\n{GOOD}\n{row}\n{GOOD}\n")
    assert_refused(hmcvt.read_bench, path, message)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "",
            r"is empty; needs columns displacement_ratio, engine_speed, load_torque, efficiency",
        ),
        (HEADER, r"holds a header but no samples"),
        (
            "displacement_ratio,engine_speed,efficiency\n0.5,150,0.8",
            "row 1: column load_torque is missing; there is displacement_ratio, "
            "engine_speed, effici",
        ),
        (
            f"{HEADER}\n-,rad/s,N m,-\n{GOOD}",
            r"row 2: -, rad/s, N m, - are no numbers; remove a row",
        ),
        (
            f"{HEADER},oil_temperature\n{GOOD},60\n{GOOD},\n",
            r"row 3: oil_temperature is empty: fill it in, or leave the column out",
        ),
        (
            HEADER.replace(",", ";") + "\n0.5;150;1,200;0.8",
            r"row 2: load_torque '1,200' is not a number: write a decimal point",
        ),
        (
            f"{HEADER}\n0,5,150,200,0,8",
            r"row 2: 6 fields, the header has 4 \(decimal comma",
        ),
        (
            f"{HEADER}\n{GOOD}\n# pause\n",
            r"row 3: 1 fields, the header has 4 .*a comment",
        ),
        ("Efficiency,efficiency\n", r"row 1: column 'efficiency' stands there twice"),
        (
            f"{HEADER}\n{GOOD}".encode("utf-16"),
            r"not UTF-8 text at byte 0: save it as 'CSV UTF-8'",
        ),
        (
            '"displacement\nratio",b\n1,2',
            r"row 1: column .* is missing; there is displacement ratio",
        ),
        (b"\x00\x01\x02\x03", r"is missing|contains NUL"),  # Python 3.10
        ("x" * 200_000 + f"\n{GOOD}", r"not CSV: field larger than field limit"),
        (
            HEADER + ",efficiency_std\n" + GOOD + ",1.1",
            r"row 2: efficiency_std = 1.1 .*not percent",
        ),
    ],
)
def test_bad_file_is_named(tmp_path, text, message):
    assert_refused(hmcvt.read_bench, written(tmp_path, text), message)


def test_files_that_are_not_read(tmp_path):
    assert_refused(
        hmcvt.read_bench, tmp_path / "absent.csv", "No such file or directory"
    )
    assert_refused(hmcvt.read_bench, tmp_path, "Is a directory")
    path = tmp_path / "huge.csv"
    with path.open("wb") as file:
        file.truncate(300 * 1024 * 1024)  # sparse
    assert_refused(hmcvt.read_bench, path, r"larger than 256 MiB, not a bench log")


GOOD_VALUES = {
    "displacement_ratio": [0.5],
    "engine_speed": [150.0],
    "load_torque": [200.0],
    "efficiency": [0.8],
}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"efficiency": [80.0]}, r"samples: efficiency\[0\] = 80 is outside"),
        (
            {"efficiency": [0.8, 0.8]},
            r"efficiency has shape \(2,\), displacement_ratio has 1 values",
        ),
        (
            {"engine_speed": [math.nan], "source": "bag"},
            r"bag: engine_speed\[0\] = nan is not finite",
        ),
        ({"load_torque": None}, "load_torque is missing"),
        ({name: [] for name in GOOD_VALUES}, "holds no samples"),
    ],
)
def test_samples_check_themselves(change, message):
    with pytest.raises(hmcvt.InputError, match=message):
        hmcvt.BenchSamples(**(GOOD_VALUES | change))


def test_samples_cannot_be_changed():
    with pytest.raises(ValueError, match="read-only"):
        hmcvt.BenchSamples(**GOOD_VALUES).efficiency[0] = 0.9


def test_select_takes_indices_and_masks(table2):
    some = table2.select([4, 0])
    np.testing.assert_array_equal(some.engine_speed, [146.61, 78.54])
    assert some.extra == {"test": ("5", "1")}
    assert some.sha256 == table2.sha256
    masked = table2.select(table2.displacement_ratio == 0.0)
    assert masked.extra == {"test": ("6", "7", "8")}
    with pytest.raises(hmcvt.InputError, match="holds no samples"):
        table2.select(np.zeros(8, dtype=bool))


def test_texts_of_another_length_are_refused(table2):
    message = "column session has 2 texts, displacement_ratio has 8 values"
    with pytest.raises(hmcvt.InputError, match=message):
        replace(table2, extra={"session": ("a", "b")})
