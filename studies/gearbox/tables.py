# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The table of a bench of the gearbox, as bench samples and as a transmission."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from datetime import datetime, timezone
from typing import Any

import numpy as np

import hmcvt_core as hmcvt
from hmcvt_core.transmission.new_file import (
    clutch_from_text,
    commented_file,
    stage_from_text,
)
from studies.gearbox import box

RPM = 2.0 * math.pi / 60.0
BAR = 1e5


def transmission_text() -> str:
    """Return the transmission file of the gearbox."""
    options: dict[str, list[str]] = {}
    for option in box.DESCRIPTION:
        name, _, value = option.removeprefix("--").partition("=")
        options.setdefault(name, []).append(value)
    pairs = dict(pair.split("=", 1) for pair in options["gear-pair"])
    rows = dict(row.split("=", 1) for row in options["planetary-row"])
    return commented_file(
        "box",
        pairs,
        rows,
        (box.DISPLACEMENT, box.DISPLACEMENT),
        [stage_from_text(text) for text in options["stage"]],
        box.PAIR_EFFICIENCY,
        [clutch_from_text(text) for text in options["clutch"]],
    )


def samples(
    table: Sequence[Mapping[str, Any]], source: str = "box"
) -> hmcvt.BenchSamples:
    """Return the tests of a table as bench samples.

    Args:
        table: of `box.campaign`.
        source: name of the samples.
    """
    columns: dict[str, Any] = {}
    for name in table[0]:
        columns[name] = np.array([row[name] for row in table])
    engine_speed = RPM * columns["Motordrehzahl [1/min]"]
    output_speed = RPM * columns["Abtriebsdrehzahl [1/min]"]
    load_torque = columns["Abtriebsmoment [Nm]"] * output_speed / engine_speed
    stamps = []
    for day in columns["Datum"]:
        date = datetime.strptime(day, "%d.%m.%Y").replace(tzinfo=timezone.utc)
        stamps.append(date.timestamp())
    return hmcvt.BenchSamples(
        displacement_ratio=columns["Verstellung [%]"] / 100.0,
        engine_speed=engine_speed,
        load_torque=load_torque,
        efficiency=load_torque / columns["Motormoment [Nm]"],
        output_speed=output_speed,
        oil_temperature=columns["Öltemperatur [°C]"],
        pressure=BAR * columns["Differenzdruck [bar]"],
        stamp=np.array(stamps),
        extra={
            "stage": tuple(columns["Gang"].tolist()),
            "session": tuple(columns["Datum"].tolist()),
        },
        source=source,
    )
