# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A disk that takes its time, by a library that is loaded before all others."""

from __future__ import annotations

import subprocess
from pathlib import Path

_SHIM = """
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdlib.h>
#include <unistd.h>

static int slow(const char *name, int file)
{
    if (access(getenv("SLOW_DISK"), F_OK) == 0)
        usleep(100000);
    return ((int (*)(int))dlsym(RTLD_NEXT, name))(file);
}

int fsync(int file) { return slow("fsync", file); }
int fdatasync(int file) { return slow("fdatasync", file); }
"""


def launcher(folder: Path) -> tuple[tuple[str, ...], Path]:
    """Make what goes before a command, and name the file that makes its fsync take 100 ms.

    The disk is slow as long as the file is there.
    """
    library, switch = folder / "slow_disk.so", folder / "slow"
    subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-x", "c", "-", "-o", str(library), "-ldl"],
                   input=_SHIM, text=True, check=True)
    return ("env", f"LD_PRELOAD={library}", f"SLOW_DISK={switch}"), switch
