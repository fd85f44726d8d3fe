# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt transmission`, and errors of the files that hold a gear train."""

import pytest

from hmcvt_core import read_bench
from studies.gearbox import box

from .running import HM4, ROOT, assert_refused, process

PAIRS = {"2": 0.969, "3": 1.484, "4": 0.678, "5": 1.96, "6": 0.982, "11": 0.823}
STAGE = "HM4 row=k1 mechanical=2,3:carrier pump=4 motor=-5:sun output=6,11:ring"
SHIPPED = ROOT / "params" / "transmission.yaml"


def arguments(path):
    pairs = []
    for name, ratio in PAIRS.items():
        pairs += ["--gear-pair", f"{name}={ratio}"]
    return ("transmission", "new", path, *pairs, "--planetary-row", "k1=2.56")


def test_new_file_is_the_shipped_stage(hmcvt, tmp_path):
    path = tmp_path / "T.yaml"
    made = hmcvt(*arguments(path), "--stage", STAGE, "--json")
    assert made.code == 0 and "# Teeth of the ring" in path.read_text()
    assert made.json == hmcvt("transmission", "check", SHIPPED, "--json").json
    ratios = made.json["stages"][0]["ratios"]
    assert ratios == pytest.approx([0.83286, 1.19658, 1.56029], abs=1e-5)  # eq. (5)
    assert_refused(hmcvt(*arguments(path), "--stage", STAGE), "exists")


def test_a_wrong_stage_leaves_no_file(hmcvt, tmp_path):
    path = tmp_path / "T.yaml"
    assert_refused(hmcvt(*arguments(path), "--stage", "HM4 rw=k1"), "'rw=k1'")
    assert_refused(
        hmcvt(*arguments(path), "--stage", STAGE.replace("=4", "=9")), "gear_pairs.9"
    )
    assert not path.exists()


def test_a_stage_without_a_row_is_hydrostatic(hmcvt, tmp_path):
    path = tmp_path / "T.yaml"
    stage = "H0 pump=4 motor=-5 output=-6,11"
    assert_refused(hmcvt(*arguments(path), "--stage", stage), "layout: hydrostatic")
    hydrostatic = stage.replace("H0", "H0 layout=hydrostatic")
    assert hmcvt(*arguments(path), "--stage", hydrostatic).code == 0


def test_check_draws_the_power_paths(hmcvt, tmp_path):
    picture = tmp_path / "paths.svg"
    done = hmcvt("transmission", "check", SHIPPED, "--picture", picture)
    assert done.code == 0 and "forward" in done.out
    drawn = picture.read_text(encoding="utf-8")
    assert all(
        word in drawn
        for word in ("engine", "pump", "motor", "6 x 11 = 0.8082", "at stroke -1, 0, 1")
    )


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("1: 1.439", "1: 1,439", ("439", "line 6", "no value")),
        ("pump_friction: 0.01", "pump_friction: 0,01", ("pump_friction", "0.01")),
    ],
)
def test_decimal_comma_is_refused_with_its_line(hmcvt, tmp_path, old, new, words):
    path = tmp_path / "T.yaml"
    path.write_text(SHIPPED.read_text().replace(old, new, 1))
    assert_refused(hmcvt("transmission", "check", path), *words)


def test_the_kind_of_file_is_named(hmcvt):
    assert_refused(
        hmcvt("transmission", "check", HM4),
        "is a parameter file of a model; wanted is a transmission file",
    )
    assert_refused(
        hmcvt("map", "--params", SHIPPED),
        "is a transmission file; wanted is a parameter file",
    )


def test_reports_have_a_format(hmcvt, tmp_path):
    assert_refused(
        hmcvt("diagnose", "x.csv", "--report", tmp_path / "r.txt"),
        "r.txt: a report ends in .html, .pdf",
    )


def test_what_is_not_stated_is_asked(tmp_path):
    """The answers come line by line on stdin; an empty one goes on."""
    pairs = [f"{name}={ratio}" for name, ratio in PAIRS.items()]
    units = ["80", "80.5", ""]
    answers = "\n".join([*pairs, "", "k1=2,56", "", *units, STAGE, "", ""])
    done = process("transmission", "new", tmp_path / "T.yaml", input=answers)
    assert done.code == 0, done.err
    assert "HM4" in done.out
    text = (tmp_path / "T.yaml").read_text()
    assert "{k1: 2.56}" in text and "gear_efficiency: 0.98" in text
    assert "pump_displacement_cm3_per_rev: 80\n" in text
    assert "motor_displacement_cm3_per_rev: 80.5\n" in text


def test_an_answer_that_cannot_be_read_is_asked_again(tmp_path):
    pairs = [f"{name}={ratio}" for name, ratio in PAIRS.items()]
    wrong_stage = STAGE.replace("row=", "rw=")
    lines = ["2", *pairs, "", "k1", "k1=2.56", "", "80 cc", "80", "80", "", wrong_stage]
    answers = "\n".join([*lines, STAGE, "", ""])
    done = process("transmission", "new", tmp_path / "T.yaml", input=answers)
    assert done.code == 0, done.err
    for refused in ("'2' is not", "'k1' is not", "'80 cc' is not", "'rw=k1' is not"):
        assert refused in done.err


@pytest.mark.parametrize(
    ("after_the_units", "words"),
    [
        ("\n", "no stage is stated; nothing is written"),
        ("", "the input ended before the answer to 'Stage (empty to end)'"),
    ],
)
def test_questions_end_with_one_line(tmp_path, after_the_units, words):
    path = tmp_path / "T.yaml"
    answers = "4=0.678\n\nk1=2.56\n\n\n\n\n" + after_the_units
    done = process("transmission", "new", path, input=answers)
    assert done.code == 2
    assert words in done.err.splitlines()[-1]
    assert done.err.count("Stage (empty to end)") == (1 if after_the_units else 2)
    assert not path.exists()


def test_slips_of_open_clutches_are_printed_by_stage(hmcvt, tmp_path):
    path = tmp_path / "T.yaml"
    assert hmcvt("transmission", "new", path, *box.DESCRIPTION).code == 0
    check = hmcvt("transmission", "check", path, "--json").json
    slips = {(item["stage"], item["name"]): item["slips"] for item in check["clutches"]}
    # Of the two clutches of the ring one is open, of the four of the output three.
    assert len(slips) == 5 * 4
    for stroke, slip in zip((-1, 0, 1), slips["F2", "C4"], strict=True):
        output = box.speed_ratio("F2", stroke)
        carrier = output * box.output_ratio("F2")
        assert slip == pytest.approx(carrier - output, abs=1e-9)
    assert slips["R", "CF"] == pytest.approx(3 * [45 / 36 + 20 / 80])
    printed = hmcvt("transmission", "check", path).out.splitlines()
    assert any(line.split() == ["R", "CF", *3 * ["1.5000"]] for line in printed)


def test_an_assumed_displacement_is_stated(hmcvt, tmp_path):
    stated = ("--pump-displacement", "80", "--motor-displacement", "80,5")
    path = tmp_path / "T.yaml"
    assert "is assumed for" in hmcvt(*arguments(path), "--stage", STAGE).out
    path = tmp_path / "U.yaml"
    done = hmcvt(*arguments(path), *stated, "--stage", STAGE)
    assert "is assumed for" not in done.out
    assert "motor_displacement_cm3_per_rev: 80.5\n" in path.read_text()


TEETH = [
    *("--gear-pair", "A=36/45", "--gear-pair", "P=31/40", "--gear-pair", "M=52/26"),
    *("--gear-pair", "O=70/28", "--gear-pair", "R=44/30", "--planetary-row", "k=96/36"),
    *("--stage", "F1 row=k mechanical=A:ring pump=P motor=M:sun output=O:carrier"),
    *("--stage", "F2 row=k mechanical=A:ring pump=P motor=M:sun output=direct:carrier"),
    *(
        "--stage",
        "R row=k reverse=yes mechanical=-R:ring pump=P motor=M:sun output=O:carrier",
    ),
    *("--clutch", "C1 between=carrier/O,output closed=F1,R"),
    *("--clutch", "C2 between=carrier,output closed=F2"),
]


def test_new_file_from_teeth_with_clutches(hmcvt, tmp_path):
    path = tmp_path / "T.yaml"
    made = hmcvt("transmission", "new", path, *TEETH)
    assert made.code == 0, made.err
    assert "A: 45 teeth drive 36, the driven shaft turns 1.25 times as fast" in made.out
    text = path.read_text(encoding="utf-8")
    assert "A: 36/45" in text and "k: 96/36" in text and "gear_pairs: []" in text
    checked = hmcvt("transmission", "check", path, "--picture", tmp_path / "p.svg")
    assert checked.code == 0, checked.err
    ratio = 45 / 36 * (96 / 132) * 28 / 70
    assert f"{ratio:.4f}" in checked.out


def test_teeth_and_clutches_that_make_no_sense_leave_no_file(hmcvt, tmp_path):
    path = tmp_path / "T.yaml"
    assert_refused(
        hmcvt("transmission", "new", path, *TEETH, "--gear-pair", "B=36/4"),
        "4 is no count of teeth; allowed 5 to 1000",
    )
    assert_refused(
        hmcvt("transmission", "new", path, *TEETH, "--gear-pair", "direct=1"),
        "'direct' stands for no pair",
    )
    wrong = "C3 between=carrier,output closed=F1"
    assert_refused(
        hmcvt("transmission", "new", path, *TEETH, "--clutch", wrong),
        "clutches.C3.closed = F1",
    )
    assert_refused(
        hmcvt("transmission", "new", path, *TEETH, "--clutch", "C3 between=ring"),
        "between=SIDE,SIDE",
    )
    assert not path.exists()


def reverse_bench(hmcvt, tmp_path):
    """A bench of the five-stage box without a sense of speed, and its gears."""
    gears = tmp_path / "gears.yaml"
    assert hmcvt("transmission", "new", gears, *box.DESCRIPTION).code == 0
    lines = [
        "displacement_ratio,engine_speed,load_torque,efficiency,output_speed,stage"
    ]
    for stage, stroke, speed, torque, oil in box.plan(12):
        state = box.steady(box.Machine(), stage, stroke, speed, torque, oil)
        power = torque * abs(state.output_speed)
        efficiency = power / (state.engine_torque * speed)
        row = (stroke, speed, power / speed, efficiency, abs(state.output_speed), stage)
        lines.append(",".join(map(str, row)))
    bench = tmp_path / "bench.csv"
    bench.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return bench, gears


def test_signs_of_a_bench_without_a_sense_are_corrected(hmcvt, tmp_path):
    bench, gears = reverse_bench(hmcvt, tmp_path)
    identified = hmcvt("identify", bench, "--transmission", gears)
    assert "output_speed in stage R turns against the gear train" in identified.out
    corrected = tmp_path / "corrected.csv"
    done = hmcvt(
        *("transmission", "signs", bench, "--transmission", gears, "--out", corrected),
        "--json",
    )
    signs = {item["stage"]: item["output_speed"] for item in done.json["stages"]}
    assert signs.pop("R") == "wrong" and set(signs.values()) == {"right"}
    assert read_bench(corrected).output_speed.min() < -5.0
    model = tmp_path / "model.yaml"
    again = hmcvt("identify", corrected, "--transmission", gears, "--out", model)
    assert again.code == 0 and "against the gear train" not in again.out + again.err
    forward = ("optimum", "--params", model, "--stage", "R", "--output-power", "15kW")
    assert_refused(
        hmcvt(*forward, "--output-speed", "10"),
        "backward, in stage R, --output-speed is negative",
    )
    backward = hmcvt(*forward, "--output-speed", "-10", "--json")
    assert backward.json["stage"] == "R"
    # By the gear train alone the box drives backward at this stroke.
    assert box.speed_ratio("R", backward.json["displacement_ratio"]) < -0.05
