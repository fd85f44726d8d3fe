# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Simulate the bench logs of a fleet of transmissions, to try `hmcvt fleet`.

    python examples/make_fleet.py fleet --logs 40
    hmcvt fleet fleet/logs --out fleet/fitted

Run it from a clone. Every transmission is a plant of `studies.blind`, whose physics are written
separately from the fitted model. Leakage and dampings scatter by 5 % around one design. The last
of every ten transmissions is worn (half as much leakage again); the third of every five has an
effect that the fitted model does not know. Logs go to FOLDER/logs, the truth to
FOLDER/hidden.json.
"""

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path

import numpy as np

import hmcvt_core as hmcvt

sys.path.insert(
    0, str(Path(__file__).resolve().parents[1])
)  # studies are not installed

from studies.blind.campaign import Bench, Campaign, CampaignOptions
from studies.blind.catalogue import draw_effect, size_effect
from studies.blind.twin import BaseTruth

DESIGN = BaseTruth(leakage=1.8e-11, motor_damping=0.185, pump_damping=0.101)
SCATTER = 0.05
WORN = 1.5
EFFECTS = ("charge_pump", "displacement_error", "stroke_leakage", "clutch_drag")
SHIFT = 0.02  # of the efficiency, by an effect


def transmission(number: int, samples: int, seed: int) -> Campaign:
    """Measure one transmission of the fleet."""
    rng = np.random.default_rng([seed, number])
    leakage, motor, pump = np.exp(SCATTER * rng.standard_normal(3))
    if number % 10 == 9:
        leakage *= WORN
    base = BaseTruth(
        DESIGN.leakage * leakage,
        DESIGN.motor_damping * motor,
        DESIGN.pump_damping * pump,
    )
    effects = []
    if number % 5 == 2:
        effect = draw_effect(EFFECTS[number // 5 % len(EFFECTS)], rng)
        effects.append(size_effect(base, effect, SHIFT))
    bench = Bench(base, tuple(effects), CampaignOptions(samples))
    return bench.measure(int(rng.integers(2**31)))


def main() -> None:
    """Write the logs."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--logs", type=int, default=40, help="number of logs (40)")
    parser.add_argument(
        "--samples", type=int, default=96, help="samples in each log (96)"
    )
    parser.add_argument("--seed", type=int, default=0, help="of the random numbers (0)")
    options = parser.parse_args()
    (options.folder / "logs").mkdir(parents=True, exist_ok=True)
    hidden = {}
    for number in range(options.logs):
        campaign = transmission(number, options.samples, options.seed)
        name = f"{number:05d}"
        hmcvt.write_bench(
            options.folder / "logs" / f"{name}.csv",
            hmcvt.BenchSamples(**campaign.samples),
        )
        bench = campaign.bench
        hidden[name] = {"base": asdict(bench.base), "effects": list(bench.names)}
    (options.folder / "hidden.json").write_text(
        json.dumps(hidden, indent=1), encoding="utf-8"
    )
    print(f"{options.logs} logs in {options.folder / 'logs'}")


if __name__ == "__main__":
    main()
