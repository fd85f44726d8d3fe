# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""`hmcvt estimate`: the bus as a dynamometer."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from concurrent.futures import Executor
from contextlib import AbstractContextManager
from typing import Any

import click

from hmcvt_core.errors import InputError
from hmcvt_core.model.engine import load_engine

from ..estimation import Estimate, EstimateSettings
from ..fleet.executors import Processes, on_cluster
from ..fleet.road import Job, Together, estimate_together, logs_in
from ..report.operating_points import draw_operating_points
from ..report.pictures import save
from . import common, logs
from .common import Answer

_NUMBER = r"(\d+(?:\.\d+)?)"
_POWER_RANGE = re.compile(rf"{_NUMBER}\s*\.\.\s*{_NUMBER}\s*(k?W)")
SOME_BROKEN = 3
"""Exit code when some of several logs are broken."""

_CHANNELS = (
    "engine_speed",
    "engine_torque",
    "engine_power",
    "fuel_rate",
    "output_speed",
    "displacement_ratio",
    "stage",
)
"""Quantities of a log that an option may name."""


_channel_options = common.options(
    *(
        logs.quantity_option(name, f"Channel of the {name.replace('_', ' ')}.")
        for name in _CHANNELS
    )
)


@common.command(
    "estimate",
    """
  hmcvt estimate drive.blf --params params/tractor.yaml --engine params/engine.yaml
  hmcvt estimate drive.log --dbc maker.dbc --params params/tractor.yaml --out series.csv
  hmcvt estimate season --params params/tractor.yaml --map points.csv --json""",
    logs.options_of_logs,
    common.picture_option,
    common.params_option,
)
@click.argument("paths", metavar="LOG...", nargs=-1, required=True)
@click.option(
    "--engine",
    metavar="E.yaml",
    help="Fuel map: fuel, and the torque where the bus states fuel alone.",
)
@click.option(
    "--out",
    type=common.OutputFile(),
    metavar="SERIES.csv",
    help="Write the estimate at every row, with intervals of 90 %.",
)
@click.option(
    "--map",
    "map_file",
    type=common.OutputFile(),
    metavar="MAP.csv",
    help="Write hours and energies by operating point.",
)
@_channel_options
@click.option(
    "--mapping",
    metavar="FILE.yaml",
    help="Channels and settings of a file that hmcvt import --save-mapping wrote.",
)
@click.option(
    "--torque-bias",
    type=common.fraction,
    default=EstimateSettings.torque_bias,
    show_default=True,
    help="Standard deviation of the bias of the engine torque.",
)
@click.option(
    "--delay",
    type=float,
    default=EstimateSettings.delay,
    show_default=True,
    help="Largest delay between messages in s.",
)
@click.option(
    "--engine-inertia",
    type=float,
    default=EstimateSettings.engine_inertia,
    show_default=True,
    help="Of engine and flywheel in kg m2, known within half of it.",
)
@click.option(
    "--wear",
    type=common.fraction,
    default=EstimateSettings.wear,
    show_default=True,
    help="By which part the leakage may have grown since the identification; 0: as identified.",
)
@click.option(
    "--hydraulics",
    metavar="LOW..HIGH",
    help="Power of pumps at the engine that the bus does not state, such as 0..6kW.",
)
@click.option(
    "--identified-temperature",
    type=float,
    metavar="DEG_C",
    help="Oil temperature of the identification.  [default: as the parameter file states]",
)
@click.option(
    "--step",
    type=float,
    default=EstimateSettings.step,
    show_default=True,
    help="Time between rows in s.",
)
@click.option(
    "--processes",
    type=click.IntRange(1, 1024),
    help="Logs side by side on this machine.  [default: cores]",
)
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Work on the Dask cluster with this scheduler instead.",
)
def command(
    paths: tuple[str, ...],
    engine: str | None,
    out: str | None,
    map_file: str | None,
    mapping: str | None,
    torque_bias: float,
    delay: float,
    engine_inertia: float,
    wear: float,
    hydraulics: str | None,
    identified_temperature: float | None,
    step: float,
    processes: int | None,
    scheduler: str | None,
    picture: str | None,
    params: str | None,
    **channels: Any,
) -> Answer:
    """Estimate output torque and power, losses and efficiency from the log of a machine.

    LOG is MDF4, TDMS, or a CAN trace (.blf, .asc, .trc, candump's .log); of a folder, all logs are
    added up. The bus states engine speed, engine torque (or fuel) and output speed; the model
    gives the rest, with intervals of 90 %.
    """
    common.one_of("say where to work", processes=processes, scheduler=scheduler)
    machine_logs = logs_in(paths)
    given = logs.taken_from(channels)
    inputs = [*paths, given["dbc"], mapping, engine, params]
    common.keep_inputs(inputs, [out, map_file, picture])
    stated, dbc, _ = logs.stated_by(mapping, channels, given)
    low, high = _power_range(hydraulics)
    job = Job(
        common.model_from(params),
        None if engine is None else load_engine(engine),
        dbc,
        stated,
        EstimateSettings(
            step=step,
            torque_bias=torque_bias,
            delay=delay,
            engine_inertia=engine_inertia,
            wear=wear,
            hydraulics_low=low,
            hydraulics_high=high,
            oil_temperature=identified_temperature,
        ),
    )
    if len(machine_logs) == 1:
        together = Together(_one(str(machine_logs[0]), job, out), ())
    else:
        if out is not None:
            raise InputError(f"--out takes one log, not {len(machine_logs)}")
        together = _several(job, machine_logs, processes, scheduler)
    result = together.estimate
    if map_file is not None:
        result.write_map(map_file)
    if picture is not None:
        save(draw_operating_points, picture, result)
    lines = [f"broken: {line}" for line in together.broken]
    lines.append(result.report())
    value: Mapping[str, Any] = {**result.to_dict(), "broken": list(together.broken)}
    return Answer(value, lines, SOME_BROKEN if together.broken else 0)


def _power_range(text: str | None) -> tuple[float, float]:
    """Return the two powers [W] of a text such as `0..6kW`; 0 and 0 without one."""
    if text is None:
        return 0.0, 0.0
    match = _POWER_RANGE.fullmatch(text.strip())
    if match is None:
        raise InputError(
            f"--hydraulics {text!r}: needs two powers in W or kW, as 0..6kW"
        )
    unit = 1e3 if match[3] == "kW" else 1.0
    return unit * float(match[1]), unit * float(match[2])


def _one(path: str, job: Job, out: str | None) -> Estimate:
    with common.Progress("estimating") as progress:
        return job.run(path, out, progress)


def _several(
    job: Job, paths: Any, processes: int | None, scheduler: str | None
) -> Together:
    executor: AbstractContextManager[Executor]
    if scheduler is not None:
        executor = on_cluster(scheduler)
    else:
        executor = Processes(min(processes or os.cpu_count() or 1, len(paths)))
    with common.Progress("estimating") as progress:
        return estimate_together(
            job,
            paths,
            executor,
            lambda done, total: progress(f"{done} of {total} logs"),
        )
