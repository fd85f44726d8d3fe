# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Efficiency of hydromechanical CVTs: predict, identify, optimise, diagnose.

    import hmcvt_core as hmcvt
    model = hmcvt.load_model("params/hm4.yaml")
    model.efficiency(displacement_ratio, engine_speed, load_torque)

SI units throughout: rad/s, N m, m3/rad, Pa; efficiency and displacement ratio are plain fractions.

monitoring      the watch on a stream of samples
benches         what the diagnosis needs of a transmission, a unit or another machine
identification  bench samples in, parameters out
model           lookup, optimum, map, parameter file
diagnosis       inference on any system; knows no transmission
physics         power balance, effects, formulas of the paper
files           the core's own files: bench CSV, YAML, atomic writes
transmission    registry of quantities, units and words of headings, gear train, parameters

`interface` adds the names that packages built on the core use; `errors` has the exceptions and
`version` the version. `moved` looks up names that moved to `hmcvt_tools`; `cli` and `mission` only
forward to them.

Needs NumPy, SciPy and PyYAML alone. Commands, foreign tables, logs, reports and exports are in
`hmcvt_tools`.
"""

import typing

from . import moved
from .benches.own_system import (
    SystemEffect,
    load_system,
    observe_system,
    read_observations,
)
from .benches.simulator import Parameter, Simulator, Switch
from .benches.transmission import diagnose, next_test, separable
from .benches.unit import diagnose_unit
from .diagnosis import Advice, Diagnosis, Isolability, diagnose_system
from .diagnosis.observations import Observations
from .diagnosis.system import Array, Axis, BaseParameters, Channel, Points, System
from .errors import HmcvtError, IdentificationError, InputError
from .files import data_path
from .files.bench import BenchSamples, read_bench, write_bench
from .identification import Identification, Schedule, identify
from .model.breakdown import Breakdown
from .model.domain import Domain, EfficiencyMap, Prediction
from .model.engine import Engine, load_engine
from .model.model import EfficiencyModel
from .model.optimum import DriveOptimum, Optimum
from .model.parameter_file import load_model, load_stage, save_model
from .monitoring import Opening, Watch, watch
from .physics.effects import load_effects
from .physics.effects.base import Effect, ShaftState, Value, shape, size
from .transmission.parameters import HydraulicParameters
from .transmission.stage import GearPair, Path, PumpMotor, Stage
from .version import __version__

__all__ = [
    "Advice",
    "Array",
    "Axis",
    "BaseParameters",
    "BenchSamples",
    "Breakdown",
    "Channel",
    "Diagnosis",
    "Domain",
    "DriveOptimum",
    "Effect",
    "EfficiencyMap",
    "EfficiencyModel",
    "Engine",
    "Estimate",
    "EstimateSettings",
    "GearPair",
    "HmcvtError",
    "HydraulicParameters",
    "Identification",
    "IdentificationError",
    "InputError",
    "Isolability",
    "Observations",
    "Opening",
    "Optimum",
    "Parameter",
    "Path",
    "Points",
    "Prediction",
    "PumpMotor",
    "Schedule",
    "ShaftState",
    "Simulator",
    "Stage",
    "Switch",
    "System",
    "SystemEffect",
    "Value",
    "Watch",
    "__version__",
    "data_path",
    "diagnose",
    "diagnose_system",
    "diagnose_unit",
    "estimate",
    "export_c",
    "export_fmu",
    "export_mat",
    "identify",
    "load_effects",
    "load_engine",
    "load_model",
    "load_stage",
    "load_system",
    "next_test",
    "observe_system",
    "read_bench",
    "read_observations",
    "read_raw_bench",
    "read_unit",
    "save_model",
    "separable",
    "shape",
    "size",
    "watch",
    "write_bench",
    "write_html",
]

_MOVED = frozenset(
    {
        "Estimate",
        "EstimateSettings",
        "estimate",
        "export_c",
        "export_fmu",
        "export_mat",
        "read_raw_bench",
        "read_unit",
        "write_html",
    }
)


def __getattr__(name: str) -> typing.Any:
    """Return a name that moved to `hmcvt_tools`, with a `DeprecationWarning`."""
    return moved.from_tools(__name__, name, _MOVED)


def __dir__() -> list[str]:
    return sorted({*globals(), *_MOVED})
