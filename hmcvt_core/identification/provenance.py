# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Where the parameters of a model come from, as its file states it."""

from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from ..files.bench import BenchSamples
from ..version import __version__


def origin(command: str, samples: BenchSamples, seed: int | None) -> dict[str, Any]:
    """Return the provenance of a model that a command fits to samples at this moment."""
    temperatures = {}
    if samples.oil_temperature is not None:
        temperature = samples.oil_temperature
        ends = [float(temperature.min()), float(temperature.max())]
        temperatures["oil_temperature"] = ends
    return {
        "source": f"hmcvt {command}, version {__version__}",
        "date": datetime.now(timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "data": Path(samples.source).name,
        "data_sha256": samples.sha256,
        "samples": len(samples),
        "seed": seed,
        **temperatures,
    }
