# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Random made-up stages of every layout, with parameters, drawn from a seed."""

import itertools
from dataclasses import replace

from hmcvt_core import GearPair, HydraulicParameters, Path, PumpMotor, Stage
from hmcvt_core.errors import InputError
from hmcvt_core.transmission.stage import LAYOUTS, MEMBERS

MEMBER_ORDERS = list(itertools.permutations(MEMBERS))


def random_stage(rng, layout):
    """Return a valid stage of a layout; either sense of output, either sense of each path."""
    while True:
        mechanical, motor, output = MEMBER_ORDERS[rng.integers(len(MEMBER_ORDERS))]
        stage = {
            "name": "random",
            "planetary_constant": rng.uniform(1.3, 4.0),
            "mechanical": path(rng, "m"),
            "mechanical_member": mechanical,
            "pump": replace(path(rng, "p"), direction=1),
            "motor": path(rng, "h"),
            "motor_member": motor,
            "output": path(rng, "o"),
            "output_member": output,
            "pump_motor": PumpMotor(
                displacement(rng),
                displacement(rng),
                rng.uniform(0, 0.05),
                rng.uniform(0, 0.05),
            ),
            "layout": layout,
            "reverse": bool(rng.integers(2)),
        }
        if layout == "hydrostatic":
            stage |= {
                "planetary_constant": 0.0,
                "mechanical": Path(()),
                "mechanical_member": "",
                "motor_member": "",
                "output_member": "",
                "reverse": False,
            }
        try:
            return Stage(**stage)
        except InputError:
            continue  # the senses contradict `reverse`


def random_parameters(rng):
    return HydraulicParameters(
        10.0 ** rng.uniform(-12.5, -10.3), rng.uniform(0, 0.3), rng.uniform(0, 0.3)
    )


def path(rng, name):
    pairs = tuple(
        GearPair(f"{name}{i}", rng.uniform(0.5, 2.0), rng.uniform(0.93, 0.995))
        for i in range(rng.integers(1, 3))
    )
    return Path(pairs, int(rng.choice((-1, 1))))


def displacement(rng):
    return 10.0 ** rng.uniform(-5.4, -4.6)


__all__ = ["LAYOUTS", "random_parameters", "random_stage"]
