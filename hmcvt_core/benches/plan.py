# SPDX-License-Identifier: Apache-2.0
"""Test plans: operating points that have not been measured yet."""

from __future__ import annotations

import os

import numpy as np

from ..errors import InputError
from ..files.bench import BenchSamples
from ..files.columns import read_columns
from ..model.model import EfficiencyModel
from ..transmission.ranges import REQUIRED_COLUMNS


def read_plan(
    path: str | os.PathLike[str], model: EfficiencyModel, output_speed: bool = False
) -> BenchSamples:
    """Read operating points and fill in what a model expects to be read there.

    Args:
        path: CSV as for `read_bench`; column `efficiency` may be missing and is not used.
        model: supplies efficiency and output speed.
        output_speed: whether the output speed will be read; a column of that name says so too.

    Raises:
        InputError: as `read_bench`, or the model has no answer at a point.
    """
    found = read_columns(path, REQUIRED_COLUMNS[:3])
    known = found.known
    ratio, speed, torque = (known[name] for name in REQUIRED_COLUMNS[:3])
    temperature = known.get("oil_temperature")
    efficiency = model.efficiency(ratio, speed, torque, temperature)
    stalled = np.flatnonzero(np.isnan(efficiency))
    if len(stalled):
        raise InputError(f"{path}: row {found.rows[stalled[0]]}: load_torque = "
                         f"{torque[stalled[0]]:g} cannot be carried there")
    reads_speed = output_speed or "output_speed" in known
    return BenchSamples(
        ratio, speed, torque, efficiency,
        output_speed=model.output_speed(ratio, speed, torque, temperature) if reads_speed else None,
        oil_temperature=temperature, efficiency_std=known.get("efficiency_std"),
        source=found.source, sha256=found.sha256)
