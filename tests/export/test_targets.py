# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The exported C on a controller and under a checker of MISRA C; skipped without the tools."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

BOARD = Path(__file__).with_name("cortex_m4")
CORTEX = "arm-none-eabi-gcc"
CPU = ("-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard")
BOUND = 16 * 1024
ADVISORY = {"2.4", "2.5", "8.7", "8.11"}
"""Rules of category advisory; docs/export-reference.md says why each is not followed."""


def needs(*tools):
    missing = [tool for tool in tools if shutil.which(tool) is None]
    return pytest.mark.skipif(bool(missing), reason=f"no {', '.join(missing)}")


def checked(*command, cwd):
    done = subprocess.run(
        [*map(str, command)], cwd=cwd, capture_output=True, text=True, timeout=100
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done


@needs(CORTEX, "arm-none-eabi-size", "qemu-system-arm")
@pytest.mark.parametrize("precision", ["double", "single"])
@pytest.mark.parametrize("name", ["tractor", "output_coupled"])
def test_self_test_passes_on_a_cortex_m4(exported, name, precision, tmp_path):
    built = exported(name, precision)
    compile_c = (CORTEX, "-std=c99", "-O2", *CPU, "-Wall", "-Wextra", "-Werror")
    folder = built.folder
    checked(*compile_c, "-c", "hmcvt_model.c", "-o", tmp_path / "model.o", cwd=folder)
    size = checked("arm-none-eabi-size", tmp_path / "model.o", cwd=folder).stdout
    text, data, bss = map(int, size.splitlines()[1].split()[:3])
    assert text < BOUND
    assert data == bss == 0
    program = tmp_path / "check.elf"
    sources = ("hmcvt_model.c", "check.c", BOARD / "startup.c")
    linking = ("-T", BOARD / "memory.ld", "--specs=rdimon.specs", "-lm", "-o", program)
    checked(*compile_c, *sources, *linking, cwd=folder)
    machine = ("qemu-system-arm", "-machine", "mps2-an386", "-nographic")
    files = "enable=on,target=native,arg=check,arg=vectors.csv"
    done = checked(
        *machine, "-semihosting-config", files, "-kernel", program, cwd=folder
    )
    assert "answers agree with Python" in done.stdout + done.stderr


@needs("cppcheck")
@pytest.mark.parametrize(
    ("name", "precision"), [("tractor", "double"), ("output_coupled", "single")]
)
def test_misra_rules_that_are_mandatory_or_required(exported, name, precision):
    done = subprocess.run(
        [
            "cppcheck",
            "--addon=misra",
            "--std=c99",
            "--enable=style,warning,performance,portability",
            "--suppress=missingIncludeSystem",
            "hmcvt_model.c",
        ],
        cwd=exported(name, precision).folder,
        capture_output=True,
        text=True,
        timeout=100,
    )
    rules = set(re.findall(r"\[misra-c2012-([\d.]+)\]", done.stderr))
    assert rules <= ADVISORY
    others = [
        line
        for line in done.stderr.splitlines()
        if ": " in line and "misra" not in line
    ]
    findings = [line for line in others if re.search(r": (error|warning)", line)]
    assert findings == []
