# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Write an effect and find it with the diagnosis.

    python examples/own_effect.py

The effect is a relief valve that opens too early: below its cracking pressure nothing happens,
above it oil escapes in proportion. No effect of hmcvt has such a corner. The command line
(`--effects`) and the node (`effects_file`) use the same file.
"""

from dataclasses import dataclass, replace

import numpy as np

import hmcvt_core as hmcvt
from hmcvt_core import Effect, ShaftState, Value, shape, size


@dataclass(frozen=True)
class ReliefValve(Effect):
    """q = c (|dp| - p_crack) above p_crack, in the direction of the pressure."""

    name = "relief_valve"
    component = "pump"
    summary = "a relief valve opens too early: oil escapes above a certain pressure, none below"
    source = "characteristic of a direct-acting relief valve: Merritt 1967, section 5.4"
    remedy = "measure the flow in the return line of the valve at full load"

    leak: float = size(
        "m3/(s Pa)", 3e-11, 0.0, 3e-10, "flow for each Pa above cracking"
    )
    cracking: float = shape(
        "MPa", (4.0, 5.0, 6.0, 7.0, 8.0), "pressure at which the valve opens"
    )

    def leakage_flow(self, state: ShaftState) -> Value:
        """Flow that does not reach the motor [m3/s]."""
        above = np.maximum(np.abs(state.pressure) - 1e6 * self.cracking, 0.0)
        return self.leak * np.sign(state.pressure) * above


def bench(tests: int = 96) -> hmcvt.BenchSamples:
    """Simulate a campaign on a unit with such a valve, with 0.3 % noise."""
    rng = np.random.default_rng(7)
    base = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    unit = replace(base, effects=(ReliefValve(leak=6e-11, cracking=6.0),))
    point = (
        rng.uniform(-1.0, 1.0, tests),
        rng.uniform(85.0, 220.0, tests),
        rng.uniform(80.0, 400.0, tests),
    )
    return hmcvt.BenchSamples(
        *point,
        efficiency=unit.efficiency(*point) + 0.003 * rng.standard_normal(tests),
        output_speed=unit.output_speed(*point)
        * (1.0 + 0.001 * rng.standard_normal(tests)),
    )


if __name__ == "__main__":
    hmcvt.write_bench("valve.csv", bench())
    served = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    diagnosis = hmcvt.diagnose(served, bench(), noise=0.003)
    print(diagnosis.report())
    hmcvt.save_model(diagnosis.model, "valve.yaml")
