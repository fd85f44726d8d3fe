# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Map and picture of the drive line's best working points over output speed and output power.

    python examples/drive_map.py drive.png drive.csv

Stage regions (colour), engine speed (lines) and fuel (dashed), for the shipped five stages, which
are a reading of the paper, behind the made-up engine. Other files: --params, --engine.
"""

from __future__ import annotations

import argparse
import csv
from dataclasses import asdict

import matplotlib
import numpy as np

import hmcvt_core as hmcvt

matplotlib.use("Agg")
from matplotlib import pyplot as plt

RPM = np.pi / 30.0


def main() -> None:
    """Write the picture and the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("picture")
    parser.add_argument("table")
    parser.add_argument("--params", default=hmcvt.data_path("params/tractor.yaml"))
    parser.add_argument("--engine", default=hmcvt.data_path("params/engine.yaml"))
    parser.add_argument("--output-speed", type=float, default=350.0, help="highest, rad/s (350)")
    parser.add_argument("--output-power", type=float, default=100e3, help="highest, W (100000)")
    parser.add_argument("--points", type=int, nargs=2, default=(48, 30))
    asked = parser.parse_args()
    model, engine = hmcvt.load_model(asked.params), hmcvt.load_engine(asked.engine)
    speeds, powers = (np.linspace(top / count, top, count) for top, count in zip(
        (asked.output_speed, asked.output_power), asked.points, strict=True))
    best = [[model.optimal_drive(float(x), float(y), engine=engine) for x in speeds]
            for y in powers]
    with open(asked.table, "w", encoding="utf-8", newline="") as file:
        rows = csv.DictWriter(file, ["output_speed", "output_power", *asdict(best[0][0])])
        rows.writeheader()
        rows.writerows({"output_speed": x, "output_power": y, **asdict(point)}
                       for y, row in zip(powers, best, strict=True)
                       for x, point in zip(speeds, row, strict=True))
    draw(asked.picture, speeds, 1e-3 * powers, best, list(model.stages))


def draw(path, speeds, kilowatts, best, stages):
    """Draw stage regions, engine speed and fuel."""
    figure, axes = plt.subplots(figsize=(10.0, 6.4), layout="constrained")
    number = np.array([[stages.index(point.stage) if point.stage else np.nan for point in row]
                       for row in best])
    colours = axes.pcolormesh(speeds, kilowatts, np.ma.masked_invalid(number), cmap="Pastel1",
                              vmin=-0.5, vmax=8.5, shading="nearest")
    for name, factor, style, colour, form in (
            ("engine_speed", 1.0 / RPM, "-", "0.2", "%.0f r/min"),
            ("fuel_rate", 3600.0, "--", "tab:red", "%.0f kg/h")):
        values = factor * np.array([[getattr(point, name) for point in row] for row in best])
        lines = axes.contour(speeds, kilowatts, np.ma.masked_invalid(values), levels=7,
                             colors=colour, linestyles=style, linewidths=0.9)
        axes.clabel(lines, fmt=form, fontsize=9)
    for i, name in enumerate(stages):
        if (number == i).any():
            axes.plot([], [], "s", ms=12, color=colours.cmap(colours.norm(i)), label=name)
    axes.set(xlabel="output speed [rad/s]", ylabel="output power [kW]",
             title="Best stage (colour), engine speed (lines), fuel (dashed)")
    figure.legend(loc="outside lower center", ncols=len(stages))
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    main()
