# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Transmissions of the renewed plant, read from the files that serve them."""

from collections.abc import Mapping, Sequence
from typing import Any

import yaml

import hmcvt_core as hmcvt
from studies.blind.bench.layouts import Layout
from studies.blind.bench.programme import Range
from studies.blind.bench.trains import CM3_PER_REV, GearPath, Train
from studies.blind.twin import BaseTruth

_ENGINE_SPEED = (80.0, 230.0)
#: The stroke stays inside the stops, so that a sensor with a scale never reads beyond them.
_TRACTOR_RANGE = Range((-0.96, 0.96), _ENGINE_SPEED, (20e3, 85e3), (90.0, 480.0))
_FORWARD_RANGE = Range((0.35, 0.96), _ENGINE_SPEED, (16e3, 60e3), (80.0, 320.0))
#: Friction of a unit where its file states none.
_FRICTION = 0.01


def _path(part: Mapping[str, Any], file: Mapping[str, Any]) -> GearPath:
    """Return the gear pairs of one path."""
    pairs = {str(name): ratio for name, ratio in file["gear_pairs"].items()}
    names = [str(name) for name in part["gear_pairs"]]
    efficiency = file["gear_efficiency"]
    if isinstance(efficiency, dict):
        efficiency = next(iter(efficiency.values()))
    order = list(pairs)
    return GearPath(
        ratios=tuple(float(pairs[name]) for name in names),
        efficiency=float(efficiency),
        direction=int(part.get("direction", 1)),
        labels=tuple(order.index(name) for name in names),
    )


def read_trains(model_file: str, stages: Sequence[str]) -> tuple[Train, ...]:
    """Read stages with a planetary row from a parameter file.

    Args:
        model_file: path inside the data of the package.
        stages: names of the stages to read.
    """
    content = yaml.safe_load(hmcvt.data_path(model_file).read_text(encoding="utf-8"))
    file = content["transmission"]
    units = file["pump_motor"]
    trains = []
    for name in stages:
        stage = file["stages"][name]
        output_coupled = stage.get("layout") == "output_coupled"
        on_row = stage["pump"] if output_coupled else stage["motor"]
        trains.append(
            Train(
                name=name,
                pump_on_row=output_coupled,
                ring_ratio=float(file["planetary_rows"][stage["planetary_row"]]),
                mechanical=_path(stage["mechanical"], file),
                mechanical_member=stage["mechanical"]["member"],
                pump=_path(stage["pump"], file),
                motor=_path(stage["motor"], file),
                hydraulic_member=on_row["member"],
                output=_path(stage["output"], file),
                output_member=stage["output"]["member"],
                pump_displacement=units["pump_displacement_cm3_per_rev"] * CM3_PER_REV,
                motor_displacement=units["motor_displacement_cm3_per_rev"]
                * CM3_PER_REV,
                friction=float(units.get("pump_friction", _FRICTION)),
            )
        )
    return tuple(trains)


def _layout(
    model_file: str, stages: Sequence[str], working: Range, drawn: float
) -> Layout:
    """Return a transmission with the stages that its bench tests."""
    content = yaml.safe_load(hmcvt.data_path(model_file).read_text(encoding="utf-8"))
    values = [
        float(content["parameters"][name]["value"])
        for name in ("leakage", "motor_damping", "pump_damping")
    ]
    trains = read_trains(model_file, stages)
    return Layout(
        name="+".join(stages),
        model_file=model_file,
        trains=trains,
        ranges=(working,) * len(trains),
        base=BaseTruth(*values),
        names_stages=len(content["transmission"]["stages"]) > 1,
        drawn=drawn,
    )


LAYOUTS = (
    _layout("params/hm4.yaml", ("HM4",), _TRACTOR_RANGE, 0.3),
    _layout("params/tractor.yaml", ("HM2", "HM3", "HM4"), _TRACTOR_RANGE, 0.35),
    _layout("params/output_coupled.yaml", ("forward",), _FORWARD_RANGE, 0.35),
)
