# SPDX-License-Identifier: Apache-2.0
"""The heavy work of the node: a refit, a diagnosis. Done in a process of its own."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

from numpy.typing import ArrayLike

import hmcvt_core as hmcvt
from hmcvt_core.files import plain
from hmcvt_core.files.atomic import write_atomically
from hmcvt_core.identification.cross_validation import FEWEST, QUICK, cross_validate
from hmcvt_core.model.agreement import RelativeError, predicted_at

from .model_store import servable
from .state_folder import keep_newest, next_name

CANDIDATES_KEPT = 20
REPORTS_KEPT = 10


class Done(NamedTuple):
    """What a job found, as plain data for the caller of the service.

    With a refit to adopt, if there is one, and its map: there is no time to compute it later.
    """

    answer: dict[str, Any]
    refit: hmcvt.EfficiencyModel | None = None
    grid: hmcvt.EfficiencyMap | None = None


def reidentify(
    samples: Path, model: Path, seed: int, output: Path, candidates: Path, min_samples: int,
    map_axes: tuple[ArrayLike, ArrayLike, ArrayLike],
) -> Done:
    """Refit a model to samples.

    Args:
        samples, model: files to read.
        seed: of the random numbers.
        output: file for the refit; in the folder `candidates` instead, when it is worse than the
            model on samples held back.
        min_samples: fewer are refused.
        map_axes: of the efficiency map of the refit.

    Returns:
        Sample count, error (mean |predicted - measured| / measured) before and after, parameters
        with standard errors, what the samples leave open, and the comparison on samples held back;
        `refused` and `candidate` when the refit is worse.
    """
    bench = hmcvt.read_bench(samples)
    if len(bench) < min_samples:
        raise hmcvt.InputError(f"{bench.source}: {len(bench)} samples; reidentify_min_samples "
                               f"= {min_samples}")
    served = hmcvt.load_model(model)

    def fitted(
        part: hmcvt.BenchSamples, schedule: hmcvt.Schedule | None = None
    ) -> hmcvt.Identification:
        return hmcvt.identify(part, stage=served.stage, formulation=served.formulation,
                              effects=served.effects, schedule=schedule, seed=seed)

    fit = fitted(bench)
    compared = cross_validate(
        bench, fit.model, served, lambda part: fitted(part, QUICK).model, seed)
    unchecked = [] if compared is not None else [
        f"fewer than {FEWEST} samples: none could be held back to check the refit"]
    answer = {
        "samples": len(bench),
        "source": bench.source,
        "error_before": RelativeError.of(predicted_at(served, bench), bench.efficiency).mean,
        "error_after": float(fit.fit_error),
        "parameters": fit.model.to_mapping()["parameters"],
        "warnings": [*fit.warnings, *unchecked],
        "held_back": None if compared is None else asdict(compared),
    }
    if compared is not None and compared.worse:
        path = next_name(candidates).with_suffix(".yaml")
        hmcvt.save_model(fit.model, path)
        keep_newest(candidates, CANDIDATES_KEPT)
        return Done({**answer, "candidate": str(path), "refused": (
            "the refit is worse on samples held back: mean error "
            f"{100 * compared.error_refit:.2f} %, model in service "
            f"{100 * compared.error_in_service:.2f} %; it is kept as {path}")})
    fit.save(output)
    refit = servable(output)  # what a restart would read, to the last digit
    return Done(answer, refit, refit.efficiency_map(*map_axes))


def diagnose(samples: Path, model: Path, seed: int, reports: Path) -> Done:
    """Say why a model and samples disagree.

    Returns:
        The object of `hmcvt diagnose --json`, and `report`: the page of it in the folder `reports`,
        None with a reason in `report_error` when that cannot be written.
    """
    from hmcvt_core.report import write_html

    found = hmcvt.diagnose(hmcvt.load_model(model), hmcvt.read_bench(samples), seed=seed)
    answer = found.to_dict()
    try:
        path = next_name(reports).with_suffix(".html")
        write_atomically(path.with_suffix(".json"), json.dumps(plain(answer)) + "\n")
        write_html(found, path)
        keep_newest(reports, REPORTS_KEPT)
    except (OSError, hmcvt.InputError) as error:  # such as a full disk, or no matplotlib
        # The answer is worth more than the page.
        return Done({**answer, "report": None, "report_error": str(error)})
    return Done({**answer, "report": str(path)})
