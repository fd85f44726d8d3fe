# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Compute how much a free choice of the engine speed saves in a day; without ROS.

    python examples/offline_study.py
    python examples/offline_study.py --params mine.yaml --engine-speed 1900

A day of field work consists of a few operating points: ground speed (speed of the output shaft),
power at the wheels, hours. Two strategies drive each of them:

* fixed: the engine has one speed, and the displacement ratio sets the ground speed;
* best: engine speed and displacement ratio are the pair with the least loss at the same ground
  speed and power (`hold="output_speed"`).

The table shows the energy that the engine delivers. With a constant specific fuel consumption, the
saved part of the energy is the saved part of the fuel. A real engine also burns less per kWh at low
speed and high torque: multiply by its fuel map before you publish the figure.
"""

import argparse
import math

import numpy as np

import hmcvt_core as hmcvt

RPM = math.pi / 30.0
KWH = 3.6e6
# Output speed [r/min], power at the output [W], time [h].
DAY = np.array(
    [
        (1750.0, 30e3, 1.0),  # drilling
        (2000.0, 55e3, 4.0),  # cultivating
        (2400.0, 45e3, 2.0),  # mowing
        (2800.0, 35e3, 1.0),  # on the road, loaded
    ]
)


def fixed_engine_speed(
    model: hmcvt.EfficiencyModel,
    engine_speed: float,
    output_speed: np.ndarray,
    power: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return displacement ratio and efficiency, shape (n,), at one engine speed [rad/s].

    Args:
        model: of the transmission.
        engine_speed: [rad/s].
        output_speed: demand [rad/s], shape (n,).
        power: at the output [W], shape (n,).
    """
    # One call for the whole grid: displacement ratio along rows, operating points along columns.
    stroke = np.linspace(-1.0, 1.0, 401)[:, None]
    torque = power[None, :] / engine_speed
    speed = model.output_speed(stroke, engine_speed, torque)
    needed = np.array(
        [
            np.interp(target, speed[:, i], stroke[:, 0], left=np.nan, right=np.nan)
            for i, target in enumerate(output_speed)
        ]
    )
    if np.any(np.isnan(needed)):
        unreached = output_speed[np.isnan(needed)] / RPM
        raise SystemExit(
            f"{engine_speed / RPM:.0f} r/min cannot make {unreached} r/min"
        )
    return needed, model.efficiency(needed, engine_speed, power / engine_speed)


def main() -> None:
    """Print the study."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--params",
        default=hmcvt.data_path("params/hm4.yaml"),
        help="parameter file of the model (the shipped one)",
    )
    parser.add_argument(
        "--engine-speed",
        type=float,
        default=2000.0,
        help="of the fixed strategy, r/min (2000)",
    )
    options = parser.parse_args()
    model = hmcvt.load_model(options.params)
    held = options.engine_speed * RPM

    grid = model.efficiency_map(
        np.linspace(-1, 1, 81),
        np.linspace(80.0, 230.0, 31),
        np.linspace(50.0, 400.0, 15),
    )
    at = np.unravel_index(np.nanargmax(grid.efficiency), grid.efficiency.shape)
    print(
        f"model {model.fingerprint}: {grid.efficiency.size} points, best "
        f"{100 * grid.efficiency[at]:.1f} % at displacement ratio "
        f"{grid.displacement_ratio[at[0]]:+.2f}, {grid.engine_speed[at[1]] / RPM:.0f} r/min, "
        f"{grid.load_torque[at[2]]:.0f} N m\n"
    )

    output_speed = DAY[:, 0] * RPM
    power = DAY[:, 1]
    hours = DAY[:, 2]
    stroke, fixed = fixed_engine_speed(model, held, output_speed, power)
    best = model.optimal_displacement_ratio(
        held, power / held, hold="output_speed", output_speed=output_speed
    )
    energy_fixed = power * hours / fixed
    energy_best = power * hours / best.efficiency

    print("output  power  hours |  fixed engine speed  |      best pair       | saved")
    print("[r/min]  [kW]        | [r/min]   ratio   [%]| [r/min]   ratio   [%]|   [%]")
    for i in range(len(DAY)):
        print(
            f"{DAY[i, 0]:7.0f}{power[i] / 1e3:6.0f}{hours[i]:7.1f} |"
            f"{options.engine_speed:8.0f}{stroke[i]:+8.2f}{100 * fixed[i]:6.1f}|"
            f"{best.engine_speed[i] / RPM:8.0f}{best.displacement_ratio[i]:+8.2f}"
            f"{100 * best.efficiency[i]:6.1f}|"
            f"{100 * (1.0 - energy_best[i] / energy_fixed[i]):6.1f}"
        )
    total = energy_fixed.sum() * 3600.0 / KWH
    least = energy_best.sum() * 3600.0 / KWH
    print(
        f"\nthe day: {total:.0f} kWh from the engine at {options.engine_speed:.0f} r/min, "
        f"{least:.0f} kWh with the best pair: {100 * (1.0 - least / total):.1f} % saved"
    )


if __name__ == "__main__":
    main()
