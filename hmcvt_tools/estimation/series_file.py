# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The rows of an estimate as CSV, written piece by piece, whole or not at all."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hmcvt_core.files.atomic import growing_file

from .rows import Rows


class SeriesFile:
    """Writes rows to a CSV file; an interrupted run leaves the old file.

    Args:
        path: of the file.
    """

    def __init__(self, path: Path) -> None:
        self._growing = growing_file(path)
        self._has_header = False

    def __enter__(self) -> SeriesFile:
        self._file = self._growing.__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        self._growing.__exit__(*error)

    def write(self, rows: Rows) -> None:
        """Append rows; those without an estimate hold a stamp and an engine speed alone."""
        import pandas

        low, high = rows.output_torque_interval
        frame = pandas.DataFrame(
            {
                "stamp": rows.time,
                "stage": rows.stage,
                "displacement_ratio": rows.displacement_ratio,
                "engine_speed": rows.engine_speed,
                "output_torque": rows.output_torque,
                "output_torque_low": low,
                "output_torque_high": high,
                "output_power": rows.output_power,
                "power_loss": rows.power_loss,
                "efficiency": rows.efficiency,
            }
        )
        numbers = frame.columns.drop(["stamp", "stage"])
        frame[numbers] = frame[numbers].astype("float32")
        frame.to_csv(
            self._file, index=False, header=not self._has_header, lineterminator="\n"
        )
        self._has_header = True
