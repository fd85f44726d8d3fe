# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt import-bag`, and what the other commands make of its file."""

import json
import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest

from hmcvt_core import read_bench
from hmcvt_ros.bag import ImportSettings, Steadiness
from hmcvt_ros.commands.import_bag import command

from .simulated import bench_records, signal_records, write_bag

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def bags(bench, tmp_path_factory):
    """The bags that the examples name."""
    folder = tmp_path_factory.mktemp("bags")
    write_bag(folder / "run1", bench_records(bench))
    write_bag(folder / "run2", bench_records(bench, "/tractor1/shafts"))
    (folder / "run2" / "run2.mcap").rename(folder / "run1.mcap")
    write_bag(folder / "run3", signal_records(bench))
    return folder


@pytest.fixture
def workplace(bags, tmp_path, monkeypatch):
    """A folder with the bags in it."""
    shutil.copytree(bags, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_from_bag_to_parameters(hmcvt, workplace, model):
    code, out, err = hmcvt("import-bag", "run1", "--out", "samples.csv")
    assert (code, err) == (0, "")
    assert "12 bench samples written to samples.csv" in out
    assert re.search(r"\d+\.\d s steady, \d+\.\d s rejected as transient", out)
    code, out, _ = hmcvt("identify", "samples.csv", "--json")
    assert code == 0
    for name, found in json.loads(out)["parameters"].items():
        true, error = getattr(model.parameters, name), found["standard_error"]
        assert abs(found["value"] - true) < 4.0 * error, name
        assert error < 0.25 * true, name  # four of them are no empty bound


@pytest.mark.parametrize("bag", ["run1", "run1.mcap"])
def test_watch_reads_a_bag_as_the_import_does(hmcvt, workplace, bag):
    assert (
        hmcvt(
            "import-bag",
            bag,
            "--out",
            "samples.csv",
            *(("--topic", "shafts") if bag.endswith("mcap") else ()),
        ).code
        == 0
    )
    seen = hmcvt("watch", "samples.csv", "--json")
    assert seen.code == 0 and seen.json["samples"] == 12
    if bag == "run1":
        assert hmcvt("watch", bag, "--json") == seen
    else:  # its topic has another name: told as the import tells it
        assert "bench_sample" in hmcvt("watch", bag).err


def test_options_reach_the_search(hmcvt, workplace):
    options = (
        "--topic",
        "shafts",
        "--namespace",
        "tractor1",
        "--min-duration",
        "9.5",
        "--torque-drift",
        "0.015",
    )
    code, out, _ = hmcvt(
        "import-bag", "run1.mcap", "--out", "samples.csv", "--json", *options
    )
    assert code == 0
    windows = json.loads(out)["windows"]
    assert windows and all(window["duration"] > 9.4 for window in windows)
    code, out, _ = hmcvt("import-bag", "run1", "--out", "samples.csv", "--json")
    assert len(json.loads(out)["windows"]) > len(windows)


@pytest.mark.parametrize(
    ("bag", "option"),
    [
        ("nowhere", "--gap=2"),
        *(
            ("run1", option)
            for option in (
                "--block=-1",
                "--min-duration=1",
                "--age-limit=0",
                "--gap=nan",
                "--speed-drift=0",
            )
        ),
    ],
)
def test_what_cannot_be_done_is_one_line_and_leaves_the_old_file(
    hmcvt, workplace, bag, option
):
    Path("samples.csv").write_text("old")
    code, out, err = hmcvt("import-bag", bag, "--out", "samples.csv", option)
    assert (
        (code, out) == (2, "")
        and err.startswith("hmcvt: error: ")
        and err.count("\n") == 1
    )
    if bag == "nowhere":
        assert err.endswith("nowhere: there is no such bag\n")
    else:
        assert option.strip("-").partition("=")[0].replace("-", "_") in err
        assert ("positive" in err) != ("holds fewer than 3 blocks of 1 s" in err)
    assert Path("samples.csv").read_text() == "old"


SIGNALS = {
    "engine_speed": "/engine/speed:rpm",
    "engine_torque": "/engine/torque",
    "output_speed": "/output/speed:rpm",
    "output_torque": "/output/torque",
    "displacement_ratio": "/pump/stroke:%",
}


def test_signals_with_topics_of_their_own_give_the_same_samples(hmcvt, workplace):
    named = [f"--signal={name}={topic}" for name, topic in SIGNALS.items()]
    report = hmcvt("import-bag", "run3", "--out", "apart.csv", "--json", *named).json
    assert report["clock"] == "time of receipt"
    # The torque of the engine stops for 4 s and holds for --gap on either side.
    assert report["refused"]["/engine/speed"] == {"no engine_torque in time": 101}
    hmcvt("import-bag", "run1", "--out", "together.csv")
    apart, together = read_bench("apart.csv"), read_bench("together.csv")
    assert len(apart) >= len(together) - 1
    nearest = [int(np.argmin(np.abs(together.stamp - each))) for each in apart.stamp]
    for name in ("displacement_ratio", "engine_speed", "load_torque", "efficiency"):
        assert getattr(apart, name) == pytest.approx(
            getattr(together, name)[nearest], rel=5e-3
        )
    for wrong, words in (
        ("", "no topic is named for displacement_ratio"),
        ("displacement_ratio=/pump/angle", "holds no topic /pump/angle"),
        ("displacement_ratio=/engine/torque", "two signals name the same topic"),
        ("engine_speed=/pump/stroke", "each signal has one topic"),
        ("displacement_ratio=/note", "/note is std_msgs/msg/String, not a number"),
        (
            "displacement_ratio=/pump/stroke:deg",
            "'deg' is no unit of displacement_ratio",
        ),
        ("displacement_ratio=/pump/stroke:%@50", "'%@50' has another zero than SI"),
        ("stroke=/pump/stroke", "write NAME=TOPIC[:UNIT]"),
    ):
        done = hmcvt(
            "import-bag",
            "run3",
            "--out",
            "apart.csv",
            *named[:-1],
            *[f"--signal={wrong}"] * bool(wrong),
        )
        assert done.code == 2 and words in done.err, done
    done = hmcvt(
        "import-bag", "run3", "--out", "apart.csv", "--topic", "shafts", *named
    )
    assert done.code == 2 and "topic = 'shafts' holds all signals" in done.err


def test_out_is_needed_and_never_a_file_of_a_bag(hmcvt, workplace):
    code, _, err = hmcvt("import-bag", "run1")
    assert code == 2 and "--out" in err
    before = Path("run1.mcap").read_bytes()
    code, _, err = hmcvt("import-bag", "run1", "--out", "run1.mcap")
    assert code == 2 and "not written over" in err
    assert Path("run1.mcap").read_bytes() == before


def _examples():
    text = (ROOT / "docs" / "import-bag.md").read_text(
        encoding="utf-8"
    ) + command.epilog
    return list(dict.fromkeys(re.findall(r"^ +(hmcvt .*)$", text, flags=re.MULTILINE)))


@pytest.mark.parametrize("line", _examples())
def test_every_documented_command_works(hmcvt, workplace, line):
    arguments = shlex.split(line, comments=True)[1:]
    if arguments[0] == "identify":
        hmcvt("import-bag", "run1", "--out", "samples.csv")
    code, out, err = hmcvt(*arguments)
    assert (code, err) == (0, "") and out


def test_the_documented_defaults_are_the_defaults():
    text = (ROOT / "docs" / "import-bag.md").read_text(encoding="utf-8")
    rows = dict(
        re.findall(r"^\| `--([a-z-]+)` \| ([0-9.]+) \|", text, flags=re.MULTILINE)
    )
    settings = {
        **vars(Steadiness()),
        "gap": ImportSettings.gap,
        "age_limit": ImportSettings.age_limit,
    }
    assert {
        name.replace("-", "_"): float(value) for name, value in rows.items()
    } == settings


def test_samples_are_averages_of_the_windows_reported(workplace, hmcvt, bench):
    report = hmcvt("import-bag", "run1", "--out", "samples.csv", "--json").json
    samples = read_bench("samples.csv")
    assert (
        report["samples"]
        == len(samples)
        == len(report["windows"])
        == report["windows_found"]
    )
    assert report["read"] == {"/bench_sample": 7200} and report["refused"] == {
        "/bench_sample": {}
    }
    assert samples.efficiency_std is not None and samples.output_speed is not None
    for i, window in enumerate(report["windows"]):
        first = int(np.argmin(np.abs(bench.time - window["start"])))
        part = slice(first, first + window["messages"])
        output = (bench.output_torque * bench.output_speed)[part].mean()
        engine = (bench.engine_torque * bench.engine_speed)[part].mean()
        assert samples.efficiency[i] == pytest.approx(output / engine, rel=1e-9)
        assert samples.load_torque[i] == pytest.approx(
            output / bench.engine_speed[part].mean(), rel=1e-9
        )
