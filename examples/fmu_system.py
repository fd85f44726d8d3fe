# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Diagnose any FMU: parameters of the FMU are switched on as effects (FMPy: extra `export`).

    python examples/fmu_system.py

Here the FMU is a transmission that hmcvt exports; to the diagnosis it is any FMU with inputs,
outputs and parameters. Its motor damping is fitted; a further leakage and a further pump damping
may be missing. A campaign with a further leakage is simulated and diagnosed.
"""

import tempfile
from pathlib import Path

import numpy as np

import hmcvt_core as hmcvt
import hmcvt_tools

MODEL = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
NOISE = {"efficiency": 0.003, "output_speed": 0.05}  # -, rad/s


def system(fmu: str | Path) -> hmcvt.Simulator:
    """Return a transmission as an FMU, whose parameters are switched on as effects.

    Args:
        fmu: path of the file.
    """
    outputs = hmcvt_tools.FmuFunction(fmu, tuple(NOISE), stop_time=0.01)
    known = MODEL.parameters

    def simulate(
        points: hmcvt.Points,
        *,
        motor_damping: float,
        further_leakage: float = 0.0,
        further_pump_damping: float = 0.0,
    ) -> dict[str, hmcvt.Array]:
        return outputs(
            points,
            motor_damping=motor_damping,
            leakage=known.leakage + further_leakage,
            pump_damping=known.pump_damping + further_pump_damping,
        )

    leakage, damping = known.leakage, known.pump_damping
    return hmcvt.Simulator(
        function=simulate,
        axes=(
            hmcvt.Axis.of("displacement_ratio"),
            hmcvt.Axis.of("engine_speed", "rad/s", digits=0),
            hmcvt.Axis.of("load_torque", "N m", digits=0),
        ),
        channels=(
            hmcvt.Channel.of("efficiency", "-", NOISE["efficiency"]),
            hmcvt.Channel.of("output_speed", "rad/s", NOISE["output_speed"], digits=2),
        ),
        parameters=(
            hmcvt.Parameter(
                "motor_damping",
                "N m s/rad",
                known.motor_damping,
                0.2 * known.motor_damping,
                low=0.0,
            ),
        ),
        effects=(
            hmcvt.Switch(
                "further_leakage", "m3/(s Pa)", 0.3 * leakage, 0.0, 5.0 * leakage
            ),
            hmcvt.Switch(
                "further_pump_damping", "N m s/rad", damping, 0.0, 9.0 * damping
            ),
        ),
    )


def campaign(
    machine: hmcvt.Simulator, seed: int, tests: int = 30
) -> hmcvt.Observations:
    """Simulate a campaign with a further leakage."""
    rng = np.random.default_rng(seed)
    points = {
        "displacement_ratio": rng.uniform(-0.6, 0.9, tests),
        "engine_speed": rng.uniform(120.0, 220.0, tests),
        "load_torque": rng.uniform(80.0, 300.0, tests),
    }
    true = machine.run(
        points,
        motor_damping=MODEL.parameters.motor_damping,
        further_leakage=0.4 * MODEL.parameters.leakage,
    )
    readings = {}
    for (name, noise), row in zip(NOISE.items(), true, strict=True):
        readings[name] = row + noise * rng.standard_normal(tests)
    return hmcvt.observe_system(machine, {**points, **readings}, noise=NOISE)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "transmission.fmu"
        hmcvt_tools.export_fmu(MODEL, path)
        machine = system(path)
        print(hmcvt.diagnose_system(machine, campaign(machine, seed=1)).report())
