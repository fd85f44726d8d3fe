# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""C compilers of this machine, and the shared libraries that they build."""

import os
import platform
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from hmcvt_core.errors import InputError

WINDOWS_CROSS_COMPILER = "x86_64-w64-mingw32-gcc"
_SHARED = ("-shared", "-std=c99", "-O2", "-ffp-contract=off")
# A simulator may load several FMUs into one name space: only functions of FMI are visible.
_NATIVE_OPTIONS = ("-fPIC", "-fvisibility=hidden")


class Target(NamedTuple):
    """A kind of machine that a shared library is built for.

    Attributes:
        fmi2: folder of its binaries in FMI 2.0.
        fmi3: the same in FMI 3.0.
        suffix: of a shared library.
        compiler: path of the compiler, and words that CC states behind it.
        options: further options of the compiler.
    """

    fmi2: str
    fmi3: str
    suffix: str
    compiler: tuple[str, ...]
    options: tuple[str, ...]


def targets() -> list[Target]:
    """Return this machine, and Windows where its cross compiler is installed.

    Raises:
        InputError: there is no C compiler for this machine.
    """
    native = _native(_native_compiler())
    machines = [native]
    cross = shutil.which(WINDOWS_CROSS_COMPILER)
    if cross is not None and native.fmi2 != "win64":
        machines.append(_windows((cross,)))
    return machines


def _native_compiler() -> tuple[str, ...]:
    """Return the command of a C compiler: that of the variable CC, or a usual one."""
    words = os.environ.get("CC", "").split()
    if words:
        path = shutil.which(words[0])
        if path is None:
            raise InputError(f"CC = {words[0]!r} is not a program on this machine")
        return (path, *words[1:])
    for name in ("cc", "gcc", "clang"):
        path = shutil.which(name)
        if path is not None:
            return (path,)
    raise InputError(
        "no C compiler (CC, cc, gcc or clang) on this machine; an FMU holds a binary: "
        "install one, such as gcc"
    )


def _windows(compiler: tuple[str, ...]) -> Target:
    # Without a time stamp, and without an address that follows from the name of the file, the
    # same model gives the same bytes.
    linking = "-Wl,--no-insert-timestamp,--disable-auto-image-base"
    options = ("-static-libgcc", "-s", linking)
    return Target("win64", "x86_64-windows", ".dll", compiler, options)


def _native(compiler: tuple[str, ...]) -> Target:
    machine = platform.machine().lower()
    processor = "aarch64" if machine in ("arm64", "aarch64") else "x86_64"
    system = platform.system()
    if system == "Windows":
        return _windows(compiler)
    if system == "Darwin":
        return Target(
            "darwin64", f"{processor}-darwin", ".dylib", compiler, _NATIVE_OPTIONS
        )
    fmi2 = "linux64" if processor == "x86_64" else f"{processor}-linux"
    return Target(fmi2, f"{processor}-linux", ".so", compiler, _NATIVE_OPTIONS)


def build_shared(
    target: Target, folder: Path, sources: Sequence[str], includes: Path, result: Path
) -> None:
    """Build a shared library.

    Args:
        target: machine and compiler.
        folder: of the sources.
        sources: file names.
        includes: folder of further headers.
        result: file to write.

    Raises:
        InputError: the compiler fails; its first line is given.
    """
    command = [
        *target.compiler,
        *_SHARED,
        *target.options,
        "-DFMI2_OVERRIDE_FUNCTION_PREFIX",
        "-DFMI3_OVERRIDE_FUNCTION_PREFIX",
        f"-I{includes}",
        *sources,
        "-lm",
        "-o",
        str(result.absolute()),
    ]
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        lines = done.stderr.strip().splitlines() or ["no message"]
        raise InputError(f"{target.compiler[0]} fails: {lines[0]}")
