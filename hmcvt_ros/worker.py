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
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

import hmcvt_core as hmcvt
from hmcvt_core.atomic import write_atomically
from hmcvt_core.identification.held_back import FEWEST, HeldBack, held_back
from hmcvt_ros.json_text import json_text
from hmcvt_ros.numbered_files import keep_newest, next_name

NICENESS = 10
CANDIDATES_KEPT = 20
REPORTS_KEPT = 10


def reidentify(request: Mapping[str, Any]) -> dict[str, Any]:
    """Refit the model `model` to the samples `samples`.

    The refit goes to the file `output`, or to a file in the folder `candidates` when it is worse
    than the model on samples held back.

    Returns:
        Sample count, error (mean |predicted - measured| / measured) before and after, parameters
        with standard errors, what the samples leave open, and the comparison on samples held back;
        `refused` and `candidate` when the refit is worse.
    """
    samples = hmcvt.read_bench(request["samples"])
    if len(samples) < request["min_samples"]:
        raise hmcvt.InputError(f"{samples.source}: {len(samples)} samples; reidentify_min_samples "
                               f"= {request['min_samples']}")
    served, seed = hmcvt.load_model(request["model"]), request["seed"]

    def fitted(part: hmcvt.BenchSamples) -> hmcvt.Identification:
        return hmcvt.identify(part, stage=served.stage, formulation=served.formulation,
                              effects=served.effects, seed=seed)

    fit = fitted(samples)
    compared = held_back(samples, fit.model, served, lambda part: fitted(part).model, seed)
    result = {
        "samples": len(samples),
        "source": samples.source,
        "error_before": relative_error(served, samples),
        "error_after": float(fit.fit_error),
        "parameters": fit.model.to_mapping()["parameters"],
        "warnings": [*fit.warnings, *_unchecked(compared)],
        "held_back": None if compared is None else asdict(compared),
    }
    if compared is None or not compared.worse:
        fit.save(request["output"])
        return result
    return {**result, **_set_aside(fit.model, compared, Path(request["candidates"]))}


def _unchecked(compared: HeldBack | None) -> list[str]:
    return [] if compared is not None else [
        f"fewer than {FEWEST} samples: none could be held back to check the refit"]


def _set_aside(
    model: hmcvt.EfficiencyModel, compared: HeldBack, folder: Path
) -> dict[str, str]:
    path = next_name(folder).with_suffix(".yaml")
    model.save(path)
    keep_newest(folder, CANDIDATES_KEPT)
    return {"candidate": str(path), "refused": (
        f"the refit is worse on samples held back: mean error {100 * compared.error_refit:.2f} %, "
        f"model in service {100 * compared.error_in_service:.2f} %; it is kept as {path}")}


def diagnose(request: Mapping[str, Any]) -> dict[str, Any]:
    """Say why the model `model` and the samples `samples` disagree.

    Returns:
        The object of `hmcvt diagnose --json`, and `report`: the page of it in the folder `reports`,
        None with a reason in `report_error` when that cannot be written.
    """
    from hmcvt_core.diagnosis.html_report import write_html

    samples = hmcvt.read_bench(request["samples"])
    found = hmcvt.diagnose(hmcvt.load_model(request["model"]), samples, seed=request["seed"])
    result: dict[str, Any] = found.to_dict()
    folder = Path(request["reports"])
    try:
        path = next_name(folder).with_suffix(".html")
        write_atomically(path.with_suffix(".json"), json_text(result) + "\n")
        write_html(found, path)
        keep_newest(folder, REPORTS_KEPT)
    except OSError as error:
        # The answer is worth more than the page.
        return {**result, "report": None, "report_error": str(error)}
    return {**result, "report": str(path)}


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
