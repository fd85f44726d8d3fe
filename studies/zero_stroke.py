# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What the paper's values at displacement ratio 0 say: `python -m studies.zero_stroke`.

At displacement ratio 0 eqs (13) to (16) give a small negative hydraulic efficiency: the motor turns
backward by the leakage, and the pump takes its damping torque,

    eta_H = -q (T_m / omega_p)^2,  q = C / (V^2 f_p),  C = C_s (V_p + V_m) / mu.

The six efficiencies that Table 4 prints there determine q for each gear efficiency; the printed C
and f_p then determine the displacement V, which must be one.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

import hmcvt_core as hmcvt
from hmcvt_core.physics.published import efficiencies
from hmcvt_core.transmission.stage import CM3_PER_REV, Stage


class Printed(NamedTuple):
    """What the paper prints for one gear efficiency (section 4.2, Table 4, tests 6 to 8)."""

    gear_efficiency: float
    leakage: float
    pump_damping: float
    percent: tuple[float, float, float]


PRINTED = (
    Printed(0.98, 4.67e-12, 0.5613, (82.55, 82.56, 82.54)),
    Printed(0.97, 2.43e-12, 0.2934, (80.77, 80.79, 80.73)),
)


def predicted(
    stage: Stage, samples: hmcvt.BenchSamples, q: float
) -> NDArray[np.float64]:
    """Return the efficiency of eq. (18) at displacement ratio 0 [%], shape (n,)."""
    output_torque = samples.load_torque / stage.mechanical_speed_ratio
    gears = stage.output.efficiency * stage.motor.efficiency
    motor_torque = output_torque * abs(stage.motor_speed_ratio) / gears
    pump_speed = samples.engine_speed / stage.pump.ratio
    hydraulic = -q * (motor_torque / pump_speed) ** 2
    return np.asarray(100.0 * efficiencies(stage, 0.0 * hydraulic, hydraulic).total)


def main() -> None:
    """Print q, what it predicts, and the displacement that follows."""
    samples = hmcvt.read_bench(hmcvt.data_path("data/table2.csv"))
    samples = samples.select(samples.displacement_ratio == 0.0)
    train = hmcvt.load_model(hmcvt.data_path("params/paper.yaml")).stage
    for printed in PRINTED:
        stage = train.with_gear_efficiency(printed.gear_efficiency)

        def error(q: float, stage: Stage = stage, printed: Printed = printed) -> float:
            return float(np.abs(predicted(stage, samples, q) - printed.percent).max())

        q = minimize_scalar(error, bounds=(0.0, 0.1), method="bounded").x
        volume = np.sqrt(printed.leakage / (q * printed.pump_damping)) / CM3_PER_REV
        percent = ", ".join(f"{value:.2f}" for value in predicted(stage, samples, q))
        print(
            f"gear efficiency {printed.gear_efficiency}: q = {q:.4f}, predicts {percent} % "
            f"(printed {printed.percent}); C / f_p = "
            f"{printed.leakage / printed.pump_damping:.3g}, V = {volume:.0f} cm3/r"
        )


if __name__ == "__main__":
    main()
