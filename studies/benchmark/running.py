# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Single pieces of work: write a case, have a method answer one."""

import importlib
import time
from dataclasses import replace
from pathlib import Path

from studies.benchmark import generator, rig
from studies.benchmark.answer import Answer, write_answer
from studies.benchmark.case import RIG, Case
from studies.benchmark.methods import METHODS


def make(folder: Path, name: str, kind: str, seed: int) -> str:
    """Write a case and its truth; return its name."""
    if name.startswith(RIG):
        rig.write_rig_case(folder / "cases", folder / "truth", name)
        return name
    generator.write_case(folder / "cases", folder / "truth", name, kind, seed)
    return name


def run(folder: Path, name: str, method: str) -> str:
    """Have a method answer a case, unless it has; return what was done."""
    path = folder / "answers" / method / f"{name}.json"
    if path.is_file():
        return f"{method} {name}: kept"
    module = importlib.import_module(f"studies.benchmark.methods.{METHODS[method]}")
    case = Case(folder / "cases" / name)
    start = time.process_time()
    given: Answer = module.answer(case)
    seconds = time.process_time() - start
    write_answer(path, replace(given, method=method, seconds=seconds))
    return f"{method} {name}: {given.verdict}, {seconds:.1f} s"
