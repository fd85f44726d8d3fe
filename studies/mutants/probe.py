# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Answers of the core, as one JSON document: `python -m studies.mutants.probe [REFERENCE]`.

A mutant that leaves all of them as they are changes no answer. Everything goes through the command
line, so that what is asked stays the same however the core is built.
"""

import json
import os
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from click.testing import CliRunner

import hmcvt_core as hmcvt
from hmcvt_core.files.bench import write_bench
from hmcvt_core.physics.effects import library
from hmcvt_tools.cli.commands import cli
from studies.blind.campaign import make_campaign
from studies.units.simulate import simulated

_POINT = "--engine-speed {} --load-torque {} --displacement-ratio {}"
OF_A_MODEL = (
    "map --json --steps 9 4 5 --load-torque-limits 5 600",
    "predict --json simulated.csv",
    f"predict --json {_POINT} --oil-temperature 75".format(120, 200, 0.3),
    f"predict --json {_POINT}".format(60, 600, -1),
    f"breakdown --json {_POINT} --oil-temperature 75".format(200, 150, -0.7),
    f"breakdown --json {_POINT}".format(90, 40, 0),
    "optimum --json --engine-speed 150 --load-torque 200",
    f"optimum --json --hold output_speed {_POINT}".format(160, 180, -0.3),
)
OF_A_BENCH = (
    "identify --json table2.csv --fit 1,2,4-6",
    "identify table2.csv --fit 1,2,4-6 --formulation published",
    "identify --json simulated.csv --gear-efficiency 0.97",
    "identify simulated.csv --fit 1",
    "diagnose simulated.csv",
    "next --json simulated.csv",
    "watch --json simulated.csv",
    "separable --json simulated.csv",
    "separable simulated.csv --matrix",
)
OF_A_TRACTOR = (
    "optimum --json --output-speed 250 --output-power 40kW --engine engine.yaml",
    "identify --json simulated.csv --refine",
    "map --json --output-speed 350 --steps 9 5 4 --engine engine.yaml",
    "predict --json --stage HM3 --engine-speed 190 --output-speed 125 --engine-torque 180",
    "predict --json --stage HM1 --engine-speed 150 --displacement-ratio 0.4 --output-torque -400",
)
OF_A_UNIT = (
    "unit --json {0} --kind {1} --above pressure=0.7 --into tractor.yaml",
    "unit {0} --kind {1}",
)
TWINS = ("charge_pump", "stroke_leakage", "oil_temperature", "torque_sensor")


def commands() -> Iterator[str]:
    """What is asked, of files written into the folder where one stands."""
    for name in (
        "data/table2.csv",
        "data/simulated.csv",
        "params/tractor.yaml",
        "params/engine.yaml",
        "params/engine.csv",
    ):
        Path(Path(name).name).write_bytes(hmcvt.data_path(name).read_bytes())
    yield from OF_A_BENCH
    models = {
        name: hmcvt.load_model(hmcvt.data_path(f"params/{name}.yaml"))
        for name in ("hm4", "paper", "hydrostatic", "output_coupled")
    }
    for kind in library():
        effect = kind(
            **{parameter.name: parameter.typical for parameter in kind.parameters()}
        )
        models[kind.__name__] = replace(models["hm4"], effects=(effect,))
    for name, model in models.items():
        hmcvt.save_model(model, f"{name}.yaml")
        yield from (f"{each} --params {name}.yaml" for each in OF_A_MODEL)
    yield from (f"{each} --params tractor.yaml" for each in OF_A_TRACTOR)
    for names in ((), ("orifice_leakage",), ("barrel_churning", "compressibility")):
        unit = vars(simulated(names, 1))
        table = {
            each: unit[each] + 0.0 * unit["speed"]
            for each in (
                "displacement",
                "displacement_ratio",
                "speed",
                "pressure",
                "flow_loss",
                "torque_loss",
            )
        }
        name = f"unit{len(names)}.csv"
        np.savetxt(
            name,
            np.stack([*table.values()], 1),
            delimiter=",",
            header=",".join(table),
            comments="",
        )
        yield from (each.format(name, unit["kind"]) for each in OF_A_UNIT)
    for seed, name in enumerate(TWINS):
        found = make_campaign(
            seed,
            ((name, 0.015),),
            samples=32,
            pressure_gauge=(0.0, 0.0) if seed % 2 else None,
            temperature_swing=25.0 if name == "oil_temperature" else None,
        )
        write_bench(f"{name}.csv", hmcvt.BenchSamples(**found.samples))
        yield f"diagnose --json {name}.csv"


def document() -> Iterator[tuple[str, Any]]:
    """All answers by name, an error among them; and the files of the models."""
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            for line in commands():
                done = CliRunner().invoke(cli, line.split())
                told = done.output or repr(done.exception)
                yield (
                    line,
                    json.loads(told, object_hook=_undated) if told[0] in "[{" else told,
                )
            yield from (
                (path.name, path.read_text()) for path in sorted(Path().glob("*.yaml"))
            )
        finally:
            os.chdir(before)


def changed(reference: dict[str, Any]) -> str | None:
    """The first answer that is another than the one known; None when all agree."""
    return next(
        (name for name, found in document() if not same(found, reference[name])), None
    )


def _undated(entries: dict[str, Any]) -> dict[str, Any]:
    """Leave out the date of a fit."""
    return {key: value for key, value in entries.items() if key != "date"}


def same(one: Any, other: Any) -> bool:
    """Tell whether two documents agree, numbers within a millionth."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(
            same(one[key], other[key]) for key in one
        )
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, float) and isinstance(other, float):
        return bool(np.isclose(one, other, rtol=1e-6, atol=1e-12, equal_nan=True))
    return bool(one == other)


if __name__ == "__main__":
    if sys.argv[1:]:
        print(changed(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))) or "")
    else:
        print(json.dumps(dict(document())))
