# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Bench campaigns simulated from the served model, with effects that the diagnoser is not told."""

import functools
import os
import pickle
from dataclasses import replace

import numpy as np

import hmcvt_core as hmcvt
from hmcvt_core.benches.transmission import Transmission, observe
from hmcvt_core.diagnosis.fitting.hypothesis import Hypothesis
from hmcvt_core.diagnosis.fitting.refit import refit
from hmcvt_core.physics.effects.actuator import DisplacementDeadBand
from hmcvt_core.physics.effects.hydraulic import OilTemperature, PressureLeakage
from hmcvt_core.physics.effects.mechanical import ChargePump, Churning, PlanetaryMesh
from hmcvt_core.transmission.ranges import OperatingPoints

STAGE = hmcvt.load_stage(hmcvt.data_path("params/transmission.yaml"))
BASE = hmcvt.EfficiencyModel(STAGE, hmcvt.HydraulicParameters(2e-11, 0.12, 0.2))
NOISE = 0.003
SPEED_NOISE = 0.001


def random_points(seed, n=96, temperature=False):
    """Operating points all over the working range of the paper's tractor."""
    rng = np.random.default_rng(seed)
    stroke, speed = rng.uniform(-1.0, 1.0, n), rng.uniform(78.5, 230.0, n)
    torque = np.clip(rng.uniform(18e3, 85e3, n) / speed, 40.0, 600.0)
    oil = rng.uniform(45.0, 85.0, n) if temperature else None
    return OperatingPoints(stroke, speed, torque, oil)


def factorial_points(levels=(5, 5, 4)):
    axes = (
        np.linspace(-0.9, 0.9, levels[0]),
        np.linspace(80.0, 225.0, levels[1]),
        np.linspace(100.0, 320.0, levels[2]),
    )
    return OperatingPoints(
        *(axis.ravel() for axis in np.meshgrid(*axes, indexing="ij"))
    )


def measure(
    points,
    effects=(),
    seed=0,
    noise=NOISE,
    speed_noise=SPEED_NOISE,
    loss=None,
    pressure_noise=None,
):
    """What a bench reads at points; `loss(points)` is taken from the efficiency besides.

    Noise: of the efficiency, of the speed as a part of it, of the pressure in Pa; None: not read.
    """
    rng = np.random.default_rng([seed, 7])
    truth = replace(BASE, effects=tuple(effects))
    read = truth.readings_at(points)
    efficiency, speed = read["efficiency"], read["output_speed"]
    efficiency = efficiency + noise * rng.standard_normal(efficiency.shape)
    if loss is not None:
        efficiency = efficiency - loss(points)
    speed = speed * (1.0 + (speed_noise or 0.0) * rng.standard_normal(speed.shape))
    pressure = read["pressure"] + (pressure_noise or 0.0) * rng.standard_normal(
        speed.shape
    )
    carried = np.isfinite(efficiency)
    return hmcvt.BenchSamples(
        points.displacement_ratio[carried],
        points.engine_speed[carried],
        points.load_torque[carried],
        efficiency[carried],
        output_speed=None if speed_noise is None else speed[carried],
        oil_temperature=None
        if points.oil_temperature is None
        else points.oil_temperature[carried],
        pressure=None if pressure_noise is None else pressure[carried],
        source="simulated",
    )


def campaign(effects=(), seed=0, n=96, temperature=False, **bench):
    return measure(random_points(seed, n, temperature), effects, seed, **bench)


def joined(first, second):
    """Samples of two campaigns with the same columns."""
    names = (
        "displacement_ratio",
        "engine_speed",
        "load_torque",
        "efficiency",
        "output_speed",
        "oil_temperature",
    )
    return hmcvt.BenchSamples(
        **{
            name: None
            if getattr(first, name) is None
            else np.concatenate([getattr(first, name), getattr(second, name)])
            for name in names
        }
    )


def with_column(samples, **columns):
    return replace(samples, **columns)


def fitted(samples, noise=NOISE, model=BASE):
    return refit(Hypothesis(Transmission(model)), observe(samples, noise))


BAND = (142.0, 160.0)  # rad/s


def band_loss(points):
    """A loss in a narrow band of engine speed, which no effect in the library makes."""
    inside = (points.engine_speed > BAND[0]) & (points.engine_speed < BAND[1])
    return 0.02 * inside


CASES = {
    "nothing": {"n": 48},
    "dead band": {"effects": (DisplacementDeadBand(0.02),), "n": 48},
    "planetary mesh": {"effects": (PlanetaryMesh(0.06),), "n": 48},
    "leakage": {"effects": (PressureLeakage(2e-11),), "n": 48},
    "charge pump": {"effects": (ChargePump(8.0),), "n": 64},
    "charge pump without speed": {
        "effects": (ChargePump(8.0),),
        "speed_noise": None,
        "n": 48,
    },
    "band": {"loss": band_loss, "n": 64},
    "oil": {"effects": (OilTemperature(1.0),), "temperature": True, "n": 32},
    "two": {"effects": (Churning(15.0), PressureLeakage(4e-11))},
    "a twin and another": {"effects": (ChargePump(8.0), PressureLeakage(4e-11))},
}


folder = None
"""Where the processes of a run of tests leave what is `diagnosed`; None in a single process."""


@functools.cache
def diagnosed(name):
    """The diagnosis of one of `CASES`, made once for all processes of a run of tests."""
    path = folder and folder / f"{name}.pickle"
    if path and path.exists():
        return pickle.loads(path.read_bytes())
    found = hmcvt.diagnose(BASE, campaign(seed=1, **CASES[name]), noise=NOISE)
    if path:
        # Another process may make the same meanwhile.
        whole = path.with_suffix(f".{os.getpid()}")
        whole.write_bytes(pickle.dumps(found))
        whole.replace(path)
    return found
