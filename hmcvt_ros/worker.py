# SPDX-License-Identifier: Apache-2.0
"""The process beside the node that does the heavy work: `python -m hmcvt_ros.worker`.

It reads one JSON request from standard input, writes one JSON answer to standard output and ends.
It also ends when its standard input closes, which happens in whatever way the node dies.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

import hmcvt_core as hmcvt
from hmcvt_ros.json_text import json_text

NICENESS = 10


def reidentify(request: Mapping[str, Any]) -> dict[str, Any]:
    """Refit the model `model` to the samples `samples` and write it to `output`.

    Returns:
        Sample count, error (mean |predicted - measured| / measured) before and after, parameters
        with standard errors, and what the samples leave open.
    """
    samples = hmcvt.read_bench(request["samples"])
    if len(samples) < request["min_samples"]:
        raise hmcvt.InputError(f"{samples.source}: {len(samples)} samples; reidentify_min_samples "
                               f"= {request['min_samples']}")
    served = hmcvt.load_model(request["model"])
    fit = hmcvt.identify(samples, stage=served.stage, formulation=served.formulation,
                         effects=served.effects, seed=request["seed"])
    fit.save(request["output"])
    return {
        "samples": len(samples),
        "source": samples.source,
        "error_before": relative_error(served, samples),
        "error_after": float(fit.fit_error),
        "parameters": fit.model.to_mapping()["parameters"],
        "warnings": list(fit.warnings),
    }


def diagnose(request: Mapping[str, Any]) -> dict[str, Any]:
    """Say why the model `model` and the samples `samples` disagree (design of the answer: core)."""
    from hmcvt_core.diagnosis import diagnose as explain

    samples = hmcvt.read_bench(request["samples"])
    found: dict[str, Any] = explain(
        hmcvt.load_model(request["model"]), samples, seed=request["seed"]).to_dict()
    return found


JOBS: Mapping[str, Callable[[Mapping[str, Any]], dict[str, Any]]] = {
    "reidentify": reidentify, "diagnose": diagnose,
}


def relative_error(model: hmcvt.EfficiencyModel, samples: hmcvt.BenchSamples) -> float:
    """Mean |predicted - measured| / measured [-] over the samples that the model answers."""
    predicted = model.efficiency(
        samples.displacement_ratio, samples.engine_speed, samples.load_torque,
        samples.oil_temperature)
    errors = np.abs(predicted - samples.efficiency) / samples.efficiency
    answered = errors[np.isfinite(errors)]
    return float(answered.mean()) if answered.size else float("nan")


def answer(request: Mapping[str, Any]) -> dict[str, Any]:
    """Do one job; a failure that a person can mend comes back as `error`."""
    started = time.monotonic()
    try:
        result = JOBS[request["job"]](request)
    except (hmcvt.HmcvtError, OSError) as error:
        return {"error": str(error)}
    return {**result, "seconds": round(time.monotonic() - started, 3)}


def main() -> None:
    """Read the request, answer it, end."""
    # Ctrl-C in a terminal reaches every process of the group; the node decides what to do.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.nice(NICENESS)
    line = sys.stdin.readline()
    if not line:
        return  # the node ended before it said what to do
    threading.Thread(target=_end_with_parent, daemon=True).start()
    print(json_text(answer(json.loads(line))), flush=True)


def _end_with_parent() -> None:
    # Unbuffered: a thread inside sys.stdin would hold its lock when the interpreter ends.
    while os.read(0, 4096):
        pass
    os._exit(1)


if __name__ == "__main__":
    main()
