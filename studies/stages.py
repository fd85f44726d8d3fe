# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Which gear pairs of Table 1 make the stages that the paper shows in a figure only?

    python -m studies.stages

HM4 is published. The second row is taken as driven at its ring through pair 1, giving at its
carrier (pair 1 has the ratio of pairs 2 and 3 together), with pump, motor and sun as in HM4. Going
down from HM4 each stage must meet the last at full stroke, where the pump stands already; what is
open is the set of pairs behind the row. Prints every set that meets within 3 %, and of the stages
shipped in params/tractor.yaml the misses and what the clutches of the others slip in each.
"""

import csv
from collections.abc import Iterator
from itertools import combinations, pairwise
from math import prod

import numpy as np

import hmcvt_core as hmcvt
from hmcvt_core.transmission.stage import speed_ratio

NEAR = 0.03
FULL = np.array([-1.0, 1.0])
STAGES = ("H0", "HM1", "HM2", "HM3", "HM4")  # neighbours meet at stroke +1, -1, +1, -1


def table_1() -> dict[str, float]:
    """Ratios and row constants by symbol."""
    with hmcvt.data_path("data/table1.csv").open(encoding="utf-8") as file:
        return {row["symbol"]: float(row["value"]) for row in csv.DictReader(file)}


def readings(driven: float, wanted: float) -> Iterator[tuple[float, tuple[int, ...]]]:
    """Yield the sets of pairs behind the row that bring `driven` near `wanted`, and their miss."""
    i = table_1()
    for count in range(1, 5):
        for pairs in combinations(range(6, 13), count):
            miss = driven / prod(i[f"i{pair}"] for pair in pairs) / wanted - 1.0
            if abs(miss) < NEAR:
                yield miss, pairs


def main() -> None:
    """Print the readings, stage by stage from the top, then what ships."""
    i = table_1()
    sun = -FULL / (i["i4"] * i["i5"])
    rows = {
        1: ((1.0 + i["k1"]) / (i["i2"] * i["i3"]) - sun) / i["k1"],
        2: (i["k2"] / i["i1"] + sun) / (1.0 + i["k2"]),
        0: -sun,
    }
    model = hmcvt.load_model(hmcvt.data_path("params/tractor.yaml"))
    shipped = {name: speed_ratio(model.stages[name].stage, FULL) for name in STAGES}
    for name, row, end in (("HM3", 2, 0), ("HM2", 1, 1), ("HM1", 2, 0), ("H0", 0, 1)):
        upper = STAGES[STAGES.index(name) + 1]
        print(f"{name}, to meet {upper} as shipped at {shipped[upper][end]:.4f}:")
        found = readings(rows[row][end], shipped[upper][end])
        for miss, pairs in sorted(found, key=lambda entry: abs(entry[0])):
            print(f"  {100 * miss:+.2f} %  pairs {', '.join(map(str, pairs))}")
    print("shipped:")
    for k, (low, high) in enumerate(pairwise(STAGES)):
        end = 1 if k % 2 == 0 else 0
        ends = shipped[low][end], shipped[high][end]
        print(
            f"  {low}-{high}: {ends[0]:.4f} and {ends[1]:.4f}, "
            f"{100 * (ends[0] / ends[1] - 1):+.2f} %"
        )
    print("slip of the open clutches, per engine speed and per output speed:")
    for name in STAGES:
        stage, slips = model.stages[name].stage, []
        for other in (model.stages[each].stage for each in STAGES if each != name):
            # What the other stage would make of the speeds of engine and motor as they are.
            part = other.motor_speed_ratio / stage.motor_speed_ratio
            engine = part * stage.mechanical_speed_ratio - other.mechanical_speed_ratio
            slips.append(f"{other.name} {engine:.4f}, {1.0 - part:.4f}")
        print(f"  {name}: " + "; ".join(slips))


if __name__ == "__main__":
    main()
