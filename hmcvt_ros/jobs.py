# SPDX-License-Identifier: Apache-2.0
"""The heavy work of the node: a refit, a diagnosis."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import hmcvt_core as hmcvt
from hmcvt_core.files.atomic import write_atomically
from hmcvt_core.identification.cross_validation import (
    FEWEST,
    QUICK,
    CrossValidation,
    cross_validate,
)
from hmcvt_core.model.agreement import RelativeError, predicted_at
from hmcvt_ros.json_text import json_text
from hmcvt_ros.numbered_files import keep_newest, next_name

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

    def fitted(
        part: hmcvt.BenchSamples, schedule: hmcvt.Schedule | None = None
    ) -> hmcvt.Identification:
        return hmcvt.identify(part, stage=served.stage, formulation=served.formulation,
                              effects=served.effects, schedule=schedule, seed=seed)

    fit = fitted(samples)
    compared = cross_validate(
        samples, fit.model, served, lambda part: fitted(part, QUICK).model, seed)
    result = {
        "samples": len(samples),
        "source": samples.source,
        "error_before": RelativeError.of(predicted_at(served, samples), samples.efficiency).mean,
        "error_after": float(fit.fit_error),
        "parameters": fit.model.to_mapping()["parameters"],
        "warnings": [*fit.warnings, *_unchecked(compared)],
        "held_back": None if compared is None else asdict(compared),
    }
    if compared is None or not compared.worse:
        fit.save(request["output"])
        return result
    return {**result, **_set_aside(fit.model, compared, Path(request["candidates"]))}


def _unchecked(compared: CrossValidation | None) -> list[str]:
    return [] if compared is not None else [
        f"fewer than {FEWEST} samples: none could be held back to check the refit"]


def _set_aside(
    model: hmcvt.EfficiencyModel, compared: CrossValidation, folder: Path
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
    from hmcvt_core.report.html_report import write_html

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
