# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What a user can get wrong: one line that names the place and the range, exit code 2."""

import pytest

from .running import ENGINE, HM4, POINT, TABLE2, TRACTOR, assert_refused


@pytest.mark.parametrize("command", ["identify", "predict", "diagnose", "separable"])
def test_bench_file(hmcvt, tmp_path, command):
    """Every other damage: tests/core/test_bench.py."""
    bench = tmp_path / "bench.csv"
    bench.write_text(
        "displacement_ratio,engine_speed,load_torque,efficiency\n0.5,1400,200,0.8\n"
    )
    assert_refused(
        hmcvt(command, bench, "--json"),
        f"{bench}: row 2: engine_speed = 1400",
        "10 to 320 rad/s",
        "r/min",
    )


POINTS = [  # what else the core refuses: tests/core/test_model.py
    ("--displacement-ratio", "nan", "displacement_ratio = nan", "-1 to 1"),
    ("--engine-speed", "1400", "engine_speed = 1400", "10 to 320 rad/s", "r/min"),
    ("--engine-speed", "20rpm", "engine_speed = 2.0944", "10 to 320 rad/s"),
    ("--engine-speed", "fast", "--engine-speed", "'fast'", "1400rpm"),
    ("--load-torque", "-inf", "load_torque = -inf", " to 5000 N m"),
    ("--load-torque", "much", "--load-torque", "'much'"),
    ("--oil-temperature", "350", "oil_temperature = 350", "-40 to 150 deg C", "kelvin"),
]


@pytest.mark.parametrize(
    "command",
    [("predict",), ("breakdown",), ("optimum", "--hold", "output_speed")],
    ids=" ".join,
)
@pytest.mark.parametrize(
    ("option", "value", "words"), [(o, v, w) for o, v, *w in POINTS]
)
def test_operating_point(hmcvt, command, option, value, words):
    if command[0] == "optimum" and option == "--oil-temperature":
        words = ["No such option"]
    # The last of two equal options counts.
    assert_refused(hmcvt(*command, *POINT, option, value), *words)


@pytest.mark.parametrize("missing", range(0, 6, 2))
def test_option_left_out(hmcvt, missing):
    rest = POINT[:missing] + POINT[missing + 2 :]
    for command in ("predict", "breakdown"):
        assert_refused(hmcvt(command, *rest), POINT[missing], f"hmcvt {command} --help")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--fit", "1-3,9"), ("sample 9", "holds 8")),
        (("--fit", "0-3"), ("'0-3'", "from 1")),
        (("--fit", "3-1"), ("'3-1'",)),
        (("--fit", "1,1"), ("'1,1'", "twice")),
        (("--fit", "1,b"), ("'1,b'", "1,2,4-6")),
        (("--fit", "1,4-"), ("'1,4-'", "1,2,4-6")),
        (
            ("--fit", "1,2", "--hold-back", "0.3"),
            ("--fit and --hold-back both choose the samples",),
        ),
        (("--hold-back", "nan"), ("--hold-back", "nan is not above 0 and at most 0.9")),
        (("--fit", "1-99999999999"), ("1-99999999999", "at most")),
        (("--gear-efficiency", "98"), ("gear_efficiency", "98", "0.5 to 1")),
        (("--gear-efficiency", "nan"), ("gear_efficiency", "0.5 to 1")),
        (("--gear-efficiency", "0.98,"), ("--gear-efficiency", "'0.98,'")),
        (("--formulation", "guess"), ("'guess'", "power_balance", "published")),
        (("--transmission", "none.yaml"), ("none.yaml", "No such file")),
        (("--transmission", HM4), ("hm4.yaml", "hmcvt-transmission/1")),
        (("--stage", "HM9"), ("HM9", "missing", "HM4")),
        (
            ("--params", TRACTOR, "--refine"),
            ("column stage is missing", "H0, HM1", "add it to the bench file"),
        ),
        (("--seed", "-1"), ("--seed", "x>=0")),
        (("--out", "/nowhere/p.yaml"), ("--out", "/nowhere is not a folder")),
        (("--out", "/"), ("--out", "is a folder")),
    ],
)
def test_identify(hmcvt, arguments, words):
    assert_refused(hmcvt("identify", TABLE2, *arguments), *words)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("predict", TABLE2, "--load-torque", "3"), ("not both",)),
        (
            ("optimum", *POINT[2:], "--hold", "output_speed"),
            ("needs displacement_ratio (now) or output_speed",),
        ),
        (("optimum", *POINT[2:], "--output-speed", "100"), ("--hold output_speed",)),
        (
            (
                "optimum",
                "--output-speed",
                "120",
                "--output-power",
                "40kW",
                "--params",
                TRACTOR,
                "--inside-domain",
            ),
            ("--inside-domain: the model does not state", "`hmcvt identify` wrote"),
        ),
        (
            ("optimum", *POINT, "--hold", "output_speed", "--output-speed", "100"),
            ("give one",),
        ),
        (
            (
                "optimum",
                *POINT,
                "--hold",
                "output_speed",
                "--engine-speed-limits",
                "200",
                "100",
            ),
            ("engine_speed_limits", "lower"),
        ),
        (("optimum", *POINT, "--hold", "speed"), ("'speed'", "output_speed")),
        (
            ("map", "--engine-speed-limits", "inf", "100"),
            ("--engine-speed-limits", "10 to 320 rad/s"),
        ),
        (
            ("map", "--engine-speed-limits", "750", "2200"),
            ("--engine-speed-limits", "r/min"),
        ),
        (
            ("map", "--load-torque-limits", "50", "nan"),
            ("--load-torque-limits", "1 to 5000 N m"),
        ),
        (("map", "--power", "30kW"), ("--picture is needed",)),
        (("map", "--picture", "map.gif"), ("map.gif", ".png, .svg, .pdf, .html")),
        (
            ("map", "--picture", "map.png", "--power", "lots"),
            ("'lots' is not a power",),
        ),
        (
            ("map", "--picture", "m.svg", "--power", "900kW"),
            ("--power 900kW at 750 r/min is a load torque of", "1 to 5000 N m"),
        ),
        (("map", "--steps", "0", "2", "2"), ("--steps",)),
        (
            ("map", "--steps", "1001", "1001", "1001"),
            ("--steps", "1003003001", "at most"),
        ),
        (("guess",), ("'guess'", "hmcvt --help")),
        (
            ("predict", *POINT, "--output-power", "9kW"),
            ("--load-torque, --output-power", "one only"),
        ),
        (
            ("predict", *POINT[:4], "--engine-torque", "9kNm"),
            ("9000 N m is more than",),
        ),
        (
            ("predict", *POINT[2:], "--output-speed", "8km/h"),
            ("--tyre-radius and --final-drive",),
        ),
        (
            ("predict", *POINT[2:], "--output-speed", "20"),
            ("20 rad/s is out of reach",),
        ),
        (
            ("predict", *POINT, "--params", TRACTOR),
            ("holds H0, HM1", "--stage is needed"),
        ),
        (("predict", *POINT, "--stage", "HM9"), ("stage 'HM9' is not known", "HM4")),
        (
            ("optimum", "--output-speed", "120"),
            ("one of --output-power, --output-torque",),
        ),
        (
            (
                "optimum",
                "--output-speed",
                "120",
                "--output-power",
                "400kW",
                "--engine",
                ENGINE,
            ),
            ("no working point", "full-load curve of the engine"),
        ),
        (
            ("optimum", *POINT[2:], "--engine", ENGINE),
            ("--engine is of the drive line",),
        ),
        (("predict", "--guess"), ("--guess", "hmcvt predict --help")),
    ],
)
def test_usage(hmcvt, arguments, words):
    assert_refused(hmcvt(*arguments), *words)


@pytest.mark.parametrize(
    ("row", "words"),
    [
        (
            "-0.5,200,5000,HM4",
            "row 3: load_torque = 5000 cannot be carried there; 2350 N m can",
        ),
        (
            "-0.5,200,150,XX",
            "row 3: stage 'XX' is not known to the model; there is HM4",
        ),
    ],
)
def test_a_test_that_cannot_be_run(hmcvt, tmp_path, row, words):
    limits = tmp_path / "limits.csv"
    limits.write_text(
        f"displacement_ratio,engine_speed,load_torque,stage\n1,150,100,HM4\n{row}\n"
    )
    for asked in (("next", TABLE2, "--limits", limits), ("separable", limits)):
        assert_refused(hmcvt(*asked), "limits.csv", words)


@pytest.mark.parametrize("json", [(), ("--json",)])
def test_no_working_point(hmcvt, json):
    stalled = (*POINT, "--load-torque", "5000", *json)
    assert_refused(hmcvt("breakdown", *stalled), "cannot be carried")
    assert_refused(hmcvt("optimum", *stalled), "cannot be carried")
    assert_refused(
        hmcvt("optimum", *stalled, "--hold", "output_speed"), "cannot be held"
    )
