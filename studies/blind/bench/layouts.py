# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Transmissions on the bench: their stages, working ranges, and the file that serves them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from studies.blind.bench.plant import Settings, Stand, State
from studies.blind.bench.programme import Programme, Range
from studies.blind.bench.trains import FORWARD, HM3, HM4, Train
from studies.blind.effect import Effect, FloatArray
from studies.blind.twin import BaseTruth

#: Base parameters of the served files: leakage, damping of motor and pump.
_PAPER_BASE = BaseTruth(3.012306786564311e-11, 0.20533941538905087, 0.07887078704654166)
_FORWARD_BASE = BaseTruth(5.0e-12, 0.05, 0.08)
_TRACTOR_BASE = BaseTruth(
    3.012306786564311e-11, 0.20533941538905087, 0.07887078704654166
)
_ENGINE_SPEED = (78.5, 230.0)
_TRACTOR_RANGE = Range((-1.0, 1.0), _ENGINE_SPEED, (20e3, 85e3), (90.0, 480.0))
_FORWARD_RANGE = Range((0.35, 1.0), _ENGINE_SPEED, (16e3, 60e3), (80.0, 320.0))


@dataclass(frozen=True)
class Layout:
    """A transmission on the bench.

    Attributes:
        name: of the layout.
        model_file: parameter file that serves it.
        trains: its stages that are tested.
        ranges: working range of each stage.
        base: parameters of the served model.
        names_stages: whether the bench has a column of the stage.
        drawn: how often it is drawn.
    """

    name: str
    model_file: str
    trains: tuple[Train, ...]
    ranges: tuple[Range, ...]
    base: BaseTruth
    names_stages: bool
    drawn: float

    @property
    def output_coupled(self) -> bool:
        """Whether every stage tested is output-coupled."""
        return all(train.pump_on_row for train in self.trains)


LAYOUTS = (
    Layout(
        "HM4", "params/hm4.yaml", (HM4,), (_TRACTOR_RANGE,), _PAPER_BASE, False, 0.5
    ),
    Layout(
        "HM3+HM4",
        "params/tractor.yaml",
        (HM3, HM4),
        (_TRACTOR_RANGE, _TRACTOR_RANGE),
        _TRACTOR_BASE,
        True,
        0.2,
    ),
    Layout(
        "output_coupled",
        "params/output_coupled.yaml",
        (FORWARD,),
        (_FORWARD_RANGE,),
        _FORWARD_BASE,
        True,
        0.3,
    ),
)


@dataclass(frozen=True)
class Machine:
    """A transmission with base parameters and effects, over all its stages."""

    layout: Layout
    base: BaseTruth
    effects: tuple[Effect, ...] = ()

    def run(self, settings: Settings, stage: np.ndarray) -> State:
        """Bring tests of several stages to rest; `stage` numbers that of each test."""
        parts: list[tuple[np.ndarray, State]] = []
        for number, train in enumerate(self.layout.trains):
            index = np.flatnonzero(stage == number)
            if len(index) == 0:
                continue
            stand = Stand(train, self.base, self.effects)
            parts.append((index, stand.run(settings.select(index))))
        return _joined(parts, len(settings))


def _joined(parts: Sequence[tuple[np.ndarray, State]], count: int) -> State:
    values: dict[str, np.ndarray] = {}
    for field in fields(State):
        kind = bool if field.name == "runs" else float
        values[field.name] = np.zeros(count, dtype=kind)
        for index, state in parts:
            values[field.name][index] = getattr(state, field.name)
    return State(**values)


def settings_of(
    programme: Programme, tank: FloatArray, films: FloatArray, approach: FloatArray
) -> Settings:
    """Return the settings of a programme at temperatures of tank and films [deg C]."""
    return Settings(
        displacement_ratio=programme.displacement_ratio,
        engine_speed=programme.engine_speed,
        load_torque=programme.load_torque,
        oil_temperature=tank,
        film_temperature=films,
        approach=approach,
    )
