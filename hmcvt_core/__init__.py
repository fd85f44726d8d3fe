# SPDX-License-Identifier: Apache-2.0
"""Efficiency of hydromechanical CVTs: predict, identify, optimise, diagnose.

    import hmcvt_core as hmcvt
    model = hmcvt.load_model("params/hm4.yaml")
    model.efficiency(displacement_ratio, engine_speed, load_torque)

SI units throughout: rad/s, N m, m3/rad, Pa; efficiency and displacement ratio are plain fractions.
"""

from .bench import BenchSamples, read_bench, write_bench
from .breakdown import Breakdown
from .diagnosis import Diagnosis, Isolability, diagnose, separable
from .domain import Domain
from .efficiency_map import EfficiencyMap
from .errors import HmcvtError, IdentificationError, InputError
from .identification import Identification, identify, identify_gear_efficiency
from .model import EfficiencyModel, Prediction
from .optimum import Optimum
from .parameter_file import load_model, load_stage, save_model
from .parameters import HydraulicParameters
from .raw_bench import read_raw_bench
from .resources import data_path
from .stage import GearPair, Path, PumpMotor, Stage
from .version import __version__

__all__ = [
    "BenchSamples", "Breakdown", "Diagnosis", "Domain", "EfficiencyMap", "EfficiencyModel",
    "GearPair", "HmcvtError", "HydraulicParameters", "Identification", "IdentificationError",
    "InputError", "Isolability", "Optimum", "Path", "Prediction", "PumpMotor", "Stage",
    "__version__", "data_path", "diagnose", "identify", "identify_gear_efficiency",
    "load_model", "load_stage", "read_bench", "read_raw_bench", "save_model", "separable",
    "write_bench",
]
