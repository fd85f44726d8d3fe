# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Effects of one's own, from a file or a package; in a process where a class would stay."""

import gc
import os
import re
import shlex

import pytest

from hmcvt_core.physics.effects import library

from .running import HM4, ROOT, TABLE2, assert_refused, process, script

EXAMPLE = ROOT / "examples" / "own_effect.py"
PAGE = (ROOT / "docs" / "add-an-effect.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def worked(tmp_path_factory):
    """A folder in which the example has run, and what it printed."""
    folder = tmp_path_factory.mktemp("worked")
    done = script(EXAMPLE, cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder, done.stdout


def here(folder, line):
    """Run a line of the page in a folder."""
    words = shlex.split(line.replace("examples/own_effect.py", str(EXAMPLE)))[1:]
    return process(*words, cwd=folder, env={**os.environ, "PYTHONPATH": str(ROOT)})


@pytest.mark.slow
def test_the_page_from_the_class_to_the_diagnosis_that_finds_it(worked):
    folder, printed = worked
    (code,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    assert code in EXAMPLE.read_text(encoding="utf-8")
    assert re.search(r"^sets +tipping block (> )?\d+ %", printed, re.MULTILINE)

    diagnose, predict = re.findall(
        r"^    (hmcvt (?:diagnose|predict) .*)", PAGE, re.MULTILINE
    )
    found = here(folder, f"{diagnose} --json").json
    assert found["sets"][0]["effects"] == ["tipping_block"]
    leak = found["causes"][0]["parameters"]["leak"]
    assert leak["value"] == pytest.approx(8e-11, rel=0.1)
    assert found["shrinkage"]["fraction"] > 0.9
    assert "mean |error|  0." in here(folder, predict).out


def test_an_unknown_effect_names_both_ways_to_one_of_your_own(hmcvt, worked):
    folder, _ = worked
    params = folder / "tipping.yaml"
    assert_refused(
        hmcvt("predict", folder / "tipping.csv", "--params", params),
        "effect = 'tipping_block', form = '' is not known",
        "--effects MODULE_OR_FILE.py",
        "entry-point group hmcvt.effects",
    )


def leaking(flow):
    """The example with another flow."""
    return EXAMPLE.read_text().replace("self.leak * state.pressure * above", flow)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "mine.py: cannot be loaded: FileNotFoundError"),
        ("def", "mine.py: cannot be loaded: SyntaxError"),
        ("import absent_thing", "ModuleNotFoundError: No module named 'absent_thing'"),
        ("x = 1", "mine.py: holds no effect"),
    ],
)
def test_a_file_without_an_effect_is_told(hmcvt, tmp_path, text, words):
    if text is not None:
        (tmp_path / "mine.py").write_text(text)
    done = hmcvt("predict", TABLE2, "--effects", tmp_path / "mine.py")
    assert_refused(done, words)
    assert ("line 1" in done.err) == (text == "def")


@pytest.mark.parametrize(
    ("flow", "words"),
    [
        (
            "above[:2]",
            "effect tipping_block: leakage_flow gives an array of shape (2,)",
        ),
        ("above * np.nan", "leakage_flow gives nan at every point tried"),
        ("np.abs(above, out=state.pressure)", "changes pressure of the state"),
        ("state.presure", "leakage_flow: AttributeError: "),
    ],
)
def test_an_effect_of_no_use_is_told(hmcvt, tmp_path, flow, words):
    before = library()
    (tmp_path / "mine.py").write_text(leaking(flow))
    done = hmcvt("predict", TABLE2, "--effects", tmp_path / "mine.py")
    assert_refused(done, words)
    assert library() == before


@pytest.mark.parametrize(
    ("own", "words"),
    [
        ('    name = "charge_pump"\n', "have the same name and form = '': give yours"),
        ("    pass\n", "no class of Effect with a name or form of its own"),
    ],
)
def test_an_effect_that_would_be_ignored_is_told(hmcvt, tmp_path, own, words):
    before = library()
    (tmp_path / "mine.py").write_text(
        "from hmcvt_core.physics.effects.mechanical import ChargePump\n\n"
        f"class Stiffer(ChargePump):\n{own}"
    )
    done = hmcvt("diagnose", TABLE2, "--effects", tmp_path / "mine.py")
    assert_refused(done, words)
    gc.collect()
    assert library() == before


def test_effects_of_an_installed_package(worked, tmp_path):
    folder, _ = worked
    for name, module in (("tipping", "own_tipping"), ("broken", "broken_effects")):
        info = tmp_path / f"{name}-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n"
        )
        (info / "entry_points.txt").write_text(f"[hmcvt.effects]\n{name} = {module}\n")
    (tmp_path / "own_tipping.py").write_text(EXAMPLE.read_text(encoding="utf-8"))
    (tmp_path / "broken_effects.py").write_text("import absent_thing")
    env = {**os.environ, "PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}"}
    done = process(
        "predict", "tipping.csv", "--params", "tipping.yaml", cwd=folder, env=env
    )
    assert done.code == 0 and "mean |error|" in done.out
    # One that cannot be loaded harms no other, and is named where an effect is missing.
    text = (
        (folder / "tipping.yaml").read_text().replace("tipping_block", "tipping_flap")
    )
    (tmp_path / "flap.yaml").write_text(re.sub("checksum: .*\n", "", text))
    assert process("predict", TABLE2, "--params", HM4, cwd=folder, env=env).code == 0
    assert_refused(
        process("predict", TABLE2, "--params", tmp_path / "flap.yaml", env=env),
        "cannot be loaded: broken_effects (ModuleNotFoundError",
    )


def test_fleet_loads_the_effects_in_its_workers(worked, tmp_path):
    folder, _ = worked
    logs = tmp_path / "logs"
    logs.mkdir()
    rows = (folder / "tipping.csv").read_text().splitlines()
    for name in ("one.csv", "two.csv"):
        (logs / name).write_text("\n".join([*rows[:25], ""]))
    (line,) = re.findall(r"^    (hmcvt fleet .*)", PAGE, re.MULTILINE)
    done = here(
        tmp_path,
        f"{line} --params {folder / 'tipping.yaml'} --no-diagnose --processes 1 --json",
    )
    assert done.code == 0, done.err
    for name in ("one.yaml", "two.yaml"):
        assert "tipping_block" in (tmp_path / "fitted" / name).read_text()
