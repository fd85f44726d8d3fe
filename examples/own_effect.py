# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Write an effect and find it with the diagnosis.

    python examples/own_effect.py

The effect is a cylinder block that tips: up to a certain speed nothing happens, above it the block
lifts from the valve plate and leaks. No effect of hmcvt has such a corner. The command line
(`--effects`) and the node (`effects_file`) use the same file.
"""

from dataclasses import dataclass, replace

import numpy as np

import hmcvt_core as hmcvt
from hmcvt_core import Effect, ShaftState, Value, shape, size


@dataclass(frozen=True)
class TippingBlock(Effect):
    """q = c dp (w / w_tip - 1) above w_tip, in the direction of the pressure."""

    name = "tipping_block"
    component = "pump"
    summary = (
        "the cylinder block tips at high speed: it lifts from its plate and oil escapes"
    )
    source = (
        "Manring 2000, J. Dyn. Syst. Meas. Control 122; Achten & Eggenkamp, SICFP2017"
    )
    remedy = "measure the case drain at one pressure and several high speeds"

    leak: float = size(
        "m3/(s Pa)", 2e-11, 0.0, 3e-10, "further leakage at twice the tipping speed"
    )
    tipping: float = shape(
        "rad/s", (150.0, 180.0, 210.0, 240.0, 270.0), "speed at which the block tips"
    )

    def leakage_flow(self, state: ShaftState) -> Value:
        """Flow that does not reach the motor [m3/s]."""
        above = np.maximum(np.abs(state.pump_speed) / self.tipping - 1.0, 0.0)
        return self.leak * state.pressure * above


def bench(tests: int = 96) -> hmcvt.BenchSamples:
    """Simulate a campaign on a unit with such a block, with 0.3 % noise."""
    rng = np.random.default_rng(7)
    base = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    unit = replace(base, effects=(TippingBlock(leak=8e-11, tipping=210.0),))
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
    hmcvt.write_bench("tipping.csv", bench())
    served = hmcvt.load_model(hmcvt.data_path("params/hm4.yaml"))
    diagnosis = hmcvt.diagnose(served, bench(), noise=0.003)
    print(diagnosis.report())
    hmcvt.save_model(diagnosis.model, "tipping.yaml")
