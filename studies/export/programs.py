# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Compilers, an emulated Cortex-M4 and the tests, run on exported C."""

import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from tests.export.c_library import WARNINGS

ROOT = Path(__file__).parents[2]
BOARD = ROOT / "tests" / "export" / "cortex_m4"
SANITIZERS = ("-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
FLAGS = {
    "-O0": ("-O0",),
    "-O2": ("-O2",),
    "-O1 with address and undefined sanitizers": ("-O1", *SANITIZERS),
}
CORTEX = "arm-none-eabi-gcc"
CPU = ("-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard")
CORTEX_TOOLS = (CORTEX, "arm-none-eabi-size", "qemu-system-arm")


class SelfTests(NamedTuple):
    """Self-tests that one compiler built with one set of flags."""

    compiler: str
    flags: str
    passed: int
    run: int


class CortexFigures(NamedTuple):
    """Size and speed on a Cortex-M4.

    Attributes:
        code: code and constants [bytes].
        data: variables that are not constant [bytes].
        self_test: last line that the self-test prints.
        predict: instructions of a point.
        stroke: instructions of the best displacement ratio at a held engine speed.
        speed: instructions of the best engine speed at a held output speed.
    """

    folder: str
    code: int
    data: int
    self_test: str
    predict: int
    stroke: int
    speed: int


class TestFigures(NamedTuple):
    """Result of the tests in tests/export."""

    passed: int
    failed: int
    skipped: Sequence[str]
    seconds: float


def compilers() -> list[str]:
    """Return the C compilers of this machine."""
    return [name for name in ("gcc", "clang") if shutil.which(name) is not None]


def self_tests(folders: Sequence[Path]) -> list[SelfTests]:
    """Build and run the self-test of every folder with every compiler and set of flags."""
    rows = []
    for compiler in compilers():
        for name, flags in FLAGS.items():
            passed = 0
            for folder in folders:
                passed += int(_self_test_passes(folder, compiler, flags))
            rows.append(SelfTests(compiler, name, passed, len(folders)))
    return rows


def _self_test_passes(folder: Path, compiler: str, flags: Sequence[str]) -> bool:
    """Return whether a folder builds without a message and its self-test passes."""
    command = [compiler, "-std=c99", *WARNINGS, *flags]
    command += ["hmcvt_model.c", "check.c", "-lm", "-o", "check"]
    built = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    if built.returncode != 0 or built.stderr:
        return False
    done = subprocess.run(["./check"], cwd=folder, capture_output=True, text=True)
    return done.returncode == 0 and not done.stderr


def cortex_figures(folders: Sequence[Path]) -> list[CortexFigures]:
    """Return sizes and instructions on a Cortex-M4; empty without its tools."""
    if not all(shutil.which(tool) for tool in CORTEX_TOOLS):
        return []
    return [_cortex_figures(folder) for folder in folders]


def _cortex_figures(folder: Path) -> CortexFigures:
    compile_c = [CORTEX, "-std=c99", "-O2", *CPU, f"-I{folder}"]
    _output([*compile_c, "-c", "hmcvt_model.c", "-o", "model.o"], folder)
    sizes = _output(["arm-none-eabi-size", "model.o"], folder).splitlines()[1].split()
    check = _on_board(compile_c, folder, folder / "check.c")
    times = _on_board(compile_c, folder, Path(__file__).with_name("cortex_m4_time.c"))
    predict, stroke, speed = (int(number) for number in times.split())
    return CortexFigures(
        folder.name,
        int(sizes[0]),
        int(sizes[1]) + int(sizes[2]),
        check.strip(),
        predict,
        stroke,
        speed,
    )


def _on_board(compile_c: Sequence[str], folder: Path, main: Path) -> str:
    """Build a program with the model and run it on the emulated board."""
    linking = ["-T", str(BOARD / "memory.ld"), "--specs=rdimon.specs", "-lm"]
    sources = ["hmcvt_model.c", str(main), str(BOARD / "startup.c")]
    _output([*compile_c, *sources, *linking, "-o", "program.elf"], folder)
    files = "enable=on,target=native,arg=check,arg=vectors.csv"
    machine = ["qemu-system-arm", "-machine", "mps2-an386", "-nographic"]
    options = ["-icount", "shift=0", "-semihosting-config", files]
    return _output([*machine, *options, "-kernel", "program.elf"], folder)


def _output(command: Sequence[str], folder: Path) -> str:
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, check=True, timeout=300
    )
    return done.stdout + done.stderr


def test_figures(folder: Path) -> TestFigures:
    """Run the tests in tests/export."""
    result = folder / "tests.xml"
    command = [sys.executable, "-m", "pytest", "-q", "tests/export"]
    subprocess.run([*command, f"--junit-xml={result}"], cwd=ROOT, capture_output=True)
    (suite,) = ElementTree.parse(result).getroot().iter("testsuite")
    failed = int(suite.attrib["failures"]) + int(suite.attrib["errors"])
    skipped = []
    for case in suite.iter("testcase"):
        reason = case.find("skipped")
        if reason is not None:
            skipped.append(f"{case.attrib['name']}: {reason.attrib['message']}")
    passed = int(suite.attrib["tests"]) - failed - len(skipped)
    return TestFigures(passed, failed, skipped, float(suite.attrib["time"]))


def fmu_tool_verdicts(paths: Sequence[Path]) -> list[str]:
    """Return what the FMU Manipulation Toolbox says of FMUs; empty without it."""
    tool = shutil.which("fmutool")
    if tool is None:
        return []
    verdicts = []
    for path in paths:
        done = subprocess.run(
            [tool, "-input", str(path), "-check"], capture_output=True, text=True
        )
        lines = re.findall(
            r"This FMU seems.*|No semantic error.*|ERROR.*", done.stdout + done.stderr
        )
        verdicts.append(f"{path.name}: {' '.join(lines)}")
    return verdicts


def versions() -> list[str]:
    """Return the first line that each tool says of its version."""
    lines = []
    tools = (*compilers(), *CORTEX_TOOLS[::2], "cppcheck", "octave", "wine")
    for tool in tools:
        path = shutil.which(tool)
        if path is not None:
            lines.append(_output([path, "--version"], ROOT).splitlines()[0])
    return lines
