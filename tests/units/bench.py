# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""A pump on a bench as arithmetic of its own, and its table as a maker prints it."""

import numpy as np

TURN = 2.0 * np.pi
CM3, LEAKAGE, DAMPING = 71.0, 3e-12, 0.05


def grid(n=8):
    """Speed [r/min] and pressure [bar] of n x n tests."""
    return map(
        np.ravel,
        np.meshgrid(np.linspace(500.0, 2600.0, n), np.linspace(40.0, 400.0, n)),
    )


def efficiencies(speed, pressure, kind="pump", flow=0.0, torque=0.0, cm3=CM3):
    """Volumetric and mechanical efficiency of the paper's terms and further losses [m3/s], [N m].

    `cm3` is the displacement by which the table is reckoned.
    """
    true, stated = CM3 * 1e-6 / TURN, cm3 * 1e-6 / TURN
    w, p = speed * TURN / 60.0, pressure * 1e5
    lost = LEAKAGE * p + flow
    rubbed = DAMPING * w + 0.01 * true * p + torque
    if kind == "pump":
        return (true * w - lost) / (stated * w), stated * p / (true * p + rubbed)
    return stated * w / (true * w + lost), (true * p - rubbed) / (stated * p)


def table(path, speed, pressure, pair, head=None, cm3=CM3, more=""):
    """Write a maker's table; numbers may be spoilt by another `head`."""
    head = head or "displacement_cc,pressure_bar,speed_rpm,volumetric,mechanical"
    rows = [
        ",".join(f"{value:.6g}" for value in (cm3, *row)) + more
        for row in zip(pressure, speed, *pair, strict=True)
    ]
    path.write_text("\n".join(["# made by a test", head, *rows]) + "\n")
    return path
