# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""The heavy work of the node: a refit, a diagnosis. Done in a process of its own."""

import json
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import hmcvt_core as hmcvt
from hmcvt_core.files import plain
from hmcvt_core.files.atomic import write_atomically
from hmcvt_core.identification.refit import refit

from .model_store import Promised, proven, servable
from .state_folder import next_name

CANDIDATES_KEPT = 20
REPORTS_KEPT = 10


def with_proven(
    work: Callable[..., dict[str, Any]],
    promised: Promised,
    effects: str,
    **options: Any,
) -> dict[str, Any]:
    """Do a job on the model in service, once it has proved to be what was put there.

    Here rather than in the node, whose answers would wait for the files to be read.

    Args:
        work: one of the jobs below; `options` are its own.
        promised: the model in service, and what else has to be as it was.
        effects: module or file with effects of one's own; empty for none.
    """
    if effects:  # this process is another than the node's
        hmcvt.load_effects(effects)
    return work(model=proven(promised), **options)


def reidentify(
    samples: Path,
    model: Path,
    base: Path,
    seed: int,
    max_drift: float,
    output: Path,
    candidates: Path,
    min_samples: int,
) -> dict[str, Any]:
    """Refit a model to samples.

    Args:
        samples, model: files to read.
        base: parameter file of the model that the refits began with.
        seed: of the random numbers.
        max_drift: largest difference to `base` within the domain [-].
        output: file for the refit; in the folder `candidates` instead, when it must not serve.
        min_samples: fewer are refused.

    Returns:
        Sample count, error (mean |predicted - measured| / measured) before and after, parameters
        with standard errors, which samples are set aside, what is kept from the model in service,
        what the samples leave open, by how much answers change, and the comparison on samples held
        back; `model` (the fingerprint) and `file` of the refit, or `refused` and `candidate` when
        something speaks against it.
    """
    bench = hmcvt.read_bench(samples)
    if len(bench) < min_samples:
        raise hmcvt.InputError(
            f"{bench.source}: {len(bench)} samples; reidentify_min_samples "
            f"= {min_samples}"
        )
    found = refit(
        bench,
        hmcvt.load_model(model),
        hmcvt.load_model(base),
        seed=seed,
        max_drift=max_drift,
    )
    # In the file: they hold as long as the model serves, also after a restart.
    fitted = replace(
        found.model,
        provenance={
            **found.model.provenance,
            "drift": float(f"{found.drift:.6g}"),
            "warnings": list(found.warnings),
        },
    )
    answer = {
        "samples": len(bench),
        "source": bench.source,
        "error_before": found.error_before,
        "error_after": found.error_after,
        "parameters": fitted.to_mapping()["parameters"],
        "warnings": found.warnings,
        "set_aside": found.set_aside,
        "kept": found.kept,
        "largest_change": found.largest_change,
        "drift": found.drift,
        "held_back": None if found.held_back is None else asdict(found.held_back),
    }
    if found.refused:
        path = next_name(candidates, CANDIDATES_KEPT).with_suffix(".yaml")
        hmcvt.save_model(fitted, path)
        return {
            **answer,
            "candidate": str(path),
            "refused": f"{found.refused}; it is kept as {path}",
        }
    hmcvt.save_model(fitted, output)
    # As a restart would read it, to the last digit.
    return {**answer, "model": servable(output).fingerprint, "file": str(output)}


def diagnose(samples: Path, model: Path, seed: int, reports: Path) -> dict[str, Any]:
    """Say why a model and samples disagree.

    Returns:
        The object of `hmcvt diagnose --json`, and `report`: the page of it in the folder `reports`,
        None with a reason in `report_error` when that cannot be written.
    """
    from hmcvt_core.report import write_html

    found = hmcvt.diagnose(
        hmcvt.load_model(model), hmcvt.read_bench(samples), seed=seed
    )
    answer = found.to_dict()
    try:
        path = next_name(reports, REPORTS_KEPT).with_suffix(".html")
        write_atomically(path.with_suffix(".json"), json.dumps(plain(answer)) + "\n")
        write_html(found, path)
    except (
        OSError,
        hmcvt.InputError,
    ) as error:  # such as a full disk, or no matplotlib
        # The answer is worth more than the page.
        return {**answer, "report": None, "report_error": str(error)}
    return {**answer, "report": str(path)}
