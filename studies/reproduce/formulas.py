# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""What follows from formulas alone: uncertainty (1)-(3), ratio (5), split (8), row at rest (12).

For the ratios the paper prints formulas, not values: the published side is the formula, line by
line from Table 1; ours is the gear train of `params/transmission.yaml`.
"""

import csv
import math

import numpy as np

from hmcvt_core.files import data_path
from hmcvt_core.physics import published
from hmcvt_core.transmission.stage import speed_ratio

from . import paper
from .bench import stage, table2
from .item import Item, claim, printed

UNCERTAINTY = "Measurement uncertainty, eqs (1)-(3)"
GROUP = "Transmission ratio (5), split ratio (8), row at rest (12)"


def uncertainties() -> list[Item]:
    """The five printed uncertainties."""
    expected = paper.Uncertainties()
    torque, speed = paper.TORQUE_READINGS, paper.SPEED_READINGS
    random = [100.0 * deviation / mean for mean, deviation in (torque, speed)]  # (1)
    uniform = 100.0 / math.sqrt(3.0)  # (2): the largest error, uniformly distributed
    system = [
        uniform * error / full
        for error, full in (paper.TORQUE_SENSOR, paper.SPEED_SENSOR)
    ]
    at_reading = uniform * paper.TORQUE_SENSOR[0] / torque[0]
    speed_at_reading = uniform * paper.SPEED_SENSOR[0] * math.pi / 30.0 / speed[0]
    total = math.hypot(*random, *system)  # (3)
    return [
        printed(
            UNCERTAINTY, "random, torque [%]", expected.torque_random, random[0], ".2f"
        ),
        printed(
            UNCERTAINTY, "random, speed [%]", expected.speed_random, random[1], ".2f"
        ),
        printed(
            UNCERTAINTY,
            "systematic, torque [%]",
            expected.torque_system,
            system[0],
            ".2f",
            remark=f"of the full range; of the reading itself (2) gives {at_reading:.2f} %",
        ),
        printed(
            UNCERTAINTY,
            "systematic, speed [%]",
            expected.speed_system,
            system[1],
            ".3f",
            remark=f"of the full range; of the reading itself {speed_at_reading:.3f} %",
        ),
        printed(UNCERTAINTY, "total [%]", expected.total, total, ".2f"),
    ]


def items() -> list[Item]:
    """One ratio and one split ratio for each stroke of Table 2, and eta_HM at eps = 0."""
    strokes = np.unique(table2().displacement_ratio)
    tests = {
        eps: ", ".join(
            str(i + 1) for i in np.flatnonzero(table2().displacement_ratio == eps)
        )
        for eps in strokes.tolist()
    }
    formulas = (
        ("speed ratio (5)", _ratio, speed_ratio, ".5f"),
        ("e_H (8)", _split, published.hydraulic_split_ratio, ".4f"),
    )
    found = [
        printed(
            GROUP,
            f"{name} at eps = {eps:g} (tests {tests[eps]})",
            as_printed(eps),
            value,
            form,
            why="the gear train is not Table 1's",
        )
        for name, as_printed, ours, form in formulas
        for eps, value in zip(
            strokes.tolist(), ours(stage(), strokes).tolist(), strict=True
        )
    ]
    return [*found, *_at_rest()]


def _table1() -> dict[str, float]:
    with data_path("data/table1.csv").open(encoding="utf-8") as file:
        return {row[0]: float(row[1]) for row in list(csv.reader(file))[1:]}


def _ratio(eps: float) -> float:
    """Eq. (5) as printed."""
    i = _table1()
    k1 = i["k1"]
    return ((1 + k1) * i["i4"] * i["i5"] + eps * i["i2"] * i["i3"]) / (
        k1 * i["i2"] * i["i3"] * i["i4"] * i["i5"] * i["i6"] * i["i11"]
    )


def _split(eps: float) -> float:
    """Eq. (8) as printed, with i_HM the reciprocal of (5)."""
    a = -1.0 / (1.0 + _table1()["k1"])
    return 1.0 - 1.0 / _ratio(eps) / (1.0 + a)


def _at_rest() -> list[Item]:
    standing = np.array([published.STANDING_EFFICIENCY])
    rest = published.efficiencies(stage(), np.zeros(1), standing)
    with_printed = published.efficiencies(stage(1.0), np.zeros(1), standing)
    ends = np.array([1e-12, paper.STANDING_LIMIT])
    low, high = 100.0 * published.efficiencies(stage(), np.zeros(2), ends).total
    return [
        printed(
            GROUP,
            "eta_HM (12) at eps = 0, eta_H below 1e-4",
            paper.ROW_EFFICIENCY_AT_REST,
            float(rest.row[0]),
            ".4f",
            why="other reading of (5) or (8)",
        ),
        claim(
            GROUP,
            "gear pairs 2 and 3 lose at eps = 0, as in (7)",
            "(7)",
            f"eta_M1 = {rest.mechanical_in[0]:.4f}",
            bool(rest.mechanical_in[0] < stage().mechanical.efficiency + 1e-3),
            why=f"(11) sends the whole engine power (a_1 = {rest.engine_share[0]:.4f}) through a "
            "pump that passes none, so both pairs run free",
        ),
        claim(
            GROUP,
            "eta_total at eps = 0 does not depend on eta_H in (0, 1e-4)",
            "holds",
            f"{low:.2f} to {high:.2f} %",
            bool(high - low < 0.05),
            remark=f"eta_total = {100.0 * rest.total[0]:.2f} % with gear efficiency 0.98, "
            f"{100.0 * with_printed.total[0]:.2f} % with 1",
        ),
    ]
